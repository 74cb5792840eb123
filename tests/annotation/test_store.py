"""The file of a review, what decisions do to tracks, and decisions on proposals that are made anew."""

from functools import partial

import numpy as np
import pytest

from bench.annotation import store
from bench.annotation.decisions import applied, undecided
from bench.annotation.drives import carry_over, merge_reviews, tracks_iou
from bench.errors import DataError, UsageError
from tests.support.reviews import MADE, STEP_NS, decided, judge, review_of, straight


def statuses(review):
    return [track.status for track in applied(review).values()]


accept, reject = partial(judge, "accept"), partial(judge, "reject")


def key(name, i, centre_m, *, yaw_rad=0.0, size_m=(4.0, 2.0, 1.5)):
    box = {"centre_m": centre_m, "yaw_rad": yaw_rad, "size_m": size_m}
    return store.SetBox(**MADE, track=name, timestamp_ns=i * STEP_NS, **box)


def cut(name, i):
    return store.SplitTime(**MADE, track=name, timestamp_ns=i * STEP_NS)


def told(action, *names, **more):
    return action(**MADE, tracks=names, **more)


merge, set_class = partial(told, store.Merge), partial(told, store.SetClass)


def draw(track):
    return store.Draw(**MADE, drawn=track)


UNDO, REDO = store.Undo(**MADE), store.Redo(**MADE)


def test_a_review_is_read_back_as_it_was_written(tmp_path):
    review = decided(
        review_of(straight("p1"), straight("p2")), accept("p1"), reject("p2"), UNDO, key("p1", 3, (3, 1, 1))
    )
    review = review.watched([5, 0]).watched([5, 9])
    assert review.watched_ns == (0, 5, 9)
    store.write_review(tmp_path / "drive.review.json", review)
    assert store.read_review(tmp_path / "drive.review.json") == review
    assert [file.name for file in tmp_path.iterdir()] == ["drive.review.json"]


