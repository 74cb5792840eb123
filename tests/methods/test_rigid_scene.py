"""The parts of the method against numbers that geometry gives, and the whole on small scenes."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.cameras.pinhole import PinholeCamera
from bench.cameras.spheres import BrownConradyCamera
from bench.errors import UsageError
from bench.geometry import RigidTransform, RoadPlane
from bench.methods import build_method
from bench.methods.rigid_scene.candidates import floating, own_effects, upright
from bench.methods.rigid_scene.evidence import (
    CELL,
    Evidence,
    Information,
    flow_information,
    gradients,
    nearest_on_curve,
    structure_tensor,
)
from bench.methods.rigid_scene.motion import Correspondences, MotionAccuracy, refine_motion
from bench.methods.rigid_scene.scene import RigidScene, at_every_pixel
from tests.support.board_scene import CAMERA, LOOK, ROAD, STEP, crossing, drive, frame, render, texture
from tests.support.worlds import FORWARD, TwoViews, pitched_down

PINHOLE = PinholeCamera(width=320, height=240, focal=(150.0, 150.0), principal_point=(159.5, 119.5))


def scene_of(camera=CAMERA, **moved):
    views = TwoViews(**moved)
    return views, RigidScene(camera=camera, current_from_previous=views.motion, road=views.road)


@pytest.mark.parametrize("camera", [CAMERA, PINHOLE], ids=["fisheye", "pinhole"])
def test_static_points_move_as_the_scene_says(camera):
    views, scene = scene_of(camera)
    points = np.array([[5.0, 1.0, 0.0], [4.0, -1.5, 0.5], [9.0, 2.0, 2.0]])  # on the road, and above it
    previous, current = views.rays(points)
    now, _ = camera.project(current)
    before, _ = camera.project(previous)
    depth_m = np.linalg.norm(views.current_from_world.apply(points), axis=1)
    for k in range(3):
        flow = at_every_pixel(np.nan_to_num(scene.flow_at(1 / depth_m[k])), camera)
        u, v = np.rint(now[k]).astype(int)
        np.testing.assert_allclose(flow[v, u], before[k] - now[k], atol=0.15)
    u, v = np.rint(now[0]).astype(int)
    road = at_every_pixel(scene.road_inverse_depth(scene.fall()).astype(np.float32), camera)
    assert road[v, u] == pytest.approx(1 / depth_m[0], rel=0.02)


# Fitted within 60 degrees of its axis and one-to-one up to 90, where it rises with the fifth power of the radius.
STEEP = BrownConradyCamera(
    width=640,
    height=400,
    focal=(320.0, 320.0),
    principal_point=(319.5, 199.5),
    radial=(-0.33, 0.1),
    tangential=(-0.001, 0.001),
)


def test_rays_far_outside_of_the_image_overflow_nothing():
    # To the rear while driving forwards: the road beside the camera was ahead of it. Warnings are errors here.
    back = RigidTransform.from_yaw(np.pi).rotation
    before, now = (RigidTransform(LOOK @ back, -LOOK @ back @ np.array([x, 0.0, 0.8])) for x in (0.0, 1.5))
    motion, road = now @ before.inverse(), RoadPlane(LOOK @ np.array([0.0, 0.0, -1.0]), 0.8)
    scene = RigidScene(camera=STEEP, current_from_previous=motion, road=road)
    rays = scene.grid.rays_camera.reshape(-1, 3)
    far = scene.previous_pixels(rays, scene.road_inverse_depth(rays @ road.down))
    assert np.nanmax(np.abs(far)) > 1e15
    flow = scene.flow_at(scene.road_inverse_depth(scene.fall()))
    assert np.nanmax(np.abs(flow)) < 1.001e4
    moved = far - scene.grid.pixels.reshape(-1, 2)
    within = np.abs(moved).max(axis=1) < 1000
    np.testing.assert_allclose(flow.reshape(-1, 2)[within], moved[within], rtol=1e-5, atol=1e-4)
    images = tuple(texture(ROAD)[at : at + 400, at : at + 640].astype(np.uint8) for at in (0, 8))
    given = replace(
        frame(*images, STEP, valid=np.ones((400, 640), bool)), camera=STEEP, road=road, current_from_previous=(motion,)
    )
    found = build_method("rigid-scene").segment(given)
    assert max(np.abs(found.parts["flow_u"]).max(), np.abs(found.parts["flow_v"]).max()) < 3e4


def test_a_head_far_outside_of_the_image_overflows_nothing():
    road = RoadPlane(pitched_down(np.deg2rad(50)) @ np.array([0.0, 0.0, -1.0]), 0.8)
    scene = RigidScene(camera=STEEP, current_from_previous=RigidTransform.identity(), road=road)
    fall = at_every_pixel(scene.fall().astype(np.float32), STEEP)
    nowhere = np.zeros(fall.shape, dtype=bool)
    for row in range(60, 380, 2):  # some heads are nearly at a right angle to the axis
        feet = nowhere.copy()
        feet[row - 3 : row, 300:340] = True
        upright(scene, fall, feet, nowhere, height_m=1.6)


def test_the_nearest_point_of_a_curve():
    curve = [np.array([[0.0, 0.0]], np.float32), np.array([[4.0, 0.0]], np.float32), np.array([[4.0, 4.0]], np.float32)]
    answers = [((1, 2), (1, 0), 0.25), ((6, 1), (4, 1), 1.25), ((-3, 0), (0, 0), 0), ((4, 9), (4, 4), 2)]
    for flow, expected, place in answers:
        squared, point, where = nearest_on_curve(np.array([flow], np.float32), curve, None)
        np.testing.assert_allclose(point[0], expected, atol=1e-6)
        assert squared[0] == pytest.approx(np.sum(np.subtract(flow, expected) ** 2))
        assert where[0] == pytest.approx(place)
    # Known twice as well along u: distances there count four times.
    twice = Information(uu=np.array([4.0]), uv=np.array([0.0]), vv=np.array([1.0]))
    squared, _, _ = nearest_on_curve(np.array([[-3.0, 1.0]], np.float32), curve, twice)
    assert squared[0] == pytest.approx(4 * 9 + 1)


def test_flow_is_certain_across_an_edge_only():
    stripes = np.tile(128 + 40 * np.sin(np.arange(64) / 2.0), (64, 1)).astype(np.float32)
    tensor = structure_tensor(*gradients(stripes), side_px=5, noise=1.0)
    found = flow_information(tensor, noise=1.0, floor_px=0.1)
    assert found.uu[32, 32] == pytest.approx(1 / 0.1**2, rel=0.05)  # the floor, with so much texture
    assert found.vv[32, 32] < 0.01
    noise = np.random.default_rng(0).normal(128, 2.0, (200, 200)).astype(np.float32)
    sums = structure_tensor(*gradients(noise), side_px=5, noise=2.0 * np.sqrt(2))
    with_noise = structure_tensor(*gradients(noise), side_px=5, noise=1e-6)
    assert np.median(sums[0]) < 0.15 * np.median(with_noise[0])  # noise is no texture


def test_motion_is_refined_by_points_on_the_road_and_beside_it():
    views, true = scene_of()
    generator = np.random.default_rng(1)
    places = generator.uniform((2, -6, 0), (15, 6, 3), (600, 3))
    places[:400, 2] = 0
    previous, current = views.rays(places)
    pixels, seen = CAMERA.project(previous)
    pixels[:60] += generator.normal(0, 15, (60, 2))  # what moves
    pitch = Rotation.from_rotvec([np.deg2rad(0.2), 0, 0]).as_matrix()
    motion = RigidTransform(pitch @ views.motion.rotation, 1.02 * views.motion.translation_m)
    recorded = RigidScene(camera=CAMERA, current_from_previous=motion, road=views.road)
    information = np.tile(50.0 * np.eye(2), (seen.sum(), 1, 1))
    given = Correspondences(rays=current[seen], pixels=pixels[seen], information=information)
    accuracy = MotionAccuracy(speed_share=0.02)

    def error(scene):
        motion, true_motion = scene.current_from_previous, true.current_from_previous
        rotation_rad = Rotation.from_matrix(motion.rotation @ true_motion.rotation.T).magnitude()
        return rotation_rad, np.linalg.norm(motion.translation_m - true_motion.translation_m)

    refined = refine_motion(recorded, given, seconds=1 / 15, accuracy=accuracy)
    assert error(refined)[0] < 0.1 * error(recorded)[0]
    assert error(refined)[1] < 0.5 * error(recorded)[1]
    few = Correspondences(rays=given.rays[:20], pixels=given.pixels[:20], information=given.information[:20])
    assert refine_motion(recorded, few, seconds=1 / 15, accuracy=accuracy) is recorded
    with pytest.raises(UsageError, match="positive"):
        MotionAccuracy(speed_mps=0.0)


def test_a_foot_on_the_road_tells_how_high_an_object_reaches():
    level = RigidTransform(FORWARD, -FORWARD @ np.array([0.0, 0.0, 1.0]))
    scene = RigidScene(camera=PINHOLE, current_from_previous=level, road=RoadPlane(np.array([0.0, 1.0, 0.0]), 1.0))
    feet = np.zeros((240, 320), dtype=bool)
    feet[140:150, 150:170] = True  # the lowest row, 149, is 29.5 px below the horizon: 150 / 29.5 = 5.08 m away
    fall = at_every_pixel(scene.fall().astype(np.float32), PINHOLE)
    nowhere = np.zeros_like(feet)
    grown = upright(scene, fall, feet, nowhere, height_m=1.6)
    rows = np.flatnonzero(grown[:, 160])
    assert rows[-1] == 149
    assert rows[0] == pytest.approx(119.5 - 0.6 * 29.5, abs=1.5)  # 1.6 m high, seen from 1 m
    assert not grown[:, 180].any()
    body = nowhere.copy()
    body[152:] = True  # which may hide the foot
    assert not upright(scene, fall, feet, body, height_m=1.6).any()


def obstacle_before_the_camera(share, *, road_px_sigmas):
    """Evidence of an obstacle in the columns of cells 60 to 80, at a share of the distance of the road at its foot."""
    _, scene = scene_of()
    fall = at_every_pixel(scene.fall().astype(np.float32), scene.camera)
    cells = fall[CELL]
    rows, columns = cells.shape
    foot = int(np.flatnonzero(cells[:, 70] > 0.2)[0])
    inverse_depth = np.maximum(cells, 0) / scene.road.height_m
    block = slice(foot - 30, foot), slice(60, 80)
    inverse_depth[block] = cells[foot, 70] / scene.road.height_m / share
    from_road_px = np.full((rows, columns), 0.1, np.float32)
    from_road_px[block] = 2.0
    from_road_sigmas = road_px_sigmas * from_road_px
    from_road_sigmas[block] = 20.0
    small, image = np.zeros((rows, columns)), np.zeros(fall.shape, np.float32)
    pixels, flow = image > 0, np.zeros((*fall.shape, 2), np.float32)
    evidence = Evidence(
        scene=scene, moves=True, noise=1.0, tensor=(image, image, image), flow=flow, nearest=flow, static=flow,
        sigmas=image, misfit=image, edge=pixels, road_seen=pixels, fall=fall, too_low=pixels, beyond=pixels,
        inverse_depth=inverse_depth, from_road_px=from_road_px, from_road_sigmas=from_road_sigmas, road=flow,
    )  # fmt: skip
    expected = small > 0
    expected[block] = True
    return evidence, expected


def test_what_would_have_to_float_above_the_road_comes_towards_the_camera():
    evidence, expected = obstacle_before_the_camera(0.6, road_px_sigmas=10.0)
    found = floating(evidence, at_most=0.75, calm_sigmas=6.0)
    assert (found & expected).sum() > 0.9 * expected.sum()
    assert (found & ~expected).sum() < 0.1 * expected.sum()
    parked, _ = obstacle_before_the_camera(0.95, road_px_sigmas=10.0)
    assert not floating(parked, at_most=0.75, calm_sigmas=6.0).any()
    dark, _ = obstacle_before_the_camera(0.6, road_px_sigmas=1.0)  # nothing tells the road from the obstacle below it
    assert not floating(dark, at_most=0.75, calm_sigmas=6.0).any()


def test_what_the_lower_end_of_the_image_cuts_off_does_not_float():
    evidence, expected = obstacle_before_the_camera(0.6, road_px_sigmas=10.0)
    foot = int(np.flatnonzero(expected.any(axis=1))[-1])

    def hangs(rows):
        cells = {name: getattr(evidence, name)[:rows] for name in ("inverse_depth", "from_road_px", "from_road_sigmas")}
        pixels = {name: getattr(evidence, name)[: 2 * rows] for name in ("fall", "sigmas", "edge")}
        return floating(replace(evidence, **cells, **pixels), at_most=0.75, calm_sigmas=6.0).any()

    assert not hangs(foot + 1)
    assert hangs(foot + 5)


def test_what_crosses_is_found_and_what_stands_is_not():
    given, truth = crossing()
    found = build_method("rigid-scene").segment(given).mask
    assert (found & truth).sum() > 0.8 * truth.sum()
    assert (found & ~truth).sum() < 0.5 * truth.sum()
    before, _ = render((0.0, 0.0, 0.0), (5.0, 0.4, 0.0))
    after, _ = render(STEP, (5.0, 0.4, 0.0))
    still = build_method("rigid-scene").segment(frame(before, after, STEP)).mask
    assert still.mean() < 0.002


def shaded(shade, *, board_m=None):
    """Three images of a camera that drives on, below a shade that it carries along, and what moves in the last."""
    given, boards = drive(range(3), board_m, 0.3, step=np.array([0.12, 0.0, 0.0]))
    return replace(given, images=tuple(np.rint(image * shade).astype(np.uint8) for image in given.images)), boards[-1]


def test_the_own_shadow_is_no_object_and_what_crosses_it_is_one():
    v, u = np.indices((CAMERA.height, CAMERA.width))
    shade = cv2.GaussianBlur(np.where((v > 290) & (u > 250 + 0.5 * (v - 330)), 0.25, 1.0), (0, 0), 3)

    def found(given, *, own_effects):
        return build_method("rigid-scene", {"own_effects": own_effects}).segment(given).mask

    given, _ = shaded(shade)
    assert found(given, own_effects=False).mean() > 0.02
    assert found(given, own_effects=True).mean() < 0.002
    crossed, board = shaded(shade, board_m=(3.0, -0.9, 0.0))
    assert found(crossed, own_effects=True)[board].mean() > 0.9 * found(crossed, own_effects=False)[board].mean() > 0.5


def test_the_road_is_seen_through_what_stands_still_in_the_image_but_not_through_an_object():
    evidence, _ = obstacle_before_the_camera(1.0, road_px_sigmas=1.0)
    shape = evidence.fall.shape
    where = (slice(330, 390), slice(60, 260))  # on the road
    region = np.zeros(shape, dtype=bool)
    region[where] = True

    def seen(images, road_px):
        road = np.zeros((*shape, 2), np.float32)
        road[..., 0] = road_px
        three = [image.astype(np.uint8) for image in images]
        return own_effects(region, three, replace(evidence, road=road))[region].mean()

    def moving(px):  # to the right by so much an image
        return [np.roll(texture(ROAD), px * (k - 2), axis=1)[: shape[0], : shape[1]] for k in range(3)]

    shade = np.where(np.indices(shape)[1] > 160, 0.4, 1.0)
    assert seen([image * shade for image in moving(-6)], 6.0) == 1
    assert seen(moving(0), 6.0) == 0  # a car ahead, at the ego vehicle's speed
    assert seen(moving(3), 6.0) == 0  # what moves in another way
    assert seen([image * shade for image in moving(-2)], 2.0) == 0  # not told from what stands still
    assert own_effects(np.ones(shape, dtype=bool), [np.zeros(shape, np.uint8)] * 3, evidence).sum() == 0


def test_switches_change_the_answer_and_an_older_image_may_be_there():
    given, truth = crossing()
    whole = build_method("rigid-scene").segment(given).mask
    for switch in ("first_guess", "photometric", "sigmas"):
        assert (build_method("rigid-scene", {switch: False}).segment(given).mask != whole).any(), switch
    # Without outlines it holds what the body has just uncovered, too.
    wide = build_method("rigid-scene", {"objects": {"outlines": False}}).segment(given).mask
    assert (whole & ~truth).sum() < 0.7 * (wide & ~truth).sum()
    assert (whole & truth).sum() > 0.9 * (wide & truth).sum()


def test_the_papers_method_takes_the_first_guess_and_the_refined_motion():
    given, truth = crossing()
    pitch = RigidTransform(Rotation.from_rotvec([np.deg2rad(0.3), 0, 0]).as_matrix(), np.zeros(3))
    pitched = replace(given, current_from_previous=(pitch @ given.current_from_previous[0],))

    def false_share(settings, method="spherical"):
        found = build_method(method, settings).segment(pitched)
        assert found.mask[truth[2::5, 2::5]].mean() > 0.8
        return (found.mask & ~truth[2::5, 2::5]).mean()

    paper = false_share({})
    assert false_share({"refine_motion": True}) < 0.5 * paper
    both = false_share({"first_guess": True, "refine_motion": True})
    assert both < 0.5 * paper
    assert false_share({}, "spherical-guided") < both
