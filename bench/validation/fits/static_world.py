"""The static world stands still between sweeps: which of odometry, mounting and clock has to change so that it does.

The lidar's motion is measured once (`scan_matching`); hypotheses are compared by how well they explain it
(`lidar_motion`), and the best is named. Motion alone cannot tell some of them apart: a vehicle seen in a mirror drives
as one whose yaw rate has the other sign. There annotated boxes decide: the mounting that brings returns into them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from bench.egomotion.trajectory import Trajectory
from bench.errors import DataError
from bench.lidar.sweep import LidarSweep
from bench.recordings import Recording
from bench.validation.findings import (
    Finding,
    Undecided,
    annotated_times,
    boxes_near,
    calibration_file,
    distance_to,
    new_finding,
    sweep_times,
)
from bench.validation.fits.lidar_motion import (
    PARAMETERS,
    QUANTITIES,
    STATED,
    Fit,
    Mounting,
    Odometry,
    Quantity,
    fitted,
    level_steps,
)
from bench.validation.fits.readings import DEGREE, Reading, mounting_name, pose_readings
from bench.validation.fits.scan_matching import APART_S, Step, neighbouring, scan_steps

Array = NDArray[np.float64]


# The road, and returns in boxes.
SWEEPS = 5  # that are read, spread over the drive
NEAR_M = 20.0  # of the returns that count for the road
RETURNS = 1500  # of a sweep that are tried, at random
PLANES, PATCH_M = 400, 6.0  # that are tried, each through three returns so near to each other
THICK_M = 0.15  # of the road: kerbs count, pavements may
MOST_BELOW = 0.03  # share of the returns that may lie below the road
LEAST_ON_ROAD = 0.15  # share of the returns that lie on it
ACROSS = 0.3  # cosine of the angle between the plane's normal and the lidar's path, at most
BOX_NS = 60_000_000  # of an annotated state to a sweep
BOTTOM = 0.6  # share of half a box, from its middle down; what lies lower may be the road


def _some_sweeps(recording: Recording) -> list[LidarSweep]:
    """Sweeps spread over the drive; those that cannot be read are left out."""
    sweeps = []
    for row in np.unique(np.linspace(0, len(recording.sweeps) - 1, SWEEPS).round().astype(int)):
        with suppress(DataError):  # reported by the check of the sweeps
            sweeps.append(recording.sweeps[row].read())
    return sweeps


def road_plane(sweeps: Sequence[LidarSweep], path_m: Array) -> tuple[Array, float] | None:
    """The plane along the path that has most returns on it, and hardly any on one side.

    Args:
        sweeps: some.
        path_m: (3,) float64, path of the lidar, axes of the points; zero where it stands.

    Returns:
        Its unit normal, (3,), axes of the points as the files give them, and the height of their origin above it, m:
        medians over the sweeps. None where most see no such plane.
    """
    planes = [plane for sweep in sweeps if (plane := _plane(sweep.points_lidar.astype(np.float64), path_m)) is not None]
    if not planes or 2 * len(planes) < len(sweeps):
        return None
    up = np.median([plane[:3] for plane in planes], axis=0)
    return up / np.linalg.norm(up), float(np.median([plane[3] for plane in planes]))


def _plane(points: Array, path_m: Array) -> Array | None:
    """(4,) float64, normal and the origin's height above the plane."""
    rng = np.random.default_rng(0)
    points = points[np.linalg.norm(points, axis=1) < NEAR_M]
    points = points[rng.permutation(len(points))[:RETURNS]]
    if len(points) < RETURNS // 5:
        return None
    one, two, three = points[rng.integers(0, len(points), (3, 20 * PLANES))]
    together = np.maximum(np.linalg.norm(two - one, axis=1), np.linalg.norm(three - one, axis=1)) < PATCH_M
    normals = np.cross(two - one, three - one)[together]
    sizes = np.linalg.norm(normals, axis=1)
    wide = sizes > 0.5  # m2: three returns in a line make no plane
    normals, corners = normals[wide] / sizes[wide, None], one[together][wide]
    along = np.abs(normals @ path_m) <= ACROSS * np.linalg.norm(path_m)
    normals, corners = normals[along][:PLANES], corners[along][:PLANES]
    if not len(normals):
        return None
    heights = normals @ points.T - np.einsum("ni,ni->n", normals, corners)[:, None]
    turned = np.where((heights > THICK_M).sum(axis=1) < (heights < -THICK_M).sum(axis=1), -1.0, 1.0)
    normals, heights = normals * turned[:, None], heights * turned[:, None]
    on_plane = np.abs(heights) < THICK_M
    share = np.where((heights < -THICK_M).mean(axis=1) < MOST_BELOW, on_plane.mean(axis=1), 0.0)
    best = int(np.argmax(share))
    if share[best] < LEAST_ON_ROAD:
        return None
    road = points[on_plane[best]]
    middle = road.mean(axis=0)
    normal = np.linalg.svd(road - middle, full_matrices=False)[2][2]
    normal *= np.sign(normal @ normals[best])
    return np.append(normal, -normal @ middle)


