"""Motion in the plane that the ego vehicle and the actors share, and pitch, roll and heave of the ego vehicle's body.

Everything drives in the plane of the road. Time 0 is the first image; the world is the vehicle frame of the level ego
vehicle at that time.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from bench.geometry import RigidTransform
from bench.synthesis.scenario import SuspensionSpec
from bench.times import SECOND_NS

STEP_NS = 1_000_000  # between the nodes of a path: linear in between is off by less than a micrometre


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Poses:
    """Poses of a body at a row of times.

    Attributes:
        rotations: (N, 3, 3) float64, world from body.
        positions_m: (N, 3) float64, m, world.
        distances_m: (N,) float64, distance travelled since time 0, negative in reverse.
    """

    rotations: NDArray[np.float64]
    positions_m: NDArray[np.float64]
    distances_m: NDArray[np.float64]

    def transform(self, index: int = 0) -> RigidTransform:
        """World from body of one row."""
        return RigidTransform(self.rotations[index], self.positions_m[index])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Path:
    """A path in the plane, integrated from speed and yaw rate.

    Attributes:
        nodes_ns: (K,) int64, 1 ms apart.
        speeds_mps: (K,) float64, negative in reverse gear.
        yaw_rates_radps: (K,) float64, positive to the left.
        positions_m: (K, 2) float64, m, world.
        yaws_rad: (K,) float64, world.
        distances_m: (K,) float64, distance travelled since time 0, negative in reverse.
        floor_m: height of the ground below the body.
    """

    nodes_ns: NDArray[np.int64]
    speeds_mps: NDArray[np.float64]
    yaw_rates_radps: NDArray[np.float64]
    positions_m: NDArray[np.float64]
    yaws_rad: NDArray[np.float64]
    distances_m: NDArray[np.float64]
    floor_m: float = 0.0

    def at(self, times_ns: ArrayLike) -> Poses:
        """Poses at (N,) int64 times within the nodes."""
        times = self._within(times_ns)
        ground = [self._between(times, self.positions_m[:, k]) for k in (0, 1)]
        return Poses(
            rotations=_rotations_about_z(self._between(times, self.yaws_rad)),
            positions_m=np.stack([*ground, np.full(len(times), self.floor_m)], axis=1),
            distances_m=self._between(times, self.distances_m),
        )

    def signals(self, times_ns: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Signed speed (m/s) and yaw rate (rad/s) at (N,) times within the nodes."""
        times = self._within(times_ns)
        return self._between(times, self.speeds_mps), self._between(times, self.yaw_rates_radps)

    def velocity_mps(self, time_ns: int) -> NDArray[np.float64]:
        """(3,) float64, over the ground, world axes."""
        times = self._within([time_ns])
        yaw, speed = self._between(times, self.yaws_rad)[0], self._between(times, self.speeds_mps)[0]
        return np.array([speed * np.cos(yaw), speed * np.sin(yaw), 0.0])

    def _within(self, times_ns: ArrayLike) -> NDArray[np.int64]:
        times = np.atleast_1d(np.asarray(times_ns, dtype=np.int64))
        assert self.nodes_ns[0] <= times.min()
        assert times.max() <= self.nodes_ns[-1]
        return times

    def _between(self, times_ns: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.interp(times_ns.astype(np.float64), self.nodes_ns.astype(np.float64), values)


def driven_path(
    *,
    times_s: ArrayLike,
    speeds_mps: ArrayLike,
    yaw_rates_radps: ArrayLike,
    first_ns: int,
    last_ns: int,
    through: tuple[float, float, float] = (0.0, 0.0, 0.0),
    through_ns: int = 0,
    floor_m: float = 0.0,
    ramp_s: float = 0.0,
) -> Path:
    """Integrate a profile that is linear between its entries and constant beyond them.

    Args:
        times_s: (P,), s, increasing.
        speeds_mps: (P,) or one for all, m/s, negative in reverse gear.
        yaw_rates_radps: (P,) or one for all, rad/s.
        first_ns: first time wanted, <= 0.
        last_ns: last time wanted, > 0.
        through: x (m), y (m) and yaw (rad) in the world at `through_ns`.
        through_ns: a whole millisecond between the first and the last time.
        floor_m: height of the ground below the body.
        ramp_s: the profile's corners are rounded by a mean over this time.
    """
    nodes = np.arange(first_ns // STEP_NS, -(-last_ns // STEP_NS) + 1, dtype=np.int64) * STEP_NS
    seconds = nodes / SECOND_NS
    profile_s = np.atleast_1d(np.asarray(times_s, dtype=np.float64))
    speeds = _rounded(seconds, profile_s, np.broadcast_to(speeds_mps, len(profile_s)), ramp_s)
    yaw_rates = _rounded(seconds, profile_s, np.broadcast_to(yaw_rates_radps, len(profile_s)), ramp_s)
    zero, here = np.searchsorted(nodes, [0, through_ns])
    distances = _integral(seconds, speeds, int(zero))
    if yaw_rates.any():
        yaws = through[2] + _integral(seconds, yaw_rates, int(here))
        positions = _along_arcs(distances, yaws)
    else:
        yaws = np.full_like(seconds, through[2])
        positions = distances[:, None] * np.array([np.cos(through[2]), np.sin(through[2])])
    return Path(
        nodes_ns=nodes,
        speeds_mps=speeds,
        yaw_rates_radps=yaw_rates,
        positions_m=positions - positions[here] + np.array(through[:2]),
        yaws_rad=yaws,
        distances_m=distances,
        floor_m=floor_m,
    )


def _along_arcs(distances_m: NDArray[np.float64], yaws_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions (K, 2) from the first node on: between nodes, the chord of an arc halfway through the change of yaw."""
    middle = (yaws_rad[1:] + yaws_rad[:-1]) / 2
    chords = np.diff(distances_m) * np.sinc(np.diff(yaws_rad) / (2 * np.pi))  # distance * sinc(yaw change / 2)
    steps = chords[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def _rotations_about_z(yaws_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3, 3) rotations about z."""
    rotations = np.zeros((len(yaws_rad), 3, 3))
    rotations[:, 0, 0] = rotations[:, 1, 1] = np.cos(yaws_rad)
    rotations[:, 1, 0] = np.sin(yaws_rad)
    rotations[:, 0, 1] = -rotations[:, 1, 0]
    rotations[:, 2, 2] = 1.0
    return rotations


def _rounded(
    seconds: NDArray[np.float64], profile_s: NDArray[np.float64], values: NDArray[np.float64], ramp_s: float
) -> NDArray[np.float64]:
    """The profile at times, each value the mean of the profile over a window around its time."""
    if ramp_s == 0.0:
        return np.interp(seconds, profile_s, values)
    nodes_s = np.unique(np.concatenate([profile_s, seconds - ramp_s / 2, seconds + ramp_s / 2]))
    area = _integral(nodes_s, np.interp(nodes_s, profile_s, values), 0)
    low, high = (np.interp(seconds + side * ramp_s / 2, nodes_s, area) for side in (-1, 1))
    return np.asarray((high - low) / ramp_s)


def _integral(seconds: NDArray[np.float64], rates: NDArray[np.float64], zero: int) -> NDArray[np.float64]:
    total = np.concatenate([[0.0], np.cumsum(np.diff(seconds) * (rates[1:] + rates[:-1]) / 2)])
    return np.asarray(total - total[zero])


# An everyday family car: Gillespie, Fundamentals of Vehicle Dynamics, gives ride frequencies of 1 to 1.5 Hz, damping
# ratios of 0.2 to 0.4 and roll gradients of 3 to 7 degrees per g; braking at 3 m/s^2 lets its nose dive by nearly a
# degree. Pitch, roll and heave each answer as a mass on a spring with a damper.
NATURAL_HZ, DAMPING_RATIO = 1.3, 0.35  # undamped; of critical damping
PITCH_DEG_PER_MPS2, ROLL_DEG_PER_MPS2 = 0.3, 0.45  # nose down for braking; to the outside of the bend
CENTRE_M = np.array([1.35, 0.0, 0.4])  # of pitch and roll, in the level vehicle frame
WHEELBASE_M, TRACK_M = 2.7, 1.55  # between the axles, and between left and right wheels

# ISO 8608: displacement spectra at 0.1 cycles/m, geometric means of the classes, m^3; they fall with n^-2.
SPECTRUM_M3 = {"A": 16e-6, "B": 64e-6, "C": 256e-6}
AT_CYCLES_PER_M = 0.1
# Waves longer than 20 m lift car and street alike, and the rendered street is flat. ISO 8608 ends at 2.83 cycles/m.
CYCLES_PER_M = (0.05, 2.83)
WAVES = 96


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RoadProfile:
    """Heights below the wheels, over the distance along the road.

    Attributes:
        waves_per_m: (W,) float64, cycles per metre.
        amplitudes_m: (2, W) float64: of the mean of both wheel tracks, and of half their difference.
        phases_rad: (2, W) float64.
    """

    waves_per_m: NDArray[np.float64]
    amplitudes_m: NDArray[np.float64]
    phases_rad: NDArray[np.float64]

    def heights_m(self, distances_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Heights below the left and the right wheel at (N,) distances."""
        angles = 2 * np.pi * np.outer(distances_m, self.waves_per_m)
        mean, half = (np.cos(angles + p) @ a for a, p in zip(self.amplitudes_m, self.phases_rad, strict=True))
        return mean + half, mean - half


def road_profile(road_class: str | None, rng: np.random.Generator) -> RoadProfile:
    """Draw a road of a class.

    Each wave has the power that its class gives it. Left and right tracks of an isotropic road agree for waves that are
    long against their distance and differ for short ones; the share in between is simplified to
    1 / (1 + (2 pi n track)^2).

    Source:
        ISO 8608:2016, road surface profiles.
    """
    edges = np.geomspace(*CYCLES_PER_M, WAVES + 1)
    waves = rng.uniform(edges[:-1], edges[1:])
    level = 0.0 if road_class is None else SPECTRUM_M3[road_class]
    powers = level * (waves / AT_CYCLES_PER_M) ** -2 * np.diff(edges)
    agreeing = 1.0 / (1.0 + (2 * np.pi * waves * TRACK_M) ** 2)
    shares = np.stack([(1 + agreeing) / 2, (1 - agreeing) / 2])
    return RoadProfile(
        waves_per_m=waves,
        amplitudes_m=np.sqrt(2 * powers * shares),
        phases_rad=rng.uniform(0, 2 * np.pi, (2, WAVES)),
    )


SETTLING_NODES = 3000  # 3 s of steady driving before a path begins: the body has forgotten how it began


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Attitude:
    """Attitude of the body relative to the level vehicle.

    Attributes:
        pitch_rad: (K,) float64, about the y axis: nose down is positive, as ISO 8855 has it.
        roll_rad: (K,) float64, about the x axis: right side down is positive.
        heave_m: (K,) float64, upwards.
    """

    pitch_rad: NDArray[np.float64]
    roll_rad: NDArray[np.float64]
    heave_m: NDArray[np.float64]


def body_attitude(path: Path, road: RoadProfile) -> Attitude:
    """Attitude of the body under braking, bends and the road, at the nodes of a path.

    Inertia moves the body as a force on its springs: towards the angle of steady braking or cornering, with the
    overshoot of its damping. The road moves it through springs and dampers both (base excitation). Before the first
    node the ego vehicle drove steadily.

    Args:
        path: in the plane.
        road: below the wheels, along the path of the rear axle.
    """
    accelerations_mps2 = _led_in(np.gradient(path.speeds_mps, STEP_NS / SECOND_NS))
    lateral_mps2 = _led_in(path.speeds_mps * path.yaw_rates_radps)
    lead_in_m = np.arange(-SETTLING_NODES, 0) * (STEP_NS / SECOND_NS) * path.speeds_mps[0]
    distances_m = np.concatenate([path.distances_m[0] + lead_in_m, path.distances_m])
    front, rear = (road.heights_m(distances_m + ahead_m) for ahead_m in (WHEELBASE_M, 0.0))
    forced, carried = _answers()
    return Attitude(
        pitch_rad=_answer(forced, -np.radians(PITCH_DEG_PER_MPS2) * accelerations_mps2)
        + _answer(carried, (rear[0] + rear[1] - front[0] - front[1]) / 2 / WHEELBASE_M),
        roll_rad=_answer(forced, np.radians(ROLL_DEG_PER_MPS2) * lateral_mps2)
        + _answer(carried, (front[0] + rear[0] - front[1] - rear[1]) / 2 / TRACK_M),
        heave_m=_answer(carried, (front[0] + front[1] + rear[0] + rear[1]) / 4),
    )


def _led_in(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate([np.full(SETTLING_NODES, values[0]), values])


_Filter = tuple[NDArray[np.float64], NDArray[np.float64]]


@cache
def _answers() -> tuple[_Filter, _Filter]:
    """w^2 / (s^2 + 2 z w s + w^2) for forces, (2 z w s + w^2) over the same for the road; exact for linear steps."""
    w = 2 * np.pi * NATURAL_HZ
    damping = 2 * DAMPING_RATIO * w
    below = [1.0, damping, w * w]
    return _discrete([w * w], below), _discrete([damping, w * w], below)


def _discrete(above: list[float], below: list[float]) -> _Filter:
    from scipy.signal import cont2discrete  # half a second, and only new drives need it

    system = np.array(above), np.array(below)
    numerator, denominator, _ = cont2discrete(system, STEP_NS / SECOND_NS, method="foh")
    return np.asarray(numerator, dtype=np.float64).ravel(), np.asarray(denominator, dtype=np.float64)


def _answer(filter_: _Filter, cause: NDArray[np.float64]) -> NDArray[np.float64]:
    from scipy.signal import lfilter, lfilter_zi

    answer, _ = lfilter(*filter_, cause, zi=lfilter_zi(*filter_) * cause[0])
    return np.asarray(answer[SETTLING_NODES:])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EgoMotion:
    """The ego vehicle, to whose body the sensors are bolted.

    Attributes:
        ground: path of the level vehicle's origin, below the middle of the rear axle, in the plane of the road.
        attitude: of the body at the ground's nodes; None for a rigid car.
    """

    ground: Path
    attitude: Attitude | None

    @property
    def nodes_ns(self) -> NDArray[np.int64]:
        """(K,) int64, 1 ms apart; the motion is known between the first and the last."""
        return self.ground.nodes_ns

    def at(self, times_ns: ArrayLike) -> Poses:
        """World from body at (N,) int64 times within the nodes; `distances_m` is measured over the ground."""
        level = self.ground.at(times_ns)
        if self.attitude is None:
            return level
        times = np.atleast_1d(np.asarray(times_ns, dtype=np.int64)).astype(np.float64)
        nodes = self.nodes_ns.astype(np.float64)
        pitch, roll, heave = (
            np.interp(times, nodes, values)
            for values in (self.attitude.pitch_rad, self.attitude.roll_rad, self.attitude.heave_m)
        )
        level_from_body = Rotation.from_euler("YX", np.column_stack([pitch, roll])).as_matrix()
        shifts_level = CENTRE_M - level_from_body @ CENTRE_M
        shifts_level[:, 2] += heave
        return Poses(
            rotations=level.rotations @ level_from_body,
            positions_m=level.positions_m + np.einsum("nij,nj->ni", level.rotations, shifts_level),
            distances_m=level.distances_m,
        )


def ego_motion(ground: Path, suspension: SuspensionSpec | None, *, rng: np.random.Generator) -> EgoMotion:
    """The motion of the ego vehicle's body.

    Args:
        ground: the path of the level vehicle.
        suspension: None for a rigid car, which no unevenness moves.
        rng: the unevenness of the road.
    """
    if suspension is None:
        return EgoMotion(ground=ground, attitude=None)
    road = road_profile(suspension.road_class, rng)
    return EgoMotion(ground=ground, attitude=body_attitude(ground, road))
