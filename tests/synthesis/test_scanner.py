"""Lidar sweeps: beams, times, lost pulses, and the way back to the surfaces."""

import numpy as np
import pytest

from bench.geometry import RigidTransform
from bench.lidar.sweep import deskew, interpolation_timestamps
from bench.synthesis.bodies import make_body
from bench.synthesis.ego import own_body
from bench.synthesis.mesh import Surface, joined
from bench.synthesis.motion import ego_motion
from bench.synthesis.scanner import BEAMS_DEG, COLUMN_OF, Echoes, LidarScanner, _are_panes, detected, revolution
from bench.synthesis.scenario import LidarSpec, StreetSpec, SuspensionSpec
from bench.synthesis.scene import Actor
from bench.synthesis.world import build_world
from bench.times import SECOND_NS
from tests.synthesis.conftest import drive
from tests.synthesis.pictures import PLAIN, road, wall

ROOF = RigidTransform(np.eye(3), np.array([1.2, 0.0, 1.8]))
PERFECT = {"position_m": (1.2, 0.0, 1.8), "range_noise_m": 0.0, "weakest_return_per_m2": 0.0}


FLOOR = road(PLAIN)


def ego(speed_mps=0.0, yaw_rate_radps=0.0, suspension=None):
    path = drive([0, 2], [speed_mps, speed_mps / 2], yaw_rate_radps)
    return ego_motion(path, suspension, rng=np.random.default_rng(4))


def scanner(world, motion, actors=(), **changes):
    spec = LidarSpec(**(PERFECT | changes))
    return LidarScanner(spec, vehicle_from_lidar=ROOF, world=world, own_body=own_body(), actors=actors, ego=motion)


