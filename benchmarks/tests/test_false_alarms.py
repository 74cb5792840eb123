"""A method that is the same but for noise seldom fails, by the simulation whose table docs/gate.md has."""

import pytest

from bench.evaluation.sums import read_sums
from bench.gate.tolerances import load_tolerances
from benchmarks import false_alarms

pytestmark = pytest.mark.slow


def test_noise_fails_in_at_most_one_of_twenty_runs_and_a_clear_loss_mostly():
    sums = read_sums(false_alarms.ROOT / "reports" / "baselines" / "demo" / "sums.csv")
    drawn = false_alarms.Drawn(sums, rules=load_tolerances())
    same, uncorrected = false_alarms.shares(drawn, 20, loss=0.0, draws=80)
    assert same <= 0.05
    assert uncorrected >= same
    assert false_alarms.shares(drawn, 20, loss=0.05, draws=20)[0] >= 0.75


def test_the_table_stands_between_its_markers():
    start, end = false_alarms.MARKERS
    assert false_alarms.with_table(f"a\n{start}\nold\n{end}\nb", ["new"]) == f"a\n{start}\n\nnew\n\n{end}\nb"
    assert false_alarms.with_table(false_alarms.DOCS.read_text("utf-8"), ["| new |"]).count("| new |") == 1
