"""What `make perf` compares with does the same work; no time is asserted here."""

import cv2
import numpy as np
import pytest

from bench.cameras import KannalaBrandtCamera
from bench.evaluation import load_protocol
from bench.flow import DisFlow
from bench.harness.frames import FramePipeline
from bench.methods import build_method
from bench.recordings import load_card, open_dataset
from benchmarks import masks, parallel, projections, references
from benchmarks.enlarged import enlarge
from benchmarks.stages import measure
from benchmarks.turns import best_seconds
from tests.support.lenses import LENSES

PAPER = load_protocol("paper-v1")


@pytest.fixture(scope="module")
def scored(tiny_card):
    """Reference and mask of some images."""
    found, method = [], build_method("spherical", {})
    for handle in open_dataset(load_card(str(tiny_card))):
        pipeline = FramePipeline(handle.open(), "front", method=method, protocol=PAPER)
        for index in (2, 4):
            done = pipeline.process(index)
            found.append((done.reference, done.segmentation.mask_at(320, 240)))
    return found


def test_overlaps_are_those_of_pycocotools(scored):
    assert any((masks.iou_of_all(*one) > 0).any() for one in scored)
    assert set(masks.milliseconds(scored, rounds=1)) > {"the same by pycocotools"}


def test_a_wrong_overlap_is_found_out(scored, monkeypatch):
    monkeypatch.setattr(masks, "iou_of_all", lambda *one: masks.iou_by_pycocotools(*one) + 1e-6)
    with pytest.raises(AssertionError, match="the same overlaps"):
        masks.milliseconds(scored, rounds=1)


def test_the_loop_and_opencv_project_to_the_same_pixels():
    camera = LENSES["kannala_brandt"]
    assert isinstance(camera, KannalaBrandtCamera)
    points = projections.points_in_view(camera)[:500]
    matrix = np.diag([*camera.focal, 1.0])
    matrix[:2, 2] = camera.principal_point
    by_cv2 = cv2.fisheye.projectPoints(
        points[:, None], np.zeros((3, 1)), np.zeros((3, 1)), matrix, np.array(camera.coefficients)
    )[0][:, 0]
    ours, valid = camera.project(points)
    assert valid.all()
    np.testing.assert_allclose(projections.project_in_a_loop(camera, points), ours, atol=1e-6)
    ahead = points[:, 2] > 1e-3  # OpenCV divides by the depth
    np.testing.assert_allclose(by_cv2[ahead], ours[ahead], atol=1e-6)


def test_works_take_turns():
    order: list[str] = []
    found = best_seconds({"one": lambda: order.append("one"), "other": lambda: order.append("other")}, rounds=2)
    assert order == ["one", "other"] * 3
    assert set(found) == {"one", "other"}


def test_stages_are_timed_beside_any_flow(tiny_card):
    report = measure(
        (handle.open() for handle in open_dataset(load_card(str(tiny_card)))),
        method=build_method("spherical", {"flow": "dis", "flow_parameters": {"preset": "fast"}}),
        protocol=PAPER,
        images=5,
        progress=lambda *_: None,
        flow=DisFlow(preset="fast"),
    )
    assert report.images == 5
    assert {"input", "reference", "method", "counts"} == set(report.stage_ms)
    assert report.ratio > 1.0
    assert sum(report.stage_ms.values()) <= report.total_ms * 1.01


def test_references_are_timed_by_each_protocol(tiny_card):
    opened = (handle.open() for handle in open_dataset(load_card(str(tiny_card))))
    found = references.milliseconds(opened, ("paper-v1", "surface-v1"))
    assert all(found[name] > 0.0 for name in ("paper-v1", "surface-v1"))


def test_an_enlarged_drive_opens_and_sees_the_same(tiny_card, tmp_path):
    source = tiny_card.parent / "data" / "tiny" / "crossing"
    card = enlarge([source], tmp_path, width=640, height=486)
    larger = next(iter(open_dataset(load_card(str(card))))).open().cameras["front"]
    smaller = next(h for h in open_dataset(load_card(str(tiny_card))) if h.name == "crossing").open().cameras["front"]
    assert (larger.model.width, larger.model.height) == (640, 486)
    points = np.array([[0.3, 0.2, 1.0], [-2.0, 0.5, 1.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(larger.model.project(points)[0], 2 * smaller.model.project(points)[0] + 0.5)


@pytest.mark.slow
def test_a_run_tells_what_it_cost(tiny_card):
    cost = parallel.run_cost(tiny_card, "--method", "nothing", "--workers", 2)
    assert cost.images == 12
    assert cost.own_cpu_s > 0
    assert cost.workers_cpu_s > 0
    assert 50 < cost.peak_mb < 2000
    assert 0 < parallel.efficiency_of_processor_time(cost, cost, workers=2) < 1