def scan(lidar, time_ns=SECOND_NS // 2, seed=0):
    return lidar.scan(time_ns, timestamp_ns=time_ns, rng=np.random.default_rng(seed))


def placed(sweep, motion):
    """Points in the world, by the project's own de-skewing with the true poses."""
    interpolation_ns = interpolation_timestamps(sweep.times_ns)
    poses = motion.at(interpolation_ns)
    return deskew(
        sweep.points_lidar,
        sweep.times_ns,
        interpolation_ns=interpolation_ns,
        rotations=poses.rotations @ ROOF.rotation,
        positions_m=poses.rotations @ ROOF.translation_m + poses.positions_m,
    )


def test_beams_are_those_of_the_manual():
    assert len(BEAMS_DEG) == 64
    assert BEAMS_DEG[[0, 31, 32, 63]] == pytest.approx([2.0, -8.3333, -8.83, -24.33], abs=1e-3)
    beams = revolution(LidarSpec(position_m=(0, 0, 2)))
    assert beams.rays_lidar.shape == (2083, 64, 3)
    assert np.linalg.norm(beams.rays_lidar, axis=2) == pytest.approx(1.0, abs=1e-6)
    quarter = np.searchsorted(beams.offsets_ns, 25_000_000)  # clockwise: a quarter later it looks to the right
    assert np.degrees(np.arctan2(*beams.rays_lidar[quarter, 0, 1::-1])) == pytest.approx(-90.0, abs=0.2)
    assert len(revolution(LidarSpec(position_m=(0, 0, 2), rotation_hz=20)).offsets_ns) == 1042


def test_beams_of_two_blocks_start_where_the_calibration_says():
    beams = revolution(LidarSpec(position_m=(0, 0, 2), beams="two_blocks"))
    heights_m = beams.starts_lidar[..., 2]
    assert (heights_m == heights_m[0]).all()
    # The sensor of the calibration: its lasers 29, 6, 34 and 38, at 4.97, -10.86, -11.52 and -24.85 degrees.
    assert heights_m[0, [0, 31, 32, 63]] == pytest.approx([0.213, 0.193, 0.122, 0.105], abs=0.005)
    aside_m = np.linalg.norm(beams.starts_lidar[..., :2], axis=2)
    assert aside_m == pytest.approx(0.026)
    along_m = (beams.starts_lidar[..., :2] * beams.rays_lidar[..., :2]).sum(axis=2)
    assert np.abs(along_m).max() < 1e-12  # across the beam


@pytest.mark.parametrize("beams", ["one_origin", "two_blocks"])
def test_static_points_freed_of_the_ego_vehicles_motion_lie_on_their_surfaces(beams):
    motion = ego(12.0, 0.35, SuspensionSpec(road_class="B"))
    sweep = scan(scanner(joined(FLOOR, wall(6.0, y_m=(3, 20)), wall(22.0)), motion, beams=beams))

    def farthest_off_m(motion):
        x, _, z = placed(sweep, motion).T
        return float(np.abs([z, x - 6.0, x - 22.0]).min(axis=0).max())

    assert len(sweep.points_lidar) > 50_000
    assert farthest_off_m(motion) < 4e-3  # coordinates are stored to the nearest 1/256 m
    assert farthest_off_m(ego(12.0, 0.35)) > 0.05  # of the level host: its pitch and roll are seen
    if beams == "two_blocks":  # the points tell where beams start
        flat_m = np.sqrt(np.square(sweep.points_lidar[:, :2]).sum(axis=1) - 0.026**2)
        for ring, start_m in ((0, 0.209), (63, 0.106)):
            rows = sweep.ring == ring
            lifts_m = start_m + flat_m[rows] * np.tan(np.radians(BEAMS_DEG[ring]))
            assert sweep.points_lidar[rows, 2] == pytest.approx(lifts_m, abs=4e-3)


def test_range_noise_is_as_stated():
    sweep = scan(scanner(wall(10.0), ego(), range_noise_m=0.02))
    ranges_m = np.linalg.norm(sweep.points_lidar, axis=1)
    true_m = 8.8 / (sweep.points_lidar[:, 0] / ranges_m)
    assert (ranges_m - true_m).std() == pytest.approx(0.02, rel=0.05)
    assert abs((ranges_m - true_m).mean()) < 1e-3


def share_returned(surface, x_m, **changes):
    """Of the pulses within 20 degrees of straight ahead on a wall."""
    found, possible = (
        len(scan(scanner(wall(x_m, look), ego(), sector_deg=40.0, max_range_m=80.0, **more)).points_lidar)
        for look, more in ((surface, changes), (PLAIN, {}))
    )
    return found / possible


def test_dark_and_far_surfaces_return_fewer_pulses():
    real = {"weakest_return_per_m2": 5e-6}
    assert share_returned(PLAIN, 20.0, **real) > 0.999
    assert share_returned(Surface(albedo=0.02, contrast=0.0), 20.0, **real) > 0.99
    assert 0.3 < share_returned(Surface(albedo=0.02, contrast=0.0), 65.0, **real) < 0.7
    assert share_returned(Surface(albedo=0.004, contrast=0.0), 65.0, **real) < 0.05


def test_dark_surfaces_return_fewer_pulses_from_near_too_the_more_they_are_tilted():
    paint, tyre, grey = (Surface(albedo=albedo, contrast=0.05, mirror=0.04) for albedo in (0.05, 0.06, 0.4))
    near = {"weakest_reflectance": 0.03}
    assert share_returned(grey, 3.0, **near) > 0.999
    assert 0.5 < share_returned(paint, 3.0, **near) < share_returned(tyre, 3.0, **near) < 0.95
    assert share_returned(paint, 3.0, **near) == pytest.approx(share_returned(paint, 6.0, **near), abs=0.05)
    square, tilted = Echoes(2000, 10.0), Echoes(2000, 10.0)
    for echoes, cosine in ((square, 1.0), (tilted, 0.3)):
        echoes.ranges_m[:], echoes.cosines[:], echoes.albedos[:], echoes.mirrors[:] = 3.0, cosine, 0.05, 0.04
    spec = LidarSpec(position_m=(0, 0, 2), **near)
    shares = [detected(echoes, spec, np.random.default_rng(0))[0].mean() for echoes in (square, tilted)]
    assert shares[0] > 0.7
    assert shares[1] < 0.05


def test_panes_return_few_pulses_gloss_paint_all_of_them_and_the_sky_none():
    pane, black = (Surface(albedo=0.05, contrast=contrast, mirror=0.04) for contrast in (0.25, 0.07))
    assert 0.1 < share_returned(pane, 6.0, pane_returns=0.2) < 0.2
    assert share_returned(pane, 6.0, pane_returns=0.0) == 0.0
    assert share_returned(black, 6.0, weakest_return_per_m2=5e-6) > 0.999
    assert share_returned(Surface(albedo=0.9, contrast=0.0, sky=True), 10.0) == 0.0


def test_windows_of_cars_and_houses_are_panes():
    street = build_world(StreetSpec(), np.random.default_rng(0)).mesh.surfaces
    for surfaces in (make_body("car", np.random.default_rng(0)).mesh.surfaces, street):
        assert 0.0 < _are_panes(surfaces).mean() < 0.4


def test_intensity_tells_albedo_and_incidence():
    sweep = scan(scanner(wall(10.0), ego(), sector_deg=20))
    assert sweep.intensity.dtype == np.float32
    assert np.median(sweep.intensity) == pytest.approx(0.5, rel=0.05)
    flat = scan(scanner(FLOOR, ego(), max_range_m=15))
    steep, grazing = flat.ring == 63, flat.ring == 40
    assert np.median(flat.intensity[steep]) > 1.5 * np.median(flat.intensity[grazing])


def test_the_ego_vehicles_roof_gives_no_points():
    sweep = scan(scanner(FLOOR, ego()))
    points_vehicle = ROOF.apply(sweep.points_lidar.astype(np.float64))
    assert np.abs(points_vehicle[:, 2]).max() < 0.01
    behind = points_vehicle[np.abs(points_vehicle[:, 1]) < 0.3]
    assert behind[behind[:, 0] < 0][:, 0].max() < -3.0  # the roof shades the road close behind


@pytest.mark.parametrize("beams", ["one_origin", "two_blocks"])
def test_an_actor_hides_the_world_and_is_met_where_it_is_at_the_beams_own_time(beams):
    body = make_body("car", np.random.default_rng(1))
    body.mesh.surfaces[:, COLUMN_OF["mirror"]] = 0.0  # no panes, which lose pulses
    path = drive(0.0, 9.0, through=(9.0, 3.0, np.pi / 2), through_ns=SECOND_NS // 2)
    car = Actor(name="car", instance_id=1, body=body, path=path)
    motion = ego(6.0, 0.0, SuspensionSpec())
    sweep = scan(scanner(FLOOR, motion, (car,), beams=beams))
    points_world = placed(sweep, motion)
    on_car = points_world[:, 2] > 0.05
    assert on_car.sum() > 500
    poses = path.at(sweep.times_ns[on_car])
    local_m = np.einsum("nji,nj->ni", poses.rotations, points_world[on_car] - poses.positions_m)
    half_m = body.size_m / 2
    assert (np.abs(local_m[:, :2]) <= half_m[:2] + 4e-3).all()
    assert (local_m[:, 2] <= body.size_m[2] + 4e-3).all()
    # Each pulse has one echo: the car takes as many as the world loses.
    room = joined(FLOOR, wall(16.0))
    with_car, without = (
        scan(scanner(room, motion, actors, sector_deg=60, max_range_m=100, beams=beams)) for actors in ((car,), ())
    )
    assert len(with_car.points_lidar) == len(without.points_lidar)
    nearer_m = np.linalg.norm(without.points_lidar, axis=1) - np.linalg.norm(with_car.points_lidar, axis=1)
    assert nearer_m.min() > -1e-2
    assert (nearer_m > 0.1).sum() > 500
