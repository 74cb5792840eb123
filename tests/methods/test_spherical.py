"""The paper's method on images, each constraint alone, on tracks, and with motion from the images themselves."""

from dataclasses import astuple, replace

import numpy as np
import pytest

from bench.cameras.model import ray_grid
from bench.errors import UsageError
from bench.geometry import RigidTransform
from bench.methods import build_method
from bench.methods.spherical.likelihood import CONSTRAINTS, PAPER_WEIGHTS
from bench.methods.spherical.method import SphericalMethod
from tests.support import board_scene
from tests.support.board_scene import CAMERA, HEIGHT, STEP, WIDTH, crossing, drive, far, frame, inner

SPARSE, ODOMETRY = "spherical-sparse", "spherical-visual-odometry"
NOT_KNOWN = RigidTransform.identity()


def three_images(board_m=(3.0, -0.9, 0.0), sideways_m=0.3, step=STEP):
    """Three images of a board that crosses, and the board in the last of them."""
    given, boards = drive(range(3), board_m, sideways_m, step)
    return given, boards[-1]


def marked(found, board):
    """Shares of the board and of what lies far from it."""
    mask = found.mask_at(WIDTH, HEIGHT)
    return mask[inner(board)].mean(), mask[far(board)].mean()


@pytest.mark.parametrize(
    ("name", "settings", "least"),
    [("spherical", {}, 0.9), ("spherical", {"flow": "dis"}, 0.9), (SPARSE, {}, 0.8), (ODOMETRY, {}, 0.9)],
)
def test_a_crossing_board_is_found_where_it_is_now_and_the_world_is_static(name, settings, least):
    given, board = three_images()
    if name == ODOMETRY:
        given = replace(given, current_from_previous=(NOT_KNOWN, NOT_KNOWN))
    on_board, elsewhere = marked(build_method(name, settings).segment(given), board)
    assert on_board > least
    assert elsewhere < 0.08


@pytest.mark.parametrize(("name", "least"), [("spherical", 0.9), (SPARSE, 0.8), (ODOMETRY, 0.9)])
def test_a_stationary_camera_takes_the_static_branch(name, least):
    given, board = three_images(step=np.zeros(3))
    if name == ODOMETRY:  # whatever the wheels say
        given = replace(given, current_from_previous=2 * crossing()[0].current_from_previous)
    found = build_method(name).segment(given)
    assert found.causes == ("static_camera",)
    on_board, elsewhere = marked(found, board)
    assert on_board > least
    assert elsewhere < 0.02


@pytest.mark.parametrize("name", ["spherical", SPARSE, ODOMETRY])
def test_a_camera_that_never_counts_as_stationary_is_refused_before_any_image(name):
    with pytest.raises(UsageError, match=f"{name}: expected .* for static_below_m, got 0.0"):
        build_method(name, {"static_below_m": 0.0})


@pytest.mark.parametrize("name", [SPARSE, ODOMETRY])
def test_images_that_show_nothing_are_undefined(name):
    flat = np.full((HEIGHT, WIDTH), 90, np.uint8)
    found = build_method(name).segment(frame(flat, flat, STEP))
    assert found.undefined.all()
    assert not found.mask.any()
    assert found.likelihood.max() == 0


class ExactFlow(SphericalMethod):
    """The method with the flow that the scene really has."""

    def mean_flow(self, frame):  # noqa: ARG002 - it knows the scene
        before, now = np.array([3.0, -0.6, 0.0]), np.array([3.0, -0.3, 0.0])
        hit, _, board = board_scene.scene(STEP, now)
        was = np.where(board[..., None], hit - (now - before), hit)[2::5, 2::5]
        pixels, _ = CAMERA.project(board_scene.camera_from_world(np.zeros(3)).apply(was.reshape(-1, 3)))
        cells = ray_grid(CAMERA, 5)
        return (pixels.reshape(cells.pixels.shape) - cells.pixels).astype(np.float32)


def test_with_exact_flow_the_mask_is_the_board_in_the_current_image():
    given, board = crossing()
    method = ExactFlow(weights={"anti_parallel": 0.0})  # which fires on the wall below camera height, by design
    found = method.segment(given)
    expected = board[2::5, 2::5] & ~found.undefined
    np.testing.assert_array_equal(found.mask, expected)
    assert expected.sum() > 100


@pytest.mark.parametrize("name", ["spherical", "flow-magnitude"])
def test_where_the_ego_vehicle_sees_itself_nothing_is_detected(name):
    valid = np.ones((HEIGHT, WIDTH), bool)
    valid[:, 200:] = False
    found = build_method(name).segment(replace(crossing()[0], valid=valid))
    assert not found.mask[:, 40:].any()
    assert found.undefined[:, 40:].all()
    assert found.likelihood[:, 40:].max() == 0


