"""From a review to annotations, by the command, and what a run on annotations that nobody reviewed says."""

import json
import re
import shutil
import signal
import subprocess
import sys
import urllib.request

import numpy as np
import pandas as pd
import pytest

from bench.annotation import store
from bench.annotation.decisions import applied, to_tracks
from bench.annotation.formats.conversion import store_labels
from bench.errors import OutputError
from bench.harness.stored import read_run
from bench.recordings import open_native, read_annotations
from bench.recordings.annotations import NOT_REVIEWED
from tests.support.commands import called_here, error_line
from tests.support.reviews import DRIVE, decided, judge, proposed_from, stored


def accepted(review, *names):
    return decided(review, judge("accept", *(names or (track.id for track in review.tracks))))


def watched(review, drive):
    return review.watched(sweep.timestamp_ns for sweep in drive.sweeps)


def test_true_tracks_come_back_from_a_review(drive):
    tracks = to_tracks(accepted(proposed_from(drive)), drive)
    assert len(tracks) == len(drive.tracks) > 0
    for found, true in zip(tracks, drive.tracks, strict=True):
        assert (found.object_class, found.reviewed) == (true.object_class, True)
        for a, b in zip(found.states, true.states, strict=True):
            assert a.timestamp_ns == b.timestamp_ns
            pose, expected = a.shape.vehicle_from_object, b.shape.vehicle_from_object
            np.testing.assert_allclose(pose.translation_m, expected.translation_m, atol=1e-6)
            np.testing.assert_allclose(pose.rotation[:2, :2], expected.rotation[:2, :2], atol=0.01)  # level
            np.testing.assert_allclose(a.velocity_mps[:2], b.velocity_mps[:2], atol=0.02)


def test_only_accepted_tracks_of_a_finished_review_are_written(card, drive, tmp_path, monkeypatch, capsys):
    review, out = proposed_from(drive), tmp_path / "out"
    export = ("annotate", "export", card, "--out", out)
    first, *others = (track.id for track in review.tracks)
    decided_all = accepted(decided(review, judge("reject", *others)), first)
    partly = decided_all.watched(sweep.timestamp_ns for sweep in drive.sweeps[:2])
    unwatched = f"got {len(drive.sweeps) - 2} of {len(drive.sweeps)} sweeps that nobody watched"
    for unfinished, told in (
        (accepted(review, first), "decision on each track"),
        (decided_all, "watched to its end"),
        (partly, unwatched),
    ):
        stored(card, unfinished)
        assert told in error_line(monkeypatch, capsys, *export)
    assert not out.exists()
    stored(card, watched(decided_all, drive))
    assert called_here(*export).returncode == 0
    (track,) = read_annotations(out / f"{DRIVE}.json")
    assert (track.track_id, track.reviewed) == (first, True)
    frames = json.loads((out / f"{DRIVE}.json").read_text())["openlabel"]["frames"]
    times_ns = {frame["frame_properties"]["timestamp"] for frame in frames.values()}
    assert {sweep.timestamp_ns for sweep in drive.sweeps} <= times_ns
    assert called_here("annotate", "export", card, "--out", out / "tool", "--format", "boxes").returncode == 0
    assert (out / "tool" / DRIVE / "boxes.csv").is_file()


def test_a_review_of_another_drive_gives_no_labels(card, drive, tmp_path):
    file = stored(card, watched(accepted(proposed_from(drive)), drive))
    other = store.read_review(file).model_copy(update={"recording": "another"})
    store.write_review(file, other)
    told = f"recording: expected '{DRIVE}', got 'another'; it is a copy of another drive's"
    for command in ("export", "evaluate", "propose"):
        words = ("--out", tmp_path / "out") if command == "export" else ()
        ended = called_here("annotate", command, card, *words)
        assert ended.returncode == 2
        assert told in " ".join((ended.stdout + ended.stderr).split())
    assert not (tmp_path / "out").exists()


FILES = {"a.json": b"a", "drive/b.csv": b"b"}


