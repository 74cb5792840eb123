"""Each constraint alone, and the constraints on tracks."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from bench.geometry import RigidTransform
from bench.methods import build_method
from bench.methods.spherical.likelihood import CONSTRAINTS, PAPER_WEIGHTS
from tests.support.board_scene import HEIGHT, LOOK, MOUNT_M, STEP, WIDTH, crossing, far, frame, inner, render, share

SINGLE = {name: f"{name.replace('_', '-')}-only" for name in CONSTRAINTS}


def test_a_constraint_alone_marks_what_it_marks_alone_among_the_others():
    given = frame(*crossing()[:2], STEP)
    whole = build_method("spherical").segment(given)
    union = np.zeros_like(whole.mask)
    for name, method in SINGLE.items():
        found = build_method(method).segment(given)
        deviation = whole.parts[name] * (whole.likelihood > 0)
        certain = np.abs(getattr(PAPER_WEIGHTS, name) * deviation / 2.4 - 6e-4) > 1e-9
        expected = getattr(PAPER_WEIGHTS, name) * deviation / 2.4 > 6e-4
        np.testing.assert_array_equal(found.mask[certain], expected[certain])
        assert set(np.unique(found.cause[found.mask])) <= {CONSTRAINTS.index(name)}
        np.testing.assert_allclose(found.likelihood, deviation, atol=1e-7)
        union |= found.mask
    assert union.sum() > 100
    assert not (union & ~whole.mask).any()


def test_weights_of_a_single_constraint_are_changed_from_its_own():
    method = build_method("epipolar-only", {"weights": {"positive_depth": 0.5}})
    assert method.weights.as_tuple() == (1.0, 0.5, 0.0, 0.0, 0.0)
    assert build_method("spherical", {"weights": {"positive_depth": 0.5}}).weights.as_tuple()[2:] == (0.2, 0.2, 0.0)


def three_images(positions, steps=(0.0, 0.06, 0.12)):
    """Three images of a board at positions, seen from a camera that goes straight on, with what a method is given."""
    images = [render(np.array([s, 0.0, 0.0]), np.asarray(p)) for s, p in zip(steps, positions, strict=True)]
    poses = [RigidTransform(LOOK, -LOOK @ (MOUNT_M + np.array([s, 0.0, 0.0]))) for s in steps]
    motions = tuple(after @ before.inverse() for before, after in pairwise(poses))
    given = replace(
        frame(images[1][0], images[2][0], STEP),
        images=tuple(image for image, _ in images),
        timestamps_ns=(0, 66_666_667, 133_333_334),
        current_from_previous=motions,
    )
    return given, images[2][1]


def test_tracks_find_a_crossing_board_and_leave_the_world_alone():
    given, board = three_images([(3.0, -0.9, 0.0), (3.0, -0.6, 0.0), (3.0, -0.3, 0.0)])
    found = build_method("spherical-sparse").segment(given)
    mask = found.mask_at(WIDTH, HEIGHT)
    assert share(mask, inner(board)) > 0.8
    assert share(mask, far(board)) < 0.08
    assert found.causes == (*CONSTRAINTS, "three_view")


def test_cells_without_a_track_are_undefined_and_static():
    given, _ = three_images([(3.0, -0.9, 0.0), (3.0, -0.6, 0.0), (3.0, -0.3, 0.0)])
    few = build_method("spherical-sparse", {"tracker": {"corners": 20, "window_px": 11}}).segment(given)
    # 11 x 11 px hold the centres of at most 3 x 3 cells of 5 px.
    assert 0 < (~few.undefined).sum() <= 20 * 9
    assert not few.mask[few.undefined].any()
    assert few.likelihood[few.undefined].max() == 0


def test_three_views_see_a_board_that_turns_back_where_two_see_it_less():
    positions = [(3.0, -0.3, 0.0), (3.12, -0.3, 0.0), (3.0, -0.3, 0.0)]
    given, board = three_images(positions)
    three = build_method("three-view-only")
    assert share(three.segment(given).mask_at(WIDTH, HEIGHT), inner(board)) > 0.5
    assert share(three.segment(given).mask_at(WIDTH, HEIGHT), far(board)) < 0.08
    two = replace(
        given, images=given.images[1:], timestamps_ns=(0, 1), current_from_previous=given.current_from_previous[1:]
    )
    assert not three.segment(two).mask.any()
    still, _ = three_images([(3.0, -0.3, 0.0)] * 3)
    assert share(three.segment(still).mask_at(WIDTH, HEIGHT), inner(board)) < 0.1


def test_a_stationary_camera_takes_the_static_branch_on_tracks_too():
    given, board = three_images([(3.0, -0.9, 0.0), (3.0, -0.6, 0.0), (3.0, -0.3, 0.0)], steps=(0.0, 0.0, 0.0))
    found = build_method("spherical-sparse").segment(given)
    assert found.causes == ("static_camera",)
    assert share(found.mask_at(WIDTH, HEIGHT), inner(board)) > 0.8
    assert share(found.mask_at(WIDTH, HEIGHT), far(board)) < 0.02


def test_an_image_without_corners_is_undefined():
    flat = np.full((HEIGHT, WIDTH), 90, np.uint8)
    found = build_method("spherical-sparse").segment(frame(flat, flat, STEP))
    assert found.undefined.all()
    assert not found.mask.any()


@pytest.mark.parametrize("name", ["spherical-sparse", "three-view-only"])
def test_the_threshold_keeps_the_papers_sum_of_deviations(name):
    method = build_method(name)
    sum_at_threshold = method.threshold * method.weights.total
    weight = {"spherical-sparse": 1.0, "three-view-only": 3**-0.5}[name]
    assert sum_at_threshold == pytest.approx(6e-4 * 2.4 / weight)