DAMAGE = {
    "cut": lambda text: text[: len(text) // 2],
    "another version": lambda text: text.replace('"schema_version":1', '"schema_version":2'),
    "an unknown key": lambda text: text.replace('"dataset"', '"shell":"rm", "dataset"'),
    "not a number": lambda text: text.replace('"yaw_rad":0.0', '"yaw_rad":NaN', 1),
    "a number in words": lambda text: text.replace('"yaw_rad":0.0', '"yaw_rad":"0"', 1),
    "a class of its own": lambda text: text.replace('"vehicle"', '"ufo"', 1),
    "a path as a name": lambda text: text.replace('"p1"', '"../p1"'),
    "a name twice": lambda text: text.replace('"p2"', '"p1"'),
    "times out of order": lambda text: text.replace('"timestamp_ns":0,', '"timestamp_ns":900000000000,', 1),
    "a deep nest": lambda _: "[" * 100_000,
    "a size of nothing": lambda text: text.replace("4.0", "0.0", 1),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_a_damaged_review_is_refused_with_its_place(tmp_path, name):
    file = tmp_path / "drive.review.json"
    store.write_review(file, decided(review_of(straight("p1"), straight("p2")), accept("p1")))
    file.write_text(DAMAGE[name](file.read_text()))
    before = file.read_bytes()
    with pytest.raises(DataError, match=r"drive\.review\.json"):
        store.read_review(file)
    assert file.read_bytes() == before


def test_a_review_that_is_too_large_is_neither_read_nor_written(tmp_path, monkeypatch):
    monkeypatch.setattr(store, "LARGEST_BYTES", 100)
    file = tmp_path / "drive.review.json"
    file.write_text("x" * 200)
    with pytest.raises(DataError, match="limit of 100"):
        store.read_review(file)
    with pytest.raises(UsageError, match="at most 100 bytes"):
        store.write_review(file, review_of())


def test_undo_takes_back_and_redo_makes_again_what_came_last():
    review = decided(review_of(straight("p1"), straight("p2")), accept("p1"), reject("p2"))
    assert statuses(review) == ["accepted", "rejected"]
    assert statuses(decided(review, UNDO)) == ["accepted", "open"]
    twice = decided(review, UNDO, UNDO)
    assert statuses(twice) == ["open", "open"]
    with pytest.raises(UsageError, match="undo"):
        decided(twice, UNDO)
    assert statuses(decided(twice, REDO)) == ["accepted", "open"]
    review = decided(twice, REDO, accept("p2"))
    assert statuses(review) == ["accepted", "accepted"]
    with pytest.raises(UsageError, match="redo"):
        decided(review, REDO)
    assert len(review.decisions) == 6  # the log holds everything


@pytest.mark.parametrize(
    "decision",
    [accept("p2"), reject("nobody"), key("p2", 0, (0, 0, 0)), merge("p1", "p1"), draw(straight("p1"))],
    ids=["merged", "unknown", "key frame", "one alone", "drawn twice"],
)
def test_decisions_about_tracks_that_are_not_there_are_refused(decision):
    review = decided(review_of(straight("p1"), straight("p2")), merge("p1", "p2"))
    with pytest.raises(UsageError):
        decided(review, decision)


def test_what_a_reviewer_says_of_a_track():
    said = [
        set_class("p1", object_class="cyclist"),
        told(store.SetUnclear, "p1", unclear=True),
        told(store.SetCategory, "p1", category="crossing"),
    ]
    track, other = applied(decided(review_of(straight("p1"), straight("p2")), *said)).values()
    assert (track.object_class, track.unclear, track.category) == ("cyclist", True, "crossing")
    assert (other.object_class, other.unclear, other.category) == ("vehicle", False, None)
    assert statuses(decided(review_of(straight("p1")), accept("p1"), judge("reopen", "p1"))) == ["open"]


def test_merging_puts_one_box_around_two_that_move_side_by_side():
    pair = review_of(straight("p1"), straight("p2", start=(4.0, 1.0)))  # x from -2 to 6, y from -1 to 2
    (track,) = applied(decided(pair, merge("p1", "p2"))).values()
    np.testing.assert_allclose(track.size_m, [8.0, 3.0, 1.5])
    np.testing.assert_allclose(track.motion.centres_m[0], [2.0, 0.5, 1.0])
    np.testing.assert_allclose(track.motion.velocities_mps, np.tile([10.0, 0.0], (11, 1)), atol=1e-9)


def test_merging_one_after_the_other_fills_the_gap_between():
    pair = review_of(straight("p1", states=5), straight("p2", first=8, states=5))
    (track,) = applied(decided(pair, merge("p1", "p2"))).values()
    assert track.motion.times_ns.tolist() == [i * STEP_NS for i in range(13)]
    np.testing.assert_allclose(track.motion.centres_m[:, 0], np.arange(13.0))


def test_splitting_in_time_cuts_the_states():
    tracks = applied(decided(review_of(straight("p1")), cut("p1", 4)))
    assert {name: len(track.motion) for name, track in tracks.items()} == {"p1": 4, "p1.1": 7}
    assert tracks["p1.1"].motion.times_ns[0] == 4 * STEP_NS
    with pytest.raises(UsageError):
        decided(review_of(straight("p1")), cut("p1", 0))


def test_splitting_in_space_cuts_the_box_along_the_line():
    line = ((5.0, -9.0), (5.0, 9.0))  # across the box, whose centre is at x = 4 when it is drawn: 3 m and 1 m are left
    by_line = store.SplitSpace(**MADE, track="p1", timestamp_ns=4 * STEP_NS, line_m=line)
    tracks = applied(decided(review_of(straight("p1")), by_line))
    np.testing.assert_allclose(tracks["p1"].size_m, [3.0, 2.0, 1.5])
    np.testing.assert_allclose(tracks["p1.1"].size_m, [1.0, 2.0, 1.5])
    np.testing.assert_allclose(tracks["p1"].motion.centres_m[4], [3.5, 0.0, 1.0])
    np.testing.assert_allclose(tracks["p1.1"].motion.centres_m[4], [5.5, 0.0, 1.0])
    with pytest.raises(UsageError, match="crosses"):
        decided(review_of(straight("p1")), by_line.model_copy(update={"line_m": ((50.0, 0.0), (50.0, 1.0))}))


def test_key_frames_correct_along_the_motion_that_was_found():
    review = decided(review_of(straight("p1")), key("p1", 2, (2.0, 1.0, 1.0)), key("p1", 6, (6.5, 1.0, 1.0)))
    motion = applied(review)["p1"].motion
    np.testing.assert_allclose(motion.centres_m[[0, 2, 4, 6, 10], 0], [0.0, 2.0, 4.25, 6.5, 10.5])
    np.testing.assert_allclose(motion.centres_m[:, 1], 1.0)
    np.testing.assert_allclose(motion.velocities_mps[4], [11.25, 0.0])
    assert applied(decided(review, UNDO))["p1"].motion.centres_m[6, 0] == 6.0


def test_a_key_frame_beyond_the_end_carries_the_track_on():
    motion = applied(decided(review_of(straight("p1")), key("p1", 13, (13.0, 0.0, 1.0))))["p1"].motion
    assert motion.times_ns.tolist() == [i * STEP_NS for i in range(14)]
    np.testing.assert_allclose(motion.centres_m[:, 0], np.arange(14.0), atol=1e-9)
    with pytest.raises(UsageError, match="2 s"):
        decided(review_of(straight("p1")), key("p1", 99, (0.0, 0.0, 1.0)))


def test_decisions_go_to_new_proposals_of_the_same_object():
    old = decided(
        review_of(*(straight(f"p{i}", start=(0, 20 * i - 20)) for i in range(1, 5))),
        accept("p1"), reject("p2"), accept("p3"), reject("p4"), UNDO,
    ).watched([0, 10**9])  # fmt: skip
    new = review_of(straight("p1", start=(0, 60)), straight("p7", start=(0.3, 0.1)), code="newer")
    carried = carry_over(old, new)
    assert {name: track.status for name, track in applied(carried).items()} == {
        "p1": "open",  # another object now, which nobody decided on
        "p7": "accepted",  # p1 of old
        "p3": "accepted",  # found no more, but a reviewer saw it
    }
    assert carried.watched_ns == old.watched_ns
    assert carry_over(old, review_of(data="other sweeps")).watched_ns == ()


@pytest.mark.parametrize("changed", [cut("p1", 9), key("p1", 3, (3.5, 0.0, 1.0)), merge("p1", "p3")])
def test_a_track_that_a_reviewer_changed_stays_as_it_was(changed):
    tracks = straight("p1"), straight("p2", start=(0, 20)), straight("p3", start=(4, 1))
    old = decided(review_of(*tracks), changed, accept("p1", "p2"))
    anew = straight("p5", start=(0.1, 0.0)), straight("p6", start=(0, 20)), straight("p1", start=(0, 60))
    carried = applied(carry_over(old, review_of(*anew)))
    assert "p5" not in carried
    assert carried["p6"].status == "accepted"
    assert carried["p1"].status == "open"
    kept, before = carried["p1-1"], applied(old)["p1"]
    assert kept.status == "accepted"
    np.testing.assert_array_equal(kept.motion.centres_m, before.motion.centres_m)
    np.testing.assert_array_equal(kept.size_m, before.size_m)


def test_a_review_that_contradicts_itself_is_refused_when_proposals_are_made_anew():
    old = review_of(straight("p1")).model_copy(update={"decisions": (accept("nobody"), accept("p1"))})
    with pytest.raises(UsageError, match="nobody"):
        carry_over(old, review_of(straight("p5")))


def test_what_was_drawn_is_not_proposed_again():
    old = decided(review_of(), draw(straight("d1")))
    carried = carry_over(old, review_of(straight("p1", start=(0.2, 0)), straight("p2", start=(0, 20))))
    assert list(applied(carried)) == ["p2", "d1"]


@pytest.mark.parametrize(
    ("a", "b", "iou"),
    [
        ({}, {}, 1.0),
        ({}, {"start": (0, 1)}, 1 / 3),
        ({"states": 10}, {"states": 5}, 0.5),
        ({"states": 5}, {"first": 5}, 0.0),
    ],
)
def test_iou_of_tracks_counts_all_times_of_both(a, b, iou):
    assert tracks_iou(undecided(straight("a", **a)), undecided(straight("b", **b))) == pytest.approx(iou)


def without(track, *numbers):
    """The track without some of its states."""
    kept = tuple(state for number, state in enumerate(track.states) if number not in numbers)
    return track.model_copy(update={"states": kept})


def reasons(track):
    return [doubt.reason for doubt in track.doubts]


def test_a_hole_is_a_doubt_until_a_key_frame_fills_it():
    two = without(straight("p2", states=9), 2, 3, 6)
    review = review_of(without(straight("p1"), 4, 5, 6), two, without(straight("p3"), 5))
    holes = [reasons(track) for track in applied(review).values()]
    assert holes == [["hole of 3 sweeps"], ["2 holes of 3 sweeps"], ["hole of 1 sweep"]]
    filled = applied(decided(review, key("p1", 5, (5, 0, 1))))["p1"]
    assert reasons(filled) == []
    np.testing.assert_array_equal(filled.motion.times_ns, np.arange(11) * STEP_NS)
    np.testing.assert_allclose(filled.motion.centres_m[:, 0], np.arange(11), atol=1e-9)


def test_a_hole_of_many_seconds_is_filled_near_the_key_frame_alone():
    review = review_of(without(straight("p1", states=91), *range(10, 80)))
    filled = applied(decided(review, key("p1", 25, (25, 0, 1))))["p1"]
    np.testing.assert_array_equal(filled.motion.times_ns // STEP_NS, [*range(26), *range(80, 91)])
    assert reasons(filled) == ["hole of 54 sweeps"]


def test_reviews_of_two_who_differ_leave_open_what_they_differ_in():
    """Both accept the first car; one calls the second a cyclist, rejects the third and draws a fourth."""
    proposals = [straight("p0"), straight("p1", start=(0.0, 10.0)), straight("p2", start=(0.0, 20.0))]
    every = review_of(*proposals).watched([0, STEP_NS])
    a = decided(every, accept("p0", "p1", "p2"))
    cyclist = store.SetClass(tracks=("p1",), object_class="cyclist", **MADE)
    b = decided(every, accept("p0", "p1"), cyclist, reject("p2"), draw(straight("d000", start=(0.0, 30.0))))
    merged = merge_reviews(a, b.watched([2 * STEP_NS]))
    assert {name: track.status for name, track in applied(merged).items()} == {
        "p0": "accepted", "p1": "open", "p2": "open", "m000": "open",
    }  # fmt: skip
    assert merged.watched_ns == (0, STEP_NS, 2 * STEP_NS)
    assert merge_reviews(a, a) == a
    assert set(statuses(merge_reviews(b, a))) == {"accepted", "rejected", "open"}


@pytest.mark.parametrize(("length_m", "status"), [(4.2, "accepted"), (4.5, "open")])
def test_a_side_that_differs_by_half_a_metre_is_left_open(length_m, status):
    a, b = (decided(review_of(straight("p0", size_m=(length, 2.0, 1.5))), accept("p0")) for length in (4.0, length_m))
    assert statuses(merge_reviews(a, b)) == [status]
