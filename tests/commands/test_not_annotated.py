"""A drive that nobody annotated: masks, cost and pictures but no scores; nothing takes it for "nothing moves"."""

import json
import shutil

import pytest

from bench import open_dataset, score
from bench.errors import UsageError
from bench.harness.stored import read_run
from tests.support.cards import write_card
from tests.support.commands import call, called_here, error_line
from tests.support.counts import read_tables

RUN = ("--no-pictures", "--protocol", "surface-v1")


def card_of(tiny_card, folder, *, recordings=("crossing",), unlabelled=("crossing",), **keys):
    """A card of copies of rendered drives, some of them without their annotations."""
    source = tiny_card.parent / "data" / "tiny"
    for name in recordings:
        shutil.copytree(source / name, folder / "data" / name)
        if name in unlabelled:
            (folder / "data" / name / "annotations.json").unlink()
    return write_card(folder, file="drives.yaml", name="drives", **keys)


@pytest.fixture(scope="module")
def unlabelled(tiny_card, tmp_path_factory):
    """Card and run of a drive without annotations, and what was printed."""
    folder = tmp_path_factory.mktemp("unlabelled")
    card = card_of(tiny_card, folder)
    ended = called_here("run", card, "--out", folder / "run", *RUN)
    return card, folder / "run", ended


def test_a_run_has_masks_and_no_scores(unlabelled):
    _, run, ended = unlabelled
    assert ended.returncode == 0
    summary = read_run(run).summary
    images = summary.images.images
    assert (summary.images.evaluated, summary.images.not_annotated) == (0, images)
    assert images > 1
    assert summary.failures == ()
    told = f"Not annotated: no scores; on average {100 * summary.marked.value:.1f} % of their valid pixels are marked."
    assert ended.stdout.count(told) + ended.stderr.count(told) == 1
    assert summary.caveats.startswith(told)
    assert told in (run / "surface-v1" / "table.md").read_text()
    stored = json.loads((run / "surface-v1" / "summary.json").read_text())
    assert stored["false_positives"]["coverage"] == {"value": None, "ci95": None, "cases": 0, "recordings": 0}
    assert stored["all_moving"]["iou"]["value"] is None
    objects, frames = read_tables(run)
    rows = frames.to_pylist()
    assert len(objects) == 0
    assert {row["status"] for row in rows} == {"not_annotated"}
    assert all(row["fp_px"] == row["tp_px"] == 0 for row in rows)
    shares = [row["detected_px"] / row["valid_px"] for row in rows]
    assert 0 < summary.marked.value == pytest.approx(sum(shares) / len(shares))
    assert summary.marked.cases == images


def test_it_can_be_looked_at_validated_and_exported(unlabelled, monkeypatch, tmp_path):
    card, run, _ = unlabelled
    assert call(monkeypatch, "view", card, "--out", tmp_path / "view", "--frame", 2) == 0
    assert call(monkeypatch, "validate", card, "--errors-only") == 0
    words = ("--annotated", "--format", "openlabel", "--split", "crossing", "--out", tmp_path / "labels")
    assert call(monkeypatch, "annotate", "export", card, *words) == 0
    assert call(monkeypatch, "report", run, "--out", tmp_path / "page.html") == 0
    assert "Not annotated: no scores" in (tmp_path / "page.html").read_text()


def test_nothing_judges_or_ranks_it(unlabelled, monkeypatch, capsys, tmp_path):
    _, run, _ = unlabelled
    refused = "expected a run with scores, got one of data that are not annotated"
    assert refused in error_line(monkeypatch, capsys, "gate", run, "--update", "--baseline", tmp_path / "baseline")
    assert refused in error_line(monkeypatch, capsys, "compare", run, run, "--out", tmp_path / "compare")
    call(monkeypatch, "leaderboard", run.parent)
    assert refused in " ".join(capsys.readouterr().out.split())


def test_predictions_and_arrays_are_not_scored_against_it(unlabelled, monkeypatch, capsys, tmp_path):
    card, _, _ = unlabelled
    (tmp_path / "masks").mkdir()
    shown = error_line(
        monkeypatch, capsys, "evaluate", card, "--predictions", tmp_path / "masks", "--out", tmp_path / "run"
    )
    assert "drives.yaml: annotations: expected an annotated image, got none" in shown
    frame = next(iter(open_dataset(card).frames()))
    assert not frame.reference.annotated
    with pytest.raises(UsageError, match="expected one of an annotated image, got crossing, front"):
        score(frame.reference, frame.reference.valid)


def test_an_empty_file_still_says_that_nothing_moves(unlabelled, tiny_card, tmp_path):
    card = card_of(tiny_card, tmp_path)
    (tmp_path / "data" / "crossing" / "annotations.json").write_text(
        '{"openlabel": {"metadata": {"schema_version": "1.0.0"}, "objects": {}, "frames": {}}}'
    )
    ended = called_here("run", card, "--method", "everything", "--out", tmp_path / "run", *RUN)
    summary = read_run(tmp_path / "run").summary
    assert ended.returncode == 0
    assert summary.images.not_annotated == 0
    assert summary.false_positives.coverage.value > 0
    assert read_run(tmp_path / "run").manifest.reference != read_run(unlabelled[1]).manifest.reference
    told = called_here("validate", card)
    assert told.returncode == 1
    assert "expected objects, as all of the recording is said to be annotated; got none" in told.stdout


def test_a_part_that_is_annotated_is_scored_alone(unlabelled, tiny_card, tmp_path):
    """Times of the card; the scored images are what they are in a run of all."""
    whole = card_of(tiny_card, tmp_path / "whole", unlabelled=())
    called_here("run", whole, "--method", "frame-difference", "--out", tmp_path / "all", *RUN)
    rows = [row for row in read_tables(tmp_path / "all")[1].to_pylist() if row["status"] == "evaluated"]
    first_ns = sorted(row["timestamp_ns"] for row in rows)[len(rows) // 2]
    card = card_of(tiny_card, tmp_path / "part", unlabelled=(), annotated={"timestamps_ns": [[first_ns, None]]})
    words = ("run", card, "--method", "frame-difference", *RUN)
    ended = called_here(*words, "--out", tmp_path / "some")
    assert ended.returncode == 0
    called_here(*words, "--out", tmp_path / "again")  # by the references that are stored now
    assert read_run(tmp_path / "again").summary.images == read_run(tmp_path / "some").summary.images
    found = read_tables(tmp_path / "some")[1].to_pylist()
    kept = [row for row in found if row["status"] == "evaluated"]
    assert kept == [row for row in rows if row["timestamp_ns"] >= first_ns]
    images = read_run(tmp_path / "some").summary.images
    assert images.not_annotated == len(found) - len(kept) > 0
    assert (
        f"{images.not_annotated} of {images.images} images are not annotated: no scores" in ended.stdout + ended.stderr
    )
