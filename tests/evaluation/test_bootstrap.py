"""Intervals by resampling recordings."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.evaluation.bootstrap import cluster_interval, sequence_weights


def interval(numerators: list[float], denominators: list[float], *, seed: int = 0) -> tuple[float, float] | None:
    weights = sequence_weights(len(numerators), draws=2000, seed=seed)
    return cluster_interval(np.array(numerators), np.array(denominators), weights=weights)


def test_every_draw_has_as_many_sequences_as_there_are() -> None:
    weights = sequence_weights(7, draws=2000, seed=3)
    assert weights.shape == (2000, 7)
    assert (weights.sum(axis=1) == 7).all()


def test_two_sequences_one_perfect_one_blind() -> None:
    # A quarter of the draws holds only the one, a quarter only the other.
    assert interval([10, 0], [10, 10]) == (0.0, 1.0)


def test_no_interval_from_fewer_than_two_sequences_with_cases() -> None:
    assert interval([], []) is None
    assert interval([5], [10]) is None
    assert interval([5, 0, 0], [10, 0, 0]) is None


def test_draws_without_cases_are_left_out() -> None:
    # With 2 of 40 sequences holding cases, one draw in eight has neither of them.
    found = interval([1, 1] + [0] * 38, [2, 2] + [0] * 38)
    assert found == (0.5, 0.5)


def test_equal_scores_give_an_interval_without_width() -> None:
    assert interval([3, 6, 1.5], [4, 8, 2]) == (0.75, 0.75)


def test_the_same_seed_gives_the_same_interval_and_another_a_close_one() -> None:
    numerators, denominators = [3.0, 9.0, 4.0, 1.0, 7.0], [10.0, 12.0, 4.0, 5.0, 9.0]
    assert interval(numerators, denominators, seed=1) == interval(numerators, denominators, seed=1)
    assert interval(numerators, denominators, seed=2) == pytest.approx(interval(numerators, denominators), abs=0.06)


@given(st.lists(st.tuples(st.integers(0, 20), st.integers(0, 20)), min_size=5, max_size=12))
def test_an_interval_lies_between_the_worst_and_the_best_sequence(pairs: list[tuple[int, int]]) -> None:
    numerators = [float(min(pair)) for pair in pairs]
    denominators = [float(max(pair)) for pair in pairs]
    found = interval(numerators, denominators)
    ratios = [n / d for n, d in zip(numerators, denominators, strict=True) if d]
    if found is None:
        assert len(ratios) < 2
    else:
        assert min(ratios) - 1e-12 <= found[0] <= found[1] <= max(ratios) + 1e-12


def test_intervals_cover_the_truth_where_frames_of_a_sequence_depend_on_each_other() -> None:
    """200 simulated runs of 30 drives, 50 object-frames each; a drive's rate is drawn around 0.6."""
    generator = np.random.default_rng(11)
    weights = sequence_weights(30, draws=2000, seed=0)
    frames = np.full(30, 50.0)
    covered = 0
    for _ in range(200):
        detected = generator.binomial(50, generator.beta(3, 2, size=30)).astype(np.float64)
        found = cluster_interval(detected, frames, weights=weights)
        assert found is not None
        assert found[0] <= detected.sum() / frames.sum() <= found[1]
        covered += found[0] <= 0.6 <= found[1]
    # 95 % is the aim; an interval that took frames as independent would reach about half of that.
    assert 0.87 <= covered / 200 <= 0.995
