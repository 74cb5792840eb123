"""The paper's method on exact flow: better than on estimated flow, and not as good as the exact masks."""

from pathlib import Path

import pytest

from bench.errors import DataError, UsageError
from bench.evaluation.protocol import load_protocol
from bench.harness.exact import build_scorable
from bench.harness.frames import FramePipeline
from bench.recordings import load_card, open_dataset
from tests.support.runs import run_one

PLACE = "benchmarks.exact_flow:SphericalOnExactFlow"


def exact_flow(scenario: Path, **settings: object):
    return build_scorable(PLACE, {"scenario": str(scenario), **settings})


@pytest.mark.slow
def test_what_is_left_of_the_errors_is_the_methods_own(tiny_card, tmp_path):
    methods = {name: build_scorable(name) for name in ("spherical", "truth")}
    methods["exact-flow"] = exact_flow(tiny_card.with_name("tiny.scenario.yaml"))
    found = {
        name: run_one(
            card=load_card(tiny_card), method=method, protocol=load_protocol("surface-v1"), out=tmp_path / name
        )
        for name, method in methods.items()
    }
    iou = {name: run.all_moving.iou.value for name, run in found.items()}
    assert iou["spherical"] < iou["exact-flow"] < iou["truth"]
    assert found["exact-flow"].false_positives.coverage.value < found["spherical"].false_positives.coverage.value


def test_it_is_marked_as_one_that_sees_the_truth(tiny_card):
    scenario = tiny_card.with_name("tiny.scenario.yaml")
    assert exact_flow(scenario).settings()["sees_the_truth"] is True
    with pytest.raises(UsageError, match="it sees the true scene and nothing else"):
        exact_flow(scenario, sees_the_truth=False)


def test_a_scenario_of_other_recordings_is_refused(tiny_card):
    (recording, *_) = (handle.open() for handle in open_dataset(load_card(tiny_card)))
    method = exact_flow(Path(__file__).parents[2] / "datasets" / "demo.scenario.yaml")
    pipeline = FramePipeline(recording, "front", method=method)
    with pytest.raises(DataError, match="expected the recording and camera of the image, got none of"):
        method.segment(pipeline.method_input(1))
