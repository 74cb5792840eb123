"""`annotate propose` and `annotate evaluate`: stored, resumable, decisions kept."""

import json

import pandas as pd
import pytest

from bench.annotation import drives as module
from bench.annotation.decisions import applied
from bench.annotation.drives import propose_drives
from bench.annotation.store import read_review, review_file, write_review
from bench.execution import SerialExecutor
from bench.recordings import load_card, open_dataset
from tests.support.cards import write_card
from tests.support.commands import called_here, error_line
from tests.support.drive import write_drive
from tests.support.reviews import decided, judge


@pytest.fixture
def card(tmp_path, monkeypatch, proposals):
    """A data set of one drive, in this process; what is proposed there was computed once, for its few beams."""
    write_drive(tmp_path / "data" / "drive")
    monkeypatch.setattr(module, "propose", lambda _: proposals)
    monkeypatch.setattr("bench.commands.options.worker_processes", lambda _: SerialExecutor())
    return write_card(tmp_path, file="street.yaml", name="street")


def proposed(card):
    (drive,) = propose_drives(
        "street", open_dataset(load_card(card)), card.parent / "reviews", executor=SerialExecutor()
    )
    return drive


def test_propose_then_evaluate(card):
    done = called_here("annotate", "propose", card, "--reviews", "reviews", folder=card.parent)
    assert done.returncode == 0
    assert "drive" in done.stdout
    review = read_review(review_file(card.parent / "reviews", "drive"))
    assert [track.id for track in review.tracks] == ["p000", "p001", "p002"]
    assert (review.dataset, review.recording, review.decisions) == ("street", "drive", ())

    scored = called_here("annotate", "evaluate", card, "--reviews", "reviews", folder=card.parent)
    assert scored.returncode == 0
    assert "object-frames" in scored.stdout
    assert {"pedestrian", "cyclist", "vehicle"} <= set(scored.stdout.split())
    assert sorted(path.name for path in card.parent.iterdir()) == ["data", "reviews", "street.yaml"]

    ended = called_here("annotate", "evaluate", card, "--reviews", "reviews", "--out", "scores", folder=card.parent)
    assert ended.stdout.startswith(scored.stdout)
    written = {path.name: path.read_text() for path in (card.parent / "scores").iterdir()}
    assert sorted(written) == ["evaluate-tracks.csv", "evaluate.csv", "evaluate.html", "evaluate.md"]
    rows = pd.read_csv(card.parent / "scores" / "evaluate.csv")
    every = rows.set_index(["range", "group"]).loc[("all", "all")]
    share = f"{100 * every['recall']:.1f}"
    assert every["object_frames"] > 0
    assert all(share in text and "8 m" in text for name, text in written.items() if "csv" not in name)
    assert share in scored.stdout


def test_two_reviewers_are_compared_and_merged(card):
    """The second one rejects a track, so that the first one's is false against theirs, and open in what both say."""
    proposed(card)
    review = read_review(review_file(card.parent / "reviews", "drive"))
    write_review(review_file(card.parent / "others", "drive"), decided(review, judge("reject", "p000")))
    both = ("annotate", "evaluate", card, "--reviews", "reviews", "--against", "others", "--merged", "merged")
    done = called_here(*both, folder=card.parent)
    assert done.returncode == 0
    assert "p000" in done.stdout
    assert "false" in done.stdout
    merged = applied(read_review(review_file(card.parent / "merged", "drive")))
    assert [track.status for track in merged.values()] == ["open", "open", "open"]
    again = called_here(*both, folder=card.parent)
    assert again.returncode == 2
    assert "a review that is there already" in again.stderr


def test_what_is_there_is_not_computed_again_and_decisions_are_kept(card, monkeypatch):
    first = proposed(card)
    assert (first.objects, first.computed, first.failure) == (3, True, "")
    file = review_file(card.parent / "reviews", "drive")
    write_review(file, decided(read_review(file), judge("accept", "p001")))
    assert not proposed(card).computed
    sweeps = sorted((card.parent / "data" / "drive").rglob("*.npz"))
    sweeps[0].write_bytes(sweeps[1].read_bytes())
    assert proposed(card).computed, "other sweeps are other data"
    monkeypatch.setattr(module, "CODE", (*module.CODE, "annotation/store.py"))  # as if it had changed
    assert proposed(card).computed
    assert [decision.tracks for decision in read_review(file).decisions] == [("p001",)]


def test_one_broken_drive_stops_no_other(card):
    write_drive(card.parent / "data" / "broken")
    (card.parent / "data" / "broken" / "recording.json").write_text(json.dumps({}))
    done = called_here("annotate", "propose", card, "--reviews", "reviews", folder=card.parent)
    assert done.returncode == 2
    assert "failed: broken" in done.stdout + done.stderr
    assert review_file(card.parent / "reviews", "drive").exists()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("evaluate", "--reviews", "reviews"), "annotate propose"),
        (("propose", "--split", "other"), "unknown split or recording"),
    ],
)
def test_a_mistake_is_one_line(card, monkeypatch, capsys, words, told):
    assert told in error_line(monkeypatch, capsys, "annotate", words[0], card, *words[1:]).lower()
