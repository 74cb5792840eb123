"""Runs larger than the memory: what reads a whole run holds a part of it at a time."""

from pathlib import Path

import pytest

from benchmarks.large_run import STEPS, measure, write_runs

OBJECT_FRAMES = 500_000
ROWS_AT_ONCE = 20_000  # in proportion to the default at ten million
GROWTH_MB = 100  # in proportion to 2 GB at ten million


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> tuple[Path, Path]:
    return write_runs(tmp_path_factory.mktemp("large"), object_frames=OBJECT_FRAMES)


@pytest.mark.slow
@pytest.mark.parametrize("step", sorted(STEPS))
def test_memory_is_bounded_by_the_part_and_not_by_the_run(runs, step):
    spent = measure(step, runs, rows_at_once=ROWS_AT_ONCE)
    assert spent.peak_mb - spent.start_mb < GROWTH_MB
