"""What of a recording is annotated: stated by its head or its card, else complete with a file and none without."""

import pytest

from bench.errors import DataError
from bench.recordings import load_card, open_dataset, open_native
from bench.records.recording import ALWAYS_NS, COMPLETELY, NOT_ANNOTATED, Annotated
from tests.support import tiny
from tests.support.cards import write_card
from tests.support.planting import change_head

AREA = ((-50.0, 4.0), (50.0, 4.0), (50.0, 30.0))
PARTLY = {"timestamps_ns": [[tiny.TIMES_NS[1], None]], "left_out_m": [[list(point) for point in AREA]]}
PART = Annotated(spans_ns=((tiny.TIMES_NS[1], ALWAYS_NS[1]),), left_out_m=(AREA,))


@pytest.fixture
def root(tmp_path):
    return tiny.write_recording(tmp_path / "drives" / "drive")


def state(root, annotated):
    change_head(root, lambda head: head.update(annotated=annotated))


def by_card(root, **keys):
    (handle,) = open_dataset(load_card(write_card(root.parent.parent, root="drives", **keys)))
    return handle.open()


def test_a_file_counts_as_complete_unless_the_recording_says_otherwise(root):
    assert open_native(root).annotated == COMPLETELY
    for statement, annotated in (("complete", COMPLETELY), ("none", NOT_ANNOTATED), (PARTLY, PART), (None, COMPLETELY)):
        state(root, statement)
        found = open_native(root)
        assert found.annotated == annotated
        assert found.tracks, "there to be looked at, whatever counts"


def test_without_a_file_nothing_is_annotated(root):
    (root / "annotations.json").unlink()
    for statement in (None, "none"):
        state(root, statement)
        found = open_native(root)
        assert (found.annotated, found.tracks) == (NOT_ANNOTATED, ())
    for statement in ("complete", PARTLY):
        state(root, statement)
        with pytest.raises(DataError, match=r"annotations\.json: expected annotations, as recording\.json states them"):
            open_native(root)


def test_a_folder_of_annotations_is_complete_unless_somebody_says_otherwise(root):
    folder = root.parent.parent / "reviewed"
    folder.mkdir()
    (folder / "drive.review.json").write_text("{}")  # what is reviewed is no annotation yet
    (root / "annotations.json").rename(folder / "drive.json")
    for statement in (None, "none"):  # "none" as of a raw drive before it was annotated
        state(root, statement)
        opened = by_card(root, annotations="reviewed")
        assert (opened.annotated, len(opened.tracks)) == (COMPLETELY, len(tiny.tracks()))
        assert by_card(root, annotated="none", annotations="reviewed").annotated == NOT_ANNOTATED
        assert by_card(root, annotated="complete").annotated == NOT_ANNOTATED  # of a recording without any
    state(root, PARTLY)
    assert by_card(root, annotations="reviewed").annotated == PART


def test_a_card_says_it_of_recordings_that_are_annotated(root):
    for keys, annotated in (({}, COMPLETELY), ({"annotated": PARTLY}, PART), ({"annotated": "none"}, NOT_ANNOTATED)):
        assert by_card(root, **keys).annotated == annotated
    state(root, PARTLY)
    assert by_card(root).annotated == PART
    assert by_card(root, annotated="complete").annotated == COMPLETELY


@pytest.mark.parametrize(
    "statement", ["some", 1, {"timestamps_ns": []}, {"timestamps_ns": [[5, 4]]}, {"left_out_m": [[[0, 0], [1, 1]]]}]
)
def test_statements_that_say_nothing_are_refused(root, statement):
    state(root, statement)
    with pytest.raises(DataError, match="annotated"):
        open_native(root)
