"""The chance level scores objects against the mask of another frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.evaluation.counts import ChanceScorer
from bench.records.reference import ReferenceFrame
from tests.evaluation.frames import ignored_object, picture, reference_frame, reference_object

PIXELS = 12


def frame(timestamp_ns: int) -> ReferenceFrame:
    """Object "a" is the whole image, "far" is ignored."""
    objects = [reference_object("a"), ignored_object("far")]
    return reference_frame(picture("1" * PIXELS), objects=objects, timestamp_ns=timestamp_ns)


def chance_of(times_ns: Sequence[int], *, lag_ns: int) -> dict[int, dict[str, int]]:
    """The mask of the n-th frame has n + 1 pixels, so that the count tells which mask was used."""
    scorer = ChanceScorer(lag_ns=lag_ns)
    for n, timestamp_ns in enumerate(times_ns):
        scorer.add(frame(timestamp_ns), np.arange(PIXELS)[None] <= n)
    return scorer.finish()


def test_a_lag_earlier_and_for_the_first_frames_a_lag_later() -> None:
    found = chance_of([0, 10, 20, 30, 40], lag_ns=20)
    assert {t: objects["a"] for t, objects in found.items()} == {0: 3, 10: 4, 20: 1, 30: 2, 40: 3}


def test_only_evaluated_objects_have_a_chance_level() -> None:
    assert all(set(objects) == {"a"} for objects in chance_of([0, 10, 20], lag_ns=10).values())


def test_a_sequence_too_short_has_no_chance_level() -> None:
    assert chance_of([0, 10, 20], lag_ns=21) == {}
    # The middle frame is a lag away from neither end.
    assert set(chance_of([0, 10, 20], lag_ns=15)) == {0, 20}


def test_a_gap_in_time_only_makes_the_other_frame_further_away() -> None:
    found = chance_of([0, 10, 100, 110], lag_ns=20)
    assert {t: objects["a"] for t, objects in found.items()} == {0: 3, 10: 3, 100: 2, 110: 2}


@given(st.sets(st.integers(0, 100), max_size=PIXELS - 1), st.integers(1, 60))
def test_agrees_with_a_search_over_all_frames(times: set[int], lag_ns: int) -> None:
    times_ns = sorted(times)
    expected = {}
    for t in times_ns:
        earlier = [n for n, other in enumerate(times_ns) if other <= t - lag_ns]
        later = [n for n, other in enumerate(times_ns) if other >= t + lag_ns]
        if earlier or later:
            expected[t] = {"a": (earlier[-1] if earlier else later[0]) + 1}
    assert chance_of(times_ns, lag_ns=lag_ns) == expected


def test_frames_come_in_time_order() -> None:
    scorer = ChanceScorer(lag_ns=10)
    scorer.add(frame(5), np.zeros((1, PIXELS), dtype=bool))
    with pytest.raises(AssertionError, match="time order"):
        scorer.add(frame(5), np.zeros((1, PIXELS), dtype=bool))
