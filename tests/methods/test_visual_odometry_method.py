"""The method that finds the camera's motion in its images."""

from dataclasses import replace

import numpy as np
import pytest

from bench.errors import UsageError
from bench.geometry import RigidTransform
from bench.methods import build_method
from tests.support.board_scene import HEIGHT, STEP, WIDTH, crossing, far, frame, inner, render, share

NAME = "spherical-visual-odometry"
NOT_KNOWN = (RigidTransform.identity(),)


def test_without_ego_motion_the_crossing_board_is_found():
    previous, current, board = crossing()
    given = replace(frame(previous, current, STEP), current_from_previous=NOT_KNOWN)
    mask = build_method(NAME).segment(given).mask_at(WIDTH, HEIGHT)
    assert share(mask, inner(board)) > 0.9
    assert share(mask, far(board)) < 0.1


def test_the_motion_is_the_cameras():
    given = frame(*crossing()[:2], STEP)
    true = given.current_from_previous[0]
    found = build_method(NAME).motion(replace(given, current_from_previous=NOT_KNOWN))
    assert np.linalg.norm(found.translation_m) == pytest.approx(1.0)
    assert found.translation_m @ true.translation_m / np.linalg.norm(true.translation_m) > np.cos(np.radians(2))
    assert np.abs(found.rotation - true.rotation).max() < np.radians(0.1)
    scaled = build_method(NAME, {"scale": "given"}).motion(given)
    assert np.linalg.norm(scaled.translation_m) == pytest.approx(0.06)


def test_a_stationary_camera_takes_the_static_branch_whatever_the_wheels_say():
    previous, _ = render(np.zeros(3), np.array([3.0, -0.6, 0.0]))
    current, board = render(np.zeros(3), np.array([3.0, -0.3, 0.0]))
    found = build_method(NAME).segment(frame(previous, current, STEP))
    assert found.causes == ("static_camera",)
    assert share(found.mask_at(WIDTH, HEIGHT), inner(board)) > 0.9
    assert share(found.mask_at(WIDTH, HEIGHT), far(board)) < 0.02


def test_images_that_show_nothing_are_undefined():
    flat = np.full((HEIGHT, WIDTH), 90, np.uint8)
    found = build_method(NAME).segment(frame(flat, flat, STEP))
    assert found.undefined.all()
    assert not found.mask.any()
    assert found.likelihood.max() == 0


def test_constraints_that_need_scale_are_refused_without_it():
    with pytest.raises(
        UsageError, match=r"positive_height and anti_parallel need the length of the translation.*scale=given"
    ):
        build_method(NAME, {"weights": {"positive_height": 0.2, "anti_parallel": 0.2}})
    with pytest.raises(UsageError, match=r"set weights\.anti_parallel=0, or"):
        build_method(NAME, {"weights": {"anti_parallel": 0.2}})
    with pytest.raises(UsageError, match="expected 'none' or 'given' for scale, got 'wheel'"):
        build_method(NAME, {"scale": "wheel"})
    shown = {"flow_u", "flow_v", "epipolar", "positive_depth"}
    assert build_method(NAME).segment(frame(*crossing()[:2], STEP)).parts.keys() == shown
    whole = build_method(NAME, {"weights": {"positive_height": 0.2, "anti_parallel": 0.2}, "scale": "given"})
    previous, current, board = crossing()
    assert share(whole.segment(frame(previous, current, STEP)).mask_at(WIDTH, HEIGHT), inner(board)) > 0.8


def test_a_given_scale_runs_all_constraints_with_the_papers_weights():
    without, given = build_method(NAME), build_method(NAME, {"scale": "given"})
    paper = build_method("spherical").settings()
    for name in ("weights", "threshold"):
        assert given.settings()[name] == paper[name]
        assert without.settings()[name] != paper[name]
    assert without.settings()["threshold"] == pytest.approx(6e-4 * 2.4 / 2.0)
    heavier = build_method(NAME, {"scale": "given", "weights": {"positive_height": 0.3}, "threshold": 1e-3}).settings()
    assert heavier["weights"] == paper["weights"] | {"positive_height": 0.3}
    assert heavier["threshold"] == 1e-3
    free = {"positive_height": 0.0, "anti_parallel": 0.0}
    assert build_method(NAME, {"scale": "given", "weights": free}).settings()["weights"] == paper["weights"] | free
    found = {
        name: build_method(NAME, {"scale": name}).segment(frame(*crossing()[:2], STEP)) for name in ("none", "given")
    }
    assert not np.array_equal(found["none"].likelihood, found["given"].likelihood)


def test_the_same_images_give_the_same_answer_whatever_came_before():
    given, method = frame(*crossing()[:2], STEP), build_method(NAME)
    first = method.segment(given)
    method.segment(frame(*(render(np.array([s, 0.1, 0.0]))[0] for s in (0.0, 0.1)), STEP))
    np.testing.assert_array_equal(first.likelihood, method.segment(given).likelihood)