def _returns_in_boxes(recording: Recording, sweeps: Sequence[LidarSweep], vehicle_from_points: Array) -> int:
    """Returns in annotated boxes, above their bottoms, if the lidar were mounted so.

    Args:
        recording: the drive.
        sweeps: some of its sweeps.
        vehicle_from_points: (3, 3) float64, orthogonal, of any determinant.
    """
    count = 0
    for sweep in sweeps:
        placed = sweep.points_lidar @ vehicle_from_points.T + recording.vehicle_from_lidar.translation_m
        for box in boxes_near(recording, sweep.timestamp_ns, within_ns=BOX_NS):
            local = box.vehicle_from_object.inverse().apply(placed) / (box.size_m / 2)
            count += int(((np.abs(local) < 1.0).all(axis=1) & (local[:, 2] > -BOTTOM)).sum())
    return count


# What is reported.
SIGMAS = 4.0  # standard deviations beyond what is tolerated
BETTER = 0.6  # factor by which distances between sweeps have to fall where a sign, an axis or a unit is to change
BETTER_M = 0.01  # by how much at least, m
AS_GOOD = 1.3  # factor of the smallest cost within which hypotheses explain the steps equally well
LEAST_STEPS = 6  # matched pairs of sweeps
TILT_RAD = 0.5  # between the road that is seen and the road as stated, beyond which axes are permuted
LEAST_PATH_M = 0.05  # path of the lidar between two sweeps; where it stands, a wall looks like a road
WITNESSES = 100  # returns in annotated boxes that decide


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypothesis:
    """One cause, and how well it explains the steps.

    Attributes:
        free: quantities that are fitted, of `QUANTITIES`; the cause comes first.
        mounting: of the lidar; the stated one where the cause is another.
        fit: of the free quantities.
        remounted: the mounting itself is the cause.
        reading: how poses were misread, where that is the cause; nothing is fitted then.
    """

    free: tuple[str, ...] = ()
    mounting: Mounting
    fit: Fit
    remounted: bool = False
    reading: Reading[Trajectory] | None = None

    @property
    def quantity(self) -> Quantity:
        """The cause."""
        return QUANTITIES[self.free[0]]

    @property
    def value(self) -> tuple[float, float]:
        """Of the cause, and its standard deviation."""
        return self.fit.of(self.free[0])

    @property
    def cost(self) -> float:
        """That of the fit, ten for a quantity that is fitted, and forty for two: one mistake is likelier than two."""
        return self.fit.cost + 10.0 * len(self.free) ** 2


def _at(**values: float) -> Array:
    return np.array([values.get(name, stated) for name, stated in zip(PARAMETERS, STATED, strict=True)])


SPEEDS = {
    1 / 3.6: "km/h read as m/s",
    3.6: "m/s read as km/h",
    0.44704: "mph read as m/s",
    0.01: "centimetres read as metres",
    0.001: "millimetres read as metres",
    -1.0: "the wrong way, forwards for backwards",
    0.0: "a stationary vehicle",
}
TURNS = {
    DEGREE: "degrees per second read as rad/s",
    1 / DEGREE: "rad/s read as degrees per second",
    -1.0: "positive to the right instead of left",
    0.0: "a vehicle that drives straight",
}
FACTORS = {  # field, the same where it is reversed, and known factors
    "speed": ("speed", "gear or sign of the speed", SPEEDS),
    "turn": ("yaw rate", "sign of the yaw rate", TURNS),
}
AROUND = tuple(_at(yaw_rad=angle) for angle in np.radians(np.arange(-180, 180, 45)))


