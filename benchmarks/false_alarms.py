"""Share of gates that fail a method that is the same but for noise, and one that has lost points, by simulation.

python -m benchmarks.false_alarms writes the table into docs/gate.md (ten minutes). Recordings are drawn with
replacement from those of the demo's baseline, and each grows or shrinks by a log-normal factor (sigma 0.8, two in three
between 0.45 and 2.2), so that they differ in size as drives do. A network that is trained again moves each metric of a
recording on the logit scale by `NOISE`, half of whose variance all metrics of the recording share, the other half each
row has for itself. Baseline and run both have noise of their own; the run of a method that has lost x points loses them
in each headline, on average alike in all recordings.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import expit, logit

from bench.evaluation.comparison import CASES, SLICE, compare_pairs
from bench.evaluation.definitions import COUNTS, find_metric
from bench.evaluation.sums import read_sums
from bench.gate.judge import judge_changes
from bench.gate.tolerances import Tolerances, load_tolerances
from bench.gate.verdict import Outcome

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs" / "gate.md"
MARKERS = "<!-- written by python -m benchmarks.false_alarms -->", "<!-- end -->"
RECORDINGS = (12, 20, 50)
LOSSES = (0.01, 0.03, 0.05)
NOISE = 0.3  # 5 points of a recording's metric at 80 %
DRAWS = 200  # with a loss; twice as many without
SIZE_SIGMA, SHARED = 0.8, 0.5
LEAST = 0.005  # of a ratio: one of exactly 0 or 1 would have no noise
Terms = NDArray[np.float64]  # (rows, recordings)


class Drawn:
    """Runs over recordings that are like those of a table of sums.

    Args:
        sums: of a run.
        rules: whose rows that decide are drawn; the others have no part in the verdict.
    """

    def __init__(self, sums: pd.DataFrame, *, rules: Tolerances) -> None:
        known = sums[~sums["metric"].isin(COUNTS)]
        wide = known.set_index([*SLICE, "recording"])[["numerator", "denominator"]].unstack(fill_value=0.0)  # noqa: PD010
        keys = [key for key in wide.index if self._decides(key, rules)]
        self.above, self.below = (wide.loc[keys, term].to_numpy() for term in ("numerator", "denominator"))
        self.keys, self.rules = keys, rules
        self.better = np.array([[find_metric(key[2]).improvement(1.0)] for key in keys])

    @staticmethod
    def _decides(key: tuple[str, str, str], rules: Tolerances) -> bool:
        breakdown, name, metric = key
        if breakdown not in {"category", "all_moving", "frames"} or find_metric(metric).higher_is_better is None:
            return False
        rule = rules.tolerance(name, metric)
        return rule is not None and rule.decides

    def pairs(self, draw: np.random.Generator, recordings: int, *, loss: float) -> pd.DataFrame:
        """Sums of a baseline and of a run that has lost so much, side by side."""
        chosen = draw.integers(0, self.below.shape[1], recordings)
        below = self.below[:, chosen] * np.exp(draw.normal(0, SIZE_SIGMA, recordings))
        with np.errstate(invalid="ignore"):
            truth = np.clip(self.above[:, chosen] / self.below[:, chosen], LEAST, 1 - LEAST)
        truth = np.where(below > 0, truth, 0.5)
        before, after = (self._scored(draw, truth, loss=lost) * below for lost in (0.0, loss))
        keys = pd.MultiIndex.from_tuples(self.keys, names=SLICE).repeat(recordings).to_frame(index=False)
        terms = {"numerator_before": before, "numerator_after": after} | dict.fromkeys(CASES, below)
        table = keys.assign(**{name: of_rows.ravel() for name, of_rows in terms.items()})
        return table[table[CASES[0]] > 0]

    def _scored(self, draw: np.random.Generator, truth: Terms, *, loss: float) -> Terms:
        shared = self.better * draw.normal(0, np.sqrt(SHARED) * NOISE, truth.shape[1])
        moved = logit(truth) + shared + draw.normal(0, np.sqrt(1 - SHARED) * NOISE, truth.shape)
        return np.clip(expit(moved) - self.better * loss, 0.0, 1.0)

    def fails(self, draw: np.random.Generator, recordings: int, *, loss: float) -> tuple[bool, bool]:
        """True where a row fails, and where one would if none were corrected for the number of rows."""
        changes = compare_pairs(self.pairs(draw, recordings, loss=loss))
        rows = judge_changes(changes, tolerances=self.rules, worst={})
        failed = any(row.outcome is Outcome.FAILED for row in rows)
        suspect = [row for row in rows if row.outcome is Outcome.SUSPECT]
        return failed, failed or any(row.p_value is not None and row.p_value < 0.05 for row in suspect)


def shares(drawn: Drawn, recordings: int, *, loss: float, draws: int) -> tuple[float, float]:
    """Share of simulated runs that fail, and that would fail uncorrected; the same for the same arguments."""
    draw = np.random.default_rng(recordings)
    found = [drawn.fails(draw, recordings, loss=loss) for _ in range(draws)]
    failed, uncorrected = np.mean(found, axis=0)
    return float(failed), float(uncorrected)


def simulate(*, baseline: str = "demo", draws: int = DRAWS) -> Iterator[str]:
    """Lines of the table: percent of runs that fail."""
    drawn = Drawn(read_sums(ROOT / "reports" / "baselines" / baseline / "sums.csv"), rules=load_tolerances())
    yield "| recordings | the same but for noise | so, without Holm | 1 point lost | 3 points | 5 points |"
    yield "|---|---|---|---|---|---|"
    for recordings in RECORDINGS:
        same = shares(drawn, recordings, loss=0.0, draws=2 * draws)
        lost = [shares(drawn, recordings, loss=loss, draws=draws)[0] for loss in LOSSES]
        alarms = " | ".join(f"{100 * share:.1f} %" for share in same)
        yield f"| {recordings} | {alarms} | {' | '.join(f'{100 * share:.0f} %' for share in lost)} |"


def with_table(text: str, lines: list[str], markers: tuple[str, str] = MARKERS) -> str:
    """The text with its table between the markers replaced."""
    start, end = map(re.escape, markers)
    return re.sub(f"{start}.*?{end}", "\n".join([markers[0], "", *lines, "", markers[1]]), text, flags=re.DOTALL)


if __name__ == "__main__":
    table = list(simulate())
    DOCS.write_text(with_table(DOCS.read_text("utf-8"), table), "utf-8")
