"""How often intervals hold the truth, by simulation; the table in `bench.evaluation.intervals` is printed by `main`.

python -m tests.evaluation.test_coverage
"""

from __future__ import annotations

import re
import sys

import numpy as np
import pandas as pd
import pytest

from bench.evaluation import intervals
from bench.evaluation.comparison import paired_change
from bench.evaluation.intervals import ratio_interval
from tests.evaluation.simulated import SCENARIOS, Scenario, rates, sizes

RECORDINGS = (6, 10, 20, 100)
DRAWS = 4000
LEAST = 0.92
FALLS_SHORT = {"false-positive coverage, equal images, 0.8": 0.895}  # as the table and docs/metrics.md say

pytestmark = pytest.mark.slow


def covered(scenario: Scenario, recordings: int, *, draws: int = DRAWS) -> float:
    draw, held = np.random.default_rng(recordings), 0
    for _ in range(draws):
        found = ratio_interval(*scenario.draw(draw, recordings), within=scenario.within)
        assert found is not None
        held += found[0] <= scenario.truth <= found[1]
    return held / draws


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize("recordings", RECORDINGS)
def test_intervals_hold_the_truth(name: str, recordings: int) -> None:
    found = covered(SCENARIOS[name], recordings)
    assert found >= FALLS_SHORT.get(name, LEAST)
    documented = re.search(rf"^ +{re.escape(name)} +(\d+) +(\d+) +(\d+) +(\d+)$", intervals.__doc__ or "", re.MULTILINE)
    assert documented is not None, "the docstring has the row"
    # To a percent: draws may fall otherwise with another version of the generator.
    assert int(documented[1 + RECORDINGS.index(recordings)]) == pytest.approx(100 * found, abs=1.5)


@pytest.mark.parametrize("recordings", RECORDINGS)
def test_methods_that_differ_by_chance_alone_are_told_apart_in_at_most_one_case_of_twenty(recordings: int) -> None:
    draw, told = np.random.default_rng(recordings), 0
    for _ in range(DRAWS):
        below, rate = sizes(draw, recordings), rates(draw, recordings, 0.6, 0.15)
        one, other = (1 / (1 + (1 - rate) / rate * np.exp(draw.normal(0, 0.3, recordings))) for _ in range(2))
        change = paired_change(
            pd.DataFrame({"numerator_before": below * one, "denominator_before": below,
                          "numerator_after": below * other, "denominator_after": below})
        )  # fmt: skip
        assert change.p_value is not None
        assert change.ci95 is not None
        assert (change.p_value < 0.05) == (not change.ci95[0] <= 0 <= change.ci95[1])
        told += change.p_value < 0.05
    assert told / DRAWS <= 0.055


def main() -> None:
    width = max(map(len, SCENARIOS))
    for name, scenario in SCENARIOS.items():
        held = "".join(f"{100 * covered(scenario, n):7.1f}" for n in RECORDINGS)
        sys.stdout.write(f"{name.ljust(width)}{held}\n")


if __name__ == "__main__":
    main()