BOTH = [(s, t) for s, t in product((1.0, *SPEEDS), (1.0, *TURNS)) if s * t != 0 and (s, t) != (1.0, 1.0)]
WRONG_QUANTITIES: dict[tuple[str, ...], tuple[Array, ...]] = {  # what may be wrong, and where its fit begins
    ("late_s",): tuple(_at(late_s=late) for late in (-0.1, -0.03, 0.03, 0.1)),
    ("bias_radps",): (STATED,),
    ("speed",): tuple(_at(speed=factor) for factor in (1.0, *SPEEDS)),
    ("turn",): tuple(_at(turn=factor) for factor in (1.0, *TURNS)),
    ("speed", "turn"): tuple(_at(speed=s, turn=t) for s, t in BOTH if abs(s) == 1.0 or s < 0.5),
}


def check_static_world(recording: Recording) -> Iterator[Finding | Undecided]:
    """Clock, mounting of the lidar and ego-motion, from sweeps that have to meet."""
    steps = scan_steps(recording)
    if len(steps) < LEAST_STEPS:
        yield Undecided(about="ego-motion, clock and mounting of the lidar", why=_too_few(recording, len(steps)))
    else:
        yield from _Verdict(recording, steps).findings()


def _too_few(recording: Recording, steps: int) -> str:
    pairs = int(neighbouring(recording).sum())
    if not recording.sweeps:
        return "no lidar sweeps"
    if pairs < LEAST_STEPS:
        return "{} of {} sweeps follow another by {:g} to {:g} s, at least {} are needed".format(
            pairs, len(recording.sweeps), *APART_S, LEAST_STEPS
        )
    return f"{steps} of {pairs} neighbouring sweeps see enough of the same surfaces, fewer than needed"


