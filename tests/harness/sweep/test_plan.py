"""What can be swept, and which values are taken."""

from dataclasses import replace

import pytest

from bench.errors import BenchError, UsageError
from bench.evaluation import load_protocol
from bench.harness.sweep import SWEEPS, Setup, plan_sweep
from bench.methods import build_method
from bench.recordings import NO_INPUT_ERRORS

BASE = Setup(method=build_method("spherical"), protocol=load_protocol("paper-v1"))


@pytest.mark.parametrize("what", SWEEPS)
def test_every_sweep_has_distinct_setups_and_its_operating_value(what):
    plan = plan_sweep(what, base=BASE)
    assert plan.operating in plan.values
    assert plan.setups[plan.values.index(plan.operating)] is BASE
    for index, setup in enumerate(plan.setups):
        assert [setup == other for other in plan.setups].count(True) == 1, plan.values[index]
        part = plan.sweep.part
        assert setup.method == BASE.method or part == "method"
        assert setup.protocol.digest == BASE.protocol.digest or part == "reference"
        assert setup.input_errors == NO_INPUT_ERRORS or part == "input"


@pytest.mark.parametrize("what", SWEEPS)
def test_the_operating_value_changes_nothing(what):
    """What a sweep calls the operating value is what its own change gives."""
    sweep = SWEEPS[what]
    changed = sweep.change(BASE, sweep.operating(BASE))
    assert (changed.method, changed.input_errors) == (BASE.method, BASE.input_errors) or what.startswith("flow.")
    kept = changed.protocol.reference.model_dump() == BASE.protocol.reference.model_dump()
    assert kept or what == "concave_ratio"  # there 1 is the convex hull by another name


def test_values_are_sorted_once_each_with_the_operating_one():
    plan = plan_sweep("threshold", base=BASE, values=["1e-3", "2e-4", "1e-3"])
    assert plan.values == (2e-4, 6e-4, 1e-3)
    assert [setup.method.threshold for setup in plan.setups] == [2e-4, 6e-4, 1e-3]


def test_names_keep_their_order_and_the_operating_one_is_first():
    plan = plan_sweep("ablation", base=BASE, values=["only epipolar", "without anti_parallel"])
    assert plan.values == ("all", "only epipolar", "without anti_parallel")
    assert plan.setups[1].method.weights.as_tuple() == (1.0, 0.0, 0.0, 0.0, 0.0)
    assert plan.setups[2].method.weights.as_tuple() == (1.0, 1.0, 0.2, 0.0, 0.0)


def test_a_changed_method_keeps_its_own_operating_value():
    base = replace(BASE, method=build_method("spherical", {"flow": "dis", "threshold": 1e-3}))
    assert plan_sweep("threshold", base=base, values=["2e-3"]).values == (1e-3, 2e-3)
    assert plan_sweep("flow", base=base).operating == "dis:medium"
    assert plan_sweep("flow", base=base, values=["farneback"]).setups[1].method.flow == "farneback"
    tuned = replace(BASE, method=build_method("spherical", {"flow_parameters": {"window_px": 21}}))
    plan = plan_sweep("flow", base=tuned, values=["farneback"])
    assert plan.values == ("farneback as set", "farneback")
    assert plan.setups[1].method.flow_parameters == {}


def test_rules_have_their_own_digest():
    plan = plan_sweep("min_points", base=BASE, values=["3"])
    assert len({setup.protocol.digest for setup in plan.setups}) == 2
    assert plan.setups[0].protocol.reference_settings().min_points == 3


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


def test_a_parameter_can_be_swept_for_every_method_that_has_it():
    other = replace(BASE, method=build_method("nothing"))
    with pytest.raises(UsageError, match="expected a method with the parameter 'threshold', got 'nothing'"):
        plan_sweep("threshold", base=other)
    assert len(plan_sweep("threshold", base=replace(BASE, method=build_method("flow-magnitude"))).setups) > 5
    with pytest.raises(UsageError, match="expected a method with the parameter 'weights', got 'flow-magnitude'"):
        plan_sweep("ablation", base=replace(BASE, method=build_method("flow-magnitude")))
    with pytest.raises(UsageError, match="expected a method with the flow 'farneback', got 'dis'"):
        plan_sweep("flow.levels", base=replace(BASE, method=build_method("spherical", {"flow": "dis"})))
    assert len(plan_sweep("error.speed", base=other).setups) == 9


def test_each_value_has_a_folder_of_its_own_that_any_file_system_takes(tmp_path):
    for what in SWEEPS:
        plan = plan_sweep(what, base=BASE)
        folders = [plan.folder(value, tmp_path) for value in plan.values]
        assert len({folder.name.lower() for folder in folders}) == len(plan.values)
        assert all(folder.parent == tmp_path for folder in folders)
    plan = plan_sweep("threshold", base=BASE, values=["0.001", "0.00100000001"])
    assert [plan.folder(value, tmp_path).name for value in plan.values] == ["0.0006", "0.001", "0.00100000001"]
    assert plan_sweep("flow", base=BASE).folder("dis:fast", tmp_path).name == "dis_fast"