def test_other_labels_stay_unless_asked_and_then_as_a_copy(tmp_path):
    assert store_labels(tmp_path, FILES) == store_labels(tmp_path, FILES) == ()
    (tmp_path / "drive/b.csv").write_bytes(b"mine")
    with pytest.raises(OutputError, match=r"other labels that are there; .*--overwrite, which keeps a copy"):
        store_labels(tmp_path, {"a.json": b"new", "drive/b.csv": b"new"})
    assert (tmp_path / "drive/b.csv").read_bytes() == b"mine"
    assert (tmp_path / "a.json").read_bytes() == b"a"  # all or none
    assert store_labels(tmp_path, {"drive/b.csv": b"new"}, overwrite=True) == (tmp_path / "drive/b.csv.1",)
    assert (tmp_path / "drive/b.csv.1").read_bytes() == b"mine"
    assert store_labels(tmp_path, {"drive/b.csv": b"newer"}, overwrite=True) == (tmp_path / "drive/b.csv.2",)
    assert sorted(path.name for path in (tmp_path / "drive").iterdir()) == ["b.csv", "b.csv.1", "b.csv.2"]


def test_a_folder_in_the_way_is_one_line(tmp_path):
    (tmp_path / "a.json").mkdir()
    with pytest.raises(OutputError, match="a folder or device"):
        store_labels(tmp_path, {"a.json": b"a"}, overwrite=True)


@pytest.mark.slow
def test_a_run_on_proposals_that_nobody_reviewed_says_so(card, drive, tmp_path):
    stored(card, decided(proposed_from(drive), judge("reject", proposed_from(drive).tracks[-1].id)))
    ended = called_here("annotate", "export", card, "--out", card.parent / "annotations", "--unreviewed")
    assert ended.returncode == 0
    file = card.parent / "annotations" / f"{DRIVE}.json"
    assert json.loads(file.read_text())["openlabel"]["metadata"]["comment"] == NOT_REVIEWED
    recording = open_native(tmp_path / "data" / DRIVE, annotations=file)
    assert len(recording.tracks) == len(drive.tracks) - 1
    assert not any(track.reviewed for track in recording.tracks)
    run = tmp_path / "run"
    ended = called_here("run", card, "--out", run, "--no-pictures", "--protocol", "paper-v1")
    said = f"{NOT_REVIEWED} (1 of 1 recordings)"
    assert said in ended.stdout + ended.stderr
    assert read_run(run).summary.caveats.startswith(said)
    results = run / "paper-v1"
    assert said in (results / "table.md").read_text()
    lines = pd.read_csv(results / "table.csv")
    assert set(lines["annotations"]) == {said.removeprefix("annotations: ")}
    baseline = tmp_path / "baseline"
    assert called_here("gate", run, "--baseline", baseline, "--update").returncode == 0
    judged = called_here("gate", run, "--baseline", baseline, "--json", tmp_path / "verdict.json")
    assert said in judged.stdout
    assert said in (tmp_path / "verdict.json").read_text()
    shutil.copytree(run, tmp_path / "again")
    compared = called_here("compare", run, tmp_path / "again", "--out", tmp_path / "compared", "--no-pictures")
    assert said in compared.stdout
    assert said in (tmp_path / "compared" / "compare.md").read_text()
    assert called_here("leaderboard", run, "--out", tmp_path / "board").returncode == 0
    board = {file.name: file.read_text() for file in (tmp_path / "board").iterdir() if file.suffix != ".png"}
    assert said in board["leaderboard.md"]
    for name in ("leaderboard.json", "index.html"):
        assert said.removeprefix("annotations: ") in board[name]
    assert called_here("report", run, "--no-pictures").returncode == 0
    pages = [page.read_text() for page in run.rglob("*.html")]
    assert pages
    assert all(NOT_REVIEWED in page for page in pages)


def test_the_command_serves_and_ends_with_an_interrupt(card, drive):
    file = stored(card, proposed_from(drive))
    command = [sys.executable, "-m", "bench", "annotate", "review", str(card), "--no-browser", "--reviewer", "R."]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as running:
        lines = [running.stdout.readline() for _ in range(2)]
        origin, token = re.search(r"(http://127\.0\.0\.1:\d+)/#(\S+)", "".join(lines)).groups()
        body = json.dumps({"action": "accept", "tracks": ["p000"]}).encode()
        headers = {"X-Review-Token": token, "Content-Type": "application/json"}
        question = urllib.request.Request(f"{origin}/drives/0/decide", data=body, headers=headers)
        urllib.request.urlopen(question, timeout=30).close()
        running.send_signal(signal.SIGINT)
        rest, _ = running.communicate(timeout=20)
    assert (running.returncode, "Traceback" in rest) == (0, False)
    assert applied(store.read_review(file))["p000"].status == "accepted"