class _Verdict:
    """Compares hypotheses on the steps of one recording."""

    def __init__(self, recording: Recording, steps: Sequence[Step]) -> None:
        self._recording, self._sweeps = recording, _some_sweeps(recording)
        path_m, stated = np.median([step.path_m for step in steps], axis=0), recording.vehicle_from_lidar
        stands = bool(np.linalg.norm(path_m) < LEAST_PATH_M)
        seen = None if stands else road_plane(self._sweeps, path_m)
        up, height_m = stated.rotation[2], float(stated.translation_m[2]) - recording.ground_m
        self._upright = seen is None or float(seen[0] @ up) > np.cos(TILT_RAD)
        if seen is not None and not self._upright:
            up, height_m = seen
        forward = stated.rotation[0] if abs(up @ stated.rotation[0]) < 0.7 else stated.rotation[1]
        self._steps = level_steps(steps, up, height_m, forward)
        level = Mounting(level_from_vehicle=np.eye(2), lever_m=stated.translation_m[:2])
        self._mounting = self._steps.stated(stated) if self._upright else level
        self._odometry = Odometry.of(recording.trajectory, self._steps.epoch_ns)
        self._stated = fitted(self._steps, self._odometry, self._mounting)

    def findings(self) -> Iterator[Finding | Undecided]:
        """The cause that explains the steps, else the parameters that cannot be told."""
        tried = [*self._hypotheses()]
        small = [one for one in tried if self._beyond(one) > SIGMAS]
        best = min(tried, key=lambda one: one.cost)
        # A small cause that explains as much comes first: half a degree is not a mirror.
        explained = any(one.cost < AS_GOOD * best.cost + 20.0 for one in small)
        clearly = best.fit.apart_m < BETTER * self._stated.apart_m - BETTER_M
        if not self._upright or (clearly and not explained):
            yield self._gross(*self._by_witnesses(tried))
        elif (mirrored := self._mirrored_unseen(tried)) is not None:
            yield self._gross(*mirrored)
        elif small:
            yield self._small(min(small, key=lambda one: one.cost))
        yield from self._unknown(tried)

    def _hypotheses(self) -> Iterator[Hypothesis]:
        """All that may be wrong, by a lidar that is about upright; else its mounting is."""
        steps, stated = self._steps, self._mounting
        for free, starts in WRONG_QUANTITIES.items() if self._upright else ():
            fit = fitted(steps, self._odometry, stated, free=free, starts=starts)
            yield Hypothesis(free=free, mounting=stated, fit=fit)
        mirrored = replace(stated, level_from_vehicle=stated.level_from_vehicle @ np.diag([1.0, -1.0]))
        for mounting in (stated, mirrored):
            fit = fitted(steps, self._odometry, mounting, free=("yaw_rad",), starts=AROUND)
            yield Hypothesis(free=("yaw_rad",), mounting=mounting, fit=fit, remounted=True)
        for reading in pose_readings(self._recording.trajectory) if self._upright else ():
            fit = fitted(steps, Odometry.of(reading.undo, steps.epoch_ns), stated)
            yield Hypothesis(mounting=stated, fit=fit, reading=reading)

    def _near_stated(self, one: Hypothesis) -> bool:
        """One quantity is fitted, and the mounting is the stated one."""
        return len(one.free) == 1 and one.mounting is self._mounting

    def _beyond(self, one: Hypothesis) -> float:
        """Standard deviations by which a value near the stated one is beyond what is tolerated."""
        if not self._near_stated(one):
            return 0.0
        quantity, (value, sigma) = one.quantity, one.value
        off = abs(value - quantity.stated)
        if off > quantity.small or sigma > max(quantity.known, off / 10):
            return 0.0
        return (off - quantity.tolerated) / sigma

    def _mirrored_unseen(self, tried: Sequence[Hypothesis]) -> tuple[Hypothesis, str] | None:
        """Straight ahead, a mirror changes no motion; boxes see it."""
        good = [one for one in tried if one.remounted and one.fit.apart_m < self._stated.apart_m + 0.002]
        counts = [self._witnesses(one) for one in good]
        stated = _returns_in_boxes(self._recording, self._sweeps, self._recording.vehicle_from_lidar.rotation)
        if not counts or max(counts) < max(WITNESSES, 3 * stated):
            return None
        return good[int(np.argmax(counts))], f"; {max(counts)} returns in annotated boxes then, not {stated}"

    def _by_witnesses(self, tried: Sequence[Hypothesis]) -> tuple[Hypothesis, str]:
        """Of the hypotheses that explain the steps as well as the best, the one with most returns in boxes."""
        enough = AS_GOOD * min(one.cost for one in tried) + 20.0
        good = sorted((one for one in tried if one.cost < enough), key=lambda one: one.cost)
        if len(good) == 1:
            return good[0], ""
        counts = [self._witnesses(one) for one in good]
        most = int(np.argmax(counts))
        if counts[most] < max(WITNESSES, 2 * min(counts)):
            names = dict.fromkeys(self._named(one)[1] for one in good[1:] if len(one.free) <= 1)
            return good[0], "".join(f"; or {name}" for name in names)
        return good[most], f"; {counts[most]} returns in annotated boxes then, not {min(counts)}"

    def _witnesses(self, one: Hypothesis) -> int:
        rotation = self._rotation(one) if one.remounted else self._recording.vehicle_from_lidar.rotation
        return _returns_in_boxes(self._recording, self._sweeps, rotation)

    def _rotation(self, one: Hypothesis) -> Array:
        """(3, 3) float64, vehicle from points as the file gives them; of determinant -1 where they are mirrored."""
        level_from_vehicle = np.eye(3)
        level_from_vehicle[:2, :2] = one.mounting.axes(one.fit.of("yaw_rad")[0])
        return np.asarray(level_from_vehicle.T @ self._steps.lidar_from_level.T)

    def _named(self, one: Hypothesis) -> tuple[str, str]:
        """Field, and what it is if the hypothesis is right."""
        if one.remounted:
            stated = self._recording.vehicle_from_lidar.rotation
            return "lidar.vehicle_from_lidar, or the axes of the points", mounting_name(stated, self._rotation(one))
        if one.reading is not None:
            return one.reading.field, one.reading.description
        parts = []
        for free in filter(FACTORS.get, one.free):
            (factor, _), (field, reversed_field, names) = one.fit.of(free), FACTORS[free]
            name = names.get(_usual(factor, names), f"{factor:.3g} times as large")
            parts.append((reversed_field if abs(factor + 1.0) < 0.1 else field, name))
        if parts:
            return " and ".join(field for field, _ in parts), " and ".join(name for _, name in parts)
        return one.quantity.field, one.quantity.interval(*one.value)

    def _gross(self, one: Hypothesis, witnesses: str) -> Finding:
        field, name = self._named(one)
        what = f"sweeps {100 * self._stated.apart_m:.0f} cm apart" if self._upright else "a road that is not below"
        got = f"{what}; {100 * one.fit.apart_m:.1f} cm if this is {name}{witnesses}"
        times = len(self._steps.motion)
        if one.remounted:
            return new_finding("lidar-pose", got, file=calibration_file(self._recording), field=field, times=times)
        file = self._recording.trajectory.source
        return new_finding("ego-motion-unit", got, file=file, field=field, hint=_remedy(one), times=times)

    def _small(self, one: Hypothesis) -> Finding:
        quantity, (value, sigma) = one.quantity, one.value
        late, path = quantity is QUANTITIES["late_s"], self._recording.trajectory
        file, hint = self._late_clock(value) if late else (path.source, None)
        return new_finding(
            quantity.kind,
            f"{quantity.interval(value, sigma)}, as lidar sweeps meet best",
            file=calibration_file(self._recording) if quantity is QUANTITIES["yaw_rad"] else file,
            field=quantity.field,
            hint=hint,
            times=len(self._steps.motion),
        )

    def _late_clock(self, late_s: float) -> tuple[str, str]:
        """File and hint: annotated times say whether sweeps were moved."""
        sweeps_ns, annotated_ns = sweep_times(self._recording), annotated_times(self._recording)
        shift, odometry = f"{abs(1e3 * late_s):.0f} ms", self._recording.trajectory.source
        sweeps = f"sweeps are {shift} {'late: subtract it from' if late_s > 0 else 'early: add it to'} their times"
        ego = f"the ego-motion is {shift} {'early: add it to' if late_s > 0 else 'late: subtract it from'} its times"
        if len(annotated_ns):
            tolerated_ns, moved_ns = QUANTITIES["late_s"].tolerated * 1e9, sweeps_ns - round(late_s * 1e9)
            if np.median(distance_to(annotated_ns, sweeps_ns)) < tolerated_ns:
                return odometry, f"{ego}; annotations have the times of the sweeps"
            if np.median(distance_to(annotated_ns, moved_ns)) < 2 * tolerated_ns:
                return str(self._recording.sweeps[0].path.parent), f"{sweeps}; annotations have those times"
        return odometry, f"the clock of one of them: {sweeps}, or {ego}"

    def _unknown(self, tried: Sequence[Hypothesis]) -> Iterator[Undecided]:
        few = f"too few pairs of sweeps match ({len(self._steps.motion)})"
        for one in filter(self._near_stated, tried):
            about, (_, sigma) = one.quantity, one.value
            if sigma > about.known:
                known = f": known to {1.96 * about.scale * sigma:.3g} {about.unit} only"
                why = f"{about.why}, or {few}" if about.why else few
                yield Undecided(about=about.field, why=why + (known if sigma < about.small else ""))


def _usual(factor: float, names: dict[float, str]) -> float:
    """The known factor that a fitted one is, else itself."""
    near = [value for value in names if abs(factor - value) < max(0.06 * abs(value), 4e-4)]
    return min(near, key=lambda value: abs(value - factor), default=factor)


def _remedy(one: Hypothesis) -> str:
    """Hint where odometry of these factors, or of this reading, is right."""
    if one.reading is not None:
        return one.reading.hint
    usual = {FACTORS[free][0]: _usual(one.fit.of(free)[0], FACTORS[free][2]) for free in filter(FACTORS.get, one.free)}
    scaled = [f"multiply the {name} by {factor:.4g}" for name, factor in usual.items() if factor not in {0.0, 1.0}]
    return f"check unit and sign: {' and '.join(scaled)}" if scaled else "check unit and sign"