def test_parameters_from_a_file():
    method = build_method("spherical", {"weights": {"anti_parallel": 0.0}, "variants": {"geodesic": True}})
    assert method.settings()["weights"]["anti_parallel"] == 0.0
    changed = build_method("spherical", {"weights": {"positive_depth": 0.5}})
    assert changed.weights == replace(PAPER_WEIGHTS, positive_depth=0.5)
    alone = build_method("epipolar-only", {"weights": {"positive_depth": 0.5}})  # its own are changed
    assert astuple(alone.weights) == (1.0, 0.5, 0.0, 0.0, 0.0)


def test_a_constraint_alone_marks_what_it_marks_alone_among_the_others():
    given = crossing()[0]
    whole = build_method("spherical").segment(given)
    union = np.zeros_like(whole.mask)
    for name in CONSTRAINTS:
        found = build_method(f"{name.replace('_', '-')}-only").segment(given)
        deviation = whole.parts[name] * (whole.likelihood > 0)
        certain = np.abs(getattr(PAPER_WEIGHTS, name) * deviation / 2.4 - 6e-4) > 1e-9
        expected = getattr(PAPER_WEIGHTS, name) * deviation / 2.4 > 6e-4
        np.testing.assert_array_equal(found.mask[certain], expected[certain])
        assert set(np.unique(found.cause[found.mask])) <= {CONSTRAINTS.index(name)}
        np.testing.assert_allclose(found.likelihood, deviation, atol=1e-7)
        union |= found.mask
    assert union.sum() > 100
    assert not (union & ~whole.mask).any()


def test_cells_without_a_track_are_undefined_and_static():
    few = build_method(SPARSE, {"tracker": {"corners": 20, "window_px": 11}}).segment(three_images()[0])
    assert few.causes == (*CONSTRAINTS, "three_view")
    # 11 x 11 px hold the centres of at most 3 x 3 cells of 5 px.
    assert 0 < (~few.undefined).sum() <= 20 * 9
    assert not few.mask[few.undefined].any()
    assert few.likelihood[few.undefined].max() == 0


def test_what_three_views_alone_see_is_defined():
    found = build_method(SPARSE, {"min_epipole_sine": 0.3}).segment(three_images()[0])
    assert not found.mask[found.undefined].any()
    assert found.likelihood[found.undefined].max() == 0
    assert (found.likelihood * (found.parts["three_view"] > 0)).max() > 0


def test_three_views_see_a_board_that_turns_back_where_two_see_it_less():
    still, board = three_images((3.0, -0.3, 0.0), 0.0)
    away, _ = three_images((3.12, -0.3, 0.0), 0.0)
    given = replace(still, images=(still.images[0], away.images[1], still.images[2]))
    three = build_method("three-view-only")
    on_board, elsewhere = marked(three.segment(given), board)
    assert on_board > 0.5
    assert elsewhere < 0.08
    two = replace(
        given, images=given.images[1:], timestamps_ns=(0, 1), current_from_previous=given.current_from_previous[1:]
    )
    assert not three.segment(two).mask.any()
    assert marked(three.segment(still), board)[0] < 0.1


@pytest.mark.parametrize(("name", "weight"), [(SPARSE, 1.0), ("three-view-only", 3**-0.5)])
def test_the_threshold_keeps_the_papers_sum_of_deviations(name, weight):
    method = build_method(name)
    assert method.threshold * method.weights.total == pytest.approx(6e-4 * 2.4 / weight)


def test_the_motion_is_the_cameras():
    given = crossing()[0]
    true = given.current_from_previous[0]
    found = build_method(ODOMETRY).motion(replace(given, current_from_previous=(NOT_KNOWN,)))
    assert np.linalg.norm(found.translation_m) == pytest.approx(1.0)
    assert found.translation_m @ true.translation_m / np.linalg.norm(true.translation_m) > np.cos(np.radians(2))
    assert np.abs(found.rotation - true.rotation).max() < np.radians(0.1)
    scaled = build_method(ODOMETRY, {"scale": "given"}).motion(given)
    assert np.linalg.norm(scaled.translation_m) == pytest.approx(0.06)


def test_a_given_scale_runs_all_constraints_with_the_papers_weights():
    paper = build_method("spherical").settings()

    def settings(**parameters):
        found = build_method(ODOMETRY, parameters).settings()
        return found["weights"], found["threshold"]

    free = {"positive_height": 0.0, "anti_parallel": 0.0}
    assert settings() == (paper["weights"] | free, pytest.approx(6e-4 * 2.4 / 2.0))
    assert settings(scale="given") == (paper["weights"], paper["threshold"])
    assert settings(scale="given", weights=free)[0] == paper["weights"] | free
    heavier = settings(scale="given", weights={"positive_height": 0.3}, threshold=1e-3)
    assert heavier == (paper["weights"] | {"positive_height": 0.3}, 1e-3)
    none, given = (build_method(ODOMETRY, {"scale": name}).segment(crossing()[0]) for name in ("none", "given"))
    assert none.parts.keys() == {"flow_u", "flow_v", "epipolar", "positive_depth"}
    assert given.parts.keys() == none.parts.keys() | {"positive_height", "anti_parallel"}
    assert not np.array_equal(none.likelihood, given.likelihood)
    assert marked(given, crossing()[1])[0] > 0.8
