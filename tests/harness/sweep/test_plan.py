"""What can be swept, and which values are taken."""

from dataclasses import replace

import pytest

from bench.errors import BenchError, UsageError
from bench.evaluation import load_protocol
from bench.harness.sweep import SWEEPS, Injection, Trial, plan_sweep
from bench.methods import build_method

BASE = Trial(method=build_method("spherical"), protocol=load_protocol("paper-v1"))


@pytest.mark.parametrize("what", SWEEPS)
def test_every_sweep_has_distinct_trials_and_its_operating_value(what):
    plan = plan_sweep(what, base=BASE)
    assert plan.operating in plan.values
    assert plan.trials[plan.values.index(plan.operating)] is BASE
    for index, trial in enumerate(plan.trials):
        assert [trial == other for other in plan.trials].count(True) == 1, plan.values[index]
        part = plan.sweep.part
        assert trial.method == BASE.method or part == "method"
        assert trial.protocol.digest == BASE.protocol.digest or part == "reference"
        assert trial.injection == Injection() or part == "input"


@pytest.mark.parametrize("what", SWEEPS)
def test_the_operating_value_changes_nothing(what):
    """What a sweep calls the operating value is what its own change gives."""
    sweep = SWEEPS[what]
    changed = sweep.change(BASE, sweep.operating(BASE))
    assert (changed.method, changed.injection) == (BASE.method, BASE.injection) or what.startswith("flow.")
    kept = changed.protocol.reference.model_dump() == BASE.protocol.reference.model_dump()
    assert kept or what == "concave_ratio"  # there 1 is the convex hull by another name


def test_values_are_sorted_once_each_with_the_operating_one():
    plan = plan_sweep("threshold", base=BASE, values=["1e-3", "2e-4", "1e-3"])
    assert plan.values == (2e-4, 6e-4, 1e-3)
    assert [trial.method.threshold for trial in plan.trials] == [2e-4, 6e-4, 1e-3]


def test_names_keep_their_order_and_the_operating_one_is_first():
    plan = plan_sweep("ablation", base=BASE, values=["only epipolar", "without anti_parallel"])
    assert plan.values == ("all", "only epipolar", "without anti_parallel")
    assert plan.trials[1].method.weights.as_tuple() == (1.0, 0.0, 0.0, 0.0, 0.0)
    assert plan.trials[2].method.weights.as_tuple() == (1.0, 1.0, 0.2, 0.0, 0.0)


def test_a_changed_method_keeps_its_own_operating_value():
    base = replace(BASE, method=build_method("spherical", {"flow": "dis", "threshold": 1e-3}))
    assert plan_sweep("threshold", base=base, values=["2e-3"]).values == (1e-3, 2e-3)
    assert plan_sweep("flow", base=base).operating == "dis:medium"
    assert plan_sweep("flow", base=base, values=["farneback"]).trials[1].method.flow == "farneback"
    tuned = replace(BASE, method=build_method("spherical", {"flow_parameters": {"window_px": 21}}))
    plan = plan_sweep("flow", base=tuned, values=["farneback"])
    assert plan.values == ("farneback as set", "farneback")
    assert plan.trials[1].method.flow_parameters == {}


def test_rules_have_their_own_digest():
    plan = plan_sweep("min_points", base=BASE, values=["3"])
    assert len({trial.protocol.digest for trial in plan.trials}) == 2
    assert plan.trials[0].protocol.reference_settings().min_points == 3


@pytest.mark.parametrize(
    ("what", "values", "message"),
    [
        ("treshold", [], "did you mean 'threshold'"),
        ("threshold", ["abc"], "expected a number (threshold"),
        ("threshold", ["nan"], "expected a number (threshold"),
        ("threshold", ["0"], "thresholds > 0"),
        ("cell_size_px", ["2.5"], "expected a whole number of at least 1"),
        ("flow.window_px", ["0"], "expected a whole number of at least 1"),
        ("weights.epipolar", ["-1"], "expected a number of at least 0"),
        ("error.image_noise", ["-1"], "expected a number of at least 0"),
        ("concave_ratio", ["2"], "reference.concave_ratio"),
        ("polygon_kind", ["box"], "known are concave, convex"),
        ("ablation", ["only three_view"], "unknown value 'only three_view'"),
        ("flow", ["raft"], "known are dis:fast"),
    ],
)
def test_mistakes_are_told(what, values, message):
    with pytest.raises(BenchError) as told:
        plan_sweep(what, base=BASE, values=values)
    assert message in str(told.value)


def test_parameters_of_the_spherical_method_are_not_those_of_another():
    other = replace(BASE, method=build_method("nothing"))
    with pytest.raises(UsageError, match="changes the method 'spherical', got 'nothing'"):
        plan_sweep("threshold", base=other)
    with pytest.raises(UsageError, match="of the flow 'farneback', got 'dis'"):
        plan_sweep("flow.levels", base=replace(BASE, method=build_method("spherical", {"flow": "dis"})))
    assert len(plan_sweep("error.speed", base=other).trials) == 9
