"""Edges of what a sweep saw and of images, and what they add to the flow of a camera."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from bench.egomotion.trajectory import planar_trajectory
from bench.geometry import RigidTransform
from bench.lidar.sweep import LidarSweep
from bench.recordings.native import open_native
from bench.reference.sweeps import pose_sweep
from bench.validation.fits import cameras
from bench.validation.fits.camera_fit import CameraFit, Fit
from bench.validation.fits.flow import FARTHEST_PX, MARGIN_PX, SECTORS, image_edges, lidar_edges, reduced, seen_flows
from bench.validation.fits.scan_matching import measured_motion, scan_steps
from tests.support.drive import cast
from tests.support.tiny import HEIGHT, WIDTH, front_camera
from tests.support.worlds import beams

ACROSS = 0  # sector of an edge whose grey levels change to the right: one that runs down the image
STEP_DEG = 0.4
POST = RigidTransform.from_yaw(0.0, np.array([8.0, 0.0, 1.5]))
POST_SIZE_M = np.array([0.4, 1.0, 3.0])
WALL = RigidTransform.from_yaw(0.0, np.array([20.0, 0.0, 5.0]))
WALL_SIZE_M = np.array([0.2, 60.0, 10.0])


def placed_sweep(boxes):
    rays = beams(np.arange(-40, 40, STEP_DEG), np.arange(-20, 10, STEP_DEG))
    mounting = RigidTransform(np.eye(3), np.array([0.0, 0.0, 1.8]))
    reach = cast(mounting.translation_m, rays, boxes)
    points = rays[np.isfinite(reach)] * reach[np.isfinite(reach)][:, None]
    times_ns, still = np.arange(0, 10**9, 10**7), np.zeros(100)
    path = planar_trajectory(source="still", timestamps_ns=times_ns, speed_mps=still, yaw_rate_radps=still)
    sweep = LidarSweep(timestamp_ns=10**8, points_lidar=points)
    return pose_sweep(sweep, path, mounting, RigidTransform(np.eye(3), np.zeros(3)))


def found_edges(boxes):
    placed = placed_sweep(boxes)
    heights_m = placed.points_world()[:, 2]
    return lidar_edges(placed, heights_m, np.ones(len(heights_m), bool))


def test_the_sides_and_the_top_of_a_post_are_edges_of_a_sweep():
    points, ends = found_edges([(POST, POST_SIZE_M), (WALL, WALL_SIZE_M)])
    beam_m = 8.0 * np.radians(STEP_DEG)
    upright = np.abs((ends - points)[:, 2]) > 0.04
    left, right = points[upright & (points[:, 1] > 0)], points[upright & (points[:, 1] < 0)]
    assert len(left) > 10
    assert len(right) > 10
    np.testing.assert_allclose(left[:, 1], 0.5, atol=beam_m)
    np.testing.assert_allclose(right[:, 1], -0.5, atol=beam_m)
    np.testing.assert_allclose(points[~upright][:, 2], 3.0, atol=beam_m)
    np.testing.assert_allclose(np.linalg.norm(ends - points, axis=1), 0.05)


def test_neither_a_wall_nor_the_road_nor_what_jumps_from_beam_to_beam_as_leaves_do_has_an_edge():
    draw = np.random.default_rng(3)
    leaves = [
        (RigidTransform.from_yaw(0.0, draw.uniform([7, -3, 0.5], [9, 3, 3])), np.array([0.01, 0.07, 0.07]))
        for _ in range(150)
    ]
    for boxes in ([], leaves):
        points, _ = found_edges([*boxes, (WALL, WALL_SIZE_M)])
        assert len(points) == 0


def test_offsets_lead_to_the_nearest_edge_of_an_image_that_runs_the_same_way():
    camera, image = front_camera(), np.full((HEIGHT, WIDTH), 90, np.uint8)
    u0, u1, v0, v1 = WIDTH // 3, 2 * WIDTH // 3, HEIGHT // 3, 2 * HEIGHT // 3
    cv2.rectangle(image, (u0, v0), (u1, v1), 200, -1)
    offsets = image_edges(image, camera)
    middle = (v0 + v1) // 2
    right, down = offsets[ACROSS, middle, u0 - 4]
    assert abs(right - 4) <= 1
    assert down == 0
    assert np.linalg.norm(offsets[SECTORS // 2, middle, u0 - 4].astype(float)) >= min(FARTHEST_PX, middle - v0 - 2)


def test_the_outline_of_the_own_body_is_no_edge():
    camera, image = front_camera(), np.full((HEIGHT, WIDTH), 90, np.uint8)
    body = np.zeros((HEIGHT, WIDTH), bool)
    body[2 * HEIGHT // 3 :] = True
    image[body] = 10
    offsets = image_edges(image, replace(camera, ego_body=body))
    assert np.abs(offsets[:, 2 * HEIGHT // 3 - MARGIN_PX]).max(axis=-1).min() >= FARTHEST_PX


CLEAN = Fit(
    values=np.zeros(14), sigmas=np.ones(14), pair_errors=np.zeros((1, 6)), losses=np.array([1.0]), cost=100.0,
    share=1.0, residual_px=0.4, scale_px=0.4,
)  # fmt: skip


@pytest.mark.parametrize(
    ("cause", "degrees", "changes", "told"),
    [
        # However well edges meet, a fit by which flow is clearly worse is no cause.
        ("rotation", 0.0, {"losses": np.array([4.0]), "cost": 80.0}, True),
        ("rotation", 0.0, {"losses": np.array([6.0]), "cost": 80.0}, False),
        ("rotation", 0.0, {"losses": np.array([0.9]), "cost": 95.0}, False),
        ("position", 0.0, {"losses": np.array([0.9]), "cost": 85.0}, False),
        # A turn of degrees is told by the pixels that it explains.
        ("rotation", 3.0, {"cost": 80.0, "residual_px": 0.37}, False),
        ("rotation", 3.0, {"cost": 80.0, "residual_px": 0.3}, True),
        ("rotation", 3.0, {"cost": 55.0, "residual_px": 0.37}, True),
        ("rotation", 1.0, {"cost": 80.0, "residual_px": 0.38}, True),
    ],
)
def test_a_cause_explains_flow_that_it_makes_clearly_better(cause, degrees, changes, told):
    values = np.where(np.arange(14) == 1, np.radians(degrees), 0.0)
    assert cameras._explains(cause, replace(CLEAN, values=values, **changes), CLEAN) is told


@pytest.mark.slow
def test_a_degree_moves_edges_by_what_it_moves_the_image(turning):
    drive = open_native(turning)
    camera = reduced(drive.cameras["front"])
    measured = measured_motion(drive, scan_steps(drive))
    fit = CameraFit(list(seen_flows(drive, camera, measured)), drive.trajectory, camera, measured)
    values = np.zeros(14)
    (residual, across), (pixels, _) = fit.edge_residuals(values), fit.edge_pixels(values)
    assert np.median(np.abs(residual[np.isfinite(residual)])) < 1.0
    values[1] = np.radians(1.0)
    (turned, _), (moved, _) = fit.edge_residuals(values), fit.edge_pixels(values)
    near = np.isfinite(residual) & np.isfinite(turned) & (np.abs(residual) < 1)
    expected = -((moved - pixels) * across).sum(axis=1)
    assert np.median(np.abs((turned - residual - expected)[near])) < 1.0
