"""The static world stands still between sweeps: which of odometry, mounting and clock has to change so that it does.

The lidar's motion is measured once (`scan_matching`); hypotheses are compared by how well they explain it
(`lidar_motion`), and the best is named. Motion alone cannot tell some of them apart: a vehicle seen in a mirror drives
as one whose yaw rate has the other sign. There annotated boxes decide: the mounting that brings returns into them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from bench.recordings import Recording
from bench.validation.drive import annotated_times, calibration_file, distance_to, sweep_times
from bench.validation.findings import DEGREE, Finding, Severity, Undecided
from bench.validation.lidar_motion import (
    PARAMETERS,
    QUANTITIES,
    STATED,
    Comparison,
    Fit,
    Mounting,
    Odometry,
    Quantity,
    level_steps,
)
from bench.validation.scan_matching import MATCHING, neighbouring, scan_steps
from bench.validation.static_readings import (
    PoseReading,
    mounting_name,
    pose_readings,
    returns_in_boxes,
    road_plane,
    some_sweeps,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdicts:
    """Limits from which a fitted value is reported.

    Attributes:
        sigmas: standard deviations beyond what is tolerated.
        better: factor by which distances between sweeps have to fall where a sign, an axis or a unit is to change.
        better_m: by how much at least, m.
        as_good: factor of the smallest cost within which hypotheses explain the steps equally well.
        least_steps: matched pairs of sweeps.
        tilt_rad: between the road that is seen and the road as stated, beyond which axes are permuted.
        least_path_m: path of the lidar between two sweeps; where it stands, a wall looks like a road.
        witnesses: returns in annotated boxes that decide.
    """

    sigmas: float = 4.0
    better: float = 0.6
    better_m: float = 0.01
    as_good: float = 1.3
    least_steps: int = 6
    tilt_rad: float = 0.5
    least_path_m: float = 0.05
    witnesses: int = 100


VERDICTS = Verdicts()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypothesis:
    """One cause.

    Attributes:
        free: quantities that are fitted, of `QUANTITIES`; the cause comes first.
        mounting: of the lidar; the stated one where the cause is another.
        starts: values at which the fit begins.
        remounted: the mounting itself is the cause.
        reading: how poses were misread, where that is the cause; nothing is fitted then.
        odometry: of that reading; None for the stated one.
    """

    free: tuple[str, ...]
    mounting: Mounting
    starts: tuple[Array, ...]
    remounted: bool = False
    reading: PoseReading | None = None
    odometry: Odometry | None = None

    @property
    def quantity(self) -> Quantity:
        """The cause."""
        return QUANTITIES[self.free[0]]


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
AROUND = tuple(_at(yaw_rad=angle) for angle in np.radians(np.arange(-180, 180, 45)))


def _hypotheses(stated: Mounting) -> list[Hypothesis]:
    mirrored = replace(stated, level_from_vehicle=stated.level_from_vehicle @ np.diag([1.0, -1.0]))
    both = [(s, t) for s, t in product((1.0, *SPEEDS), (1.0, *TURNS)) if s * t != 0 and (s, t) != (1.0, 1.0)]
    odometry = {
        ("late_s",): tuple(_at(late_s=late) for late in (-0.1, -0.03, 0.03, 0.1)),
        ("bias_radps",): (STATED,),
        ("speed",): tuple(_at(speed=factor) for factor in (1.0, *SPEEDS)),
        ("turn",): tuple(_at(turn=factor) for factor in (1.0, *TURNS)),
        ("speed", "turn"): tuple(_at(speed=s, turn=t) for s, t in both if abs(s) == 1.0 or s < 0.5),
    }
    return [
        *(Hypothesis(free=free, mounting=stated, starts=starts) for free, starts in odometry.items()),
        Hypothesis(free=("yaw_rad",), mounting=stated, starts=AROUND, remounted=True),
        Hypothesis(free=("yaw_rad",), mounting=mirrored, starts=AROUND, remounted=True),
    ]


def check_static_world(recording: Recording) -> Iterator[Finding | Undecided]:
    """Clock, mounting of the lidar and ego-motion, from sweeps that have to meet."""
    steps = scan_steps(recording)
    if len(steps) < VERDICTS.least_steps:
        pairs = int(neighbouring(recording).sum())
        if not recording.sweeps:
            why = "no lidar sweeps"
        elif pairs < VERDICTS.least_steps:
            why = "{} of {} sweeps follow another by {:g} to {:g} s, at least {} are needed".format(
                pairs, len(recording.sweeps), *MATCHING.apart_s, VERDICTS.least_steps
            )
        else:
            why = f"{len(steps)} of {pairs} neighbouring sweeps see enough of the same surfaces, fewer than needed"
        yield Undecided(about="ego-motion, clock and mounting of the lidar", why=why)
        return
    path_m = np.median([step.path_m for step in steps], axis=0)
    stands = bool(np.linalg.norm(path_m) < VERDICTS.least_path_m)
    seen = None if stands else road_plane(some_sweeps(recording), path_m)
    stated = recording.vehicle_from_lidar
    up, height_m = stated.rotation[2], float(stated.translation_m[2]) - recording.ground_m
    upright = seen is None or float(seen.up @ up) > np.cos(VERDICTS.tilt_rad)
    if seen is not None and not upright:
        up, height_m = seen.up, seen.height_m
    forward = stated.rotation[0] if abs(up @ stated.rotation[0]) < 0.7 else stated.rotation[1]
    level = level_steps(steps, up, height_m, forward)
    compared = Comparison(steps=level, odometry=Odometry.of(recording.trajectory, level.epoch_ns))
    yield from _Verdict(recording, compared, upright=upright).findings()


class _Verdict:
    """Compares hypotheses on the steps of one recording."""

    def __init__(self, recording: Recording, compared: Comparison, *, upright: bool) -> None:
        self._recording, self._compared, self._upright = recording, compared, upright
        lever_m = recording.vehicle_from_lidar.translation_m[:2]
        level = Mounting(level_from_vehicle=np.eye(2), lever_m=lever_m)
        self._mounting = compared.steps.stated(recording.vehicle_from_lidar) if upright else level
        self._stated = compared.fit(self._mounting)

    def findings(self) -> Iterator[Finding | Undecided]:
        """The cause that explains the steps, else the parameters that cannot be told."""
        path, epoch_ns = self._recording.trajectory, self._compared.steps.epoch_ns
        misread = [
            Hypothesis(
                free=(),
                mounting=self._mounting,
                starts=(STATED,),
                reading=reading,
                odometry=Odometry.of(read, epoch_ns),
            )
            for reading, read in pose_readings(path)
        ]
        tried = [
            (one, self._fit(one)) for one in (*_hypotheses(self._mounting), *misread) if self._upright or one.remounted
        ]
        small = [pair for pair in tried if self._beyond(*pair) > VERDICTS.sigmas]
        best = min(tried, key=_penalised)
        # A small cause that explains as much comes first: half a degree is not a mirror.
        explained = any(_penalised(pair) < VERDICTS.as_good * _penalised(best) + 20.0 for pair in small)
        if not self._upright or (self._clearly_better(best[1]) and not explained):
            yield self._gross(*self._by_witnesses(tried))
        elif (mirrored := self._mirrored_unseen(tried)) is not None:
            yield self._gross(*mirrored)
        elif small:
            yield self._small(*min(small, key=_penalised))
        yield from self._unknown(tried)

    def _fit(self, one: Hypothesis) -> Fit:
        compared = self._compared if one.odometry is None else replace(self._compared, odometry=one.odometry)
        return compared.fit(one.mounting, free=one.free, starts=one.starts)

    def _clearly_better(self, fit: Fit) -> bool:
        return fit.apart_m < VERDICTS.better * self._stated.apart_m - VERDICTS.better_m

    def _beyond(self, one: Hypothesis, fit: Fit) -> float:
        """Standard deviations by which a value near the stated one is beyond what is tolerated."""
        if not one.free:
            return 0.0
        value, sigma = fit.of(one.free[0])
        off = abs(value - one.quantity.stated)
        vague = sigma > max(one.quantity.known, off / 10)
        if len(one.free) > 1 or one.mounting is not self._mounting or off > one.quantity.small or vague:
            return 0.0
        return (off - one.quantity.tolerated) / sigma

    def _mirrored_unseen(self, tried: Sequence[tuple[Hypothesis, Fit]]) -> tuple[Hypothesis, Fit, str] | None:
        """Straight ahead, a mirror changes no motion; boxes see it."""
        good = [(one, fit) for one, fit in tried if one.remounted and fit.apart_m < self._stated.apart_m + 0.002]
        counts = [self._witnesses(*pair) for pair in good]
        stated = returns_in_boxes(
            self._recording, some_sweeps(self._recording), self._recording.vehicle_from_lidar.rotation
        )
        if not counts or max(counts) < max(VERDICTS.witnesses, 3 * stated):
            return None
        return *good[int(np.argmax(counts))], f"; {max(counts)} returns in annotated boxes then, not {stated}"

    def _by_witnesses(self, tried: Sequence[tuple[Hypothesis, Fit]]) -> tuple[Hypothesis, Fit, str]:
        """Of the hypotheses that explain the steps as well as the best, the one with most returns in boxes."""
        least = min(map(_penalised, tried))
        good = sorted((p for p in tried if _penalised(p) < VERDICTS.as_good * least + 20.0), key=_penalised)
        if len(good) == 1:
            return *good[0], ""
        counts = [self._witnesses(*pair) for pair in good]
        most = int(np.argmax(counts))
        if counts[most] < max(VERDICTS.witnesses, 2 * min(counts)):
            names = dict.fromkeys(self._named(*pair)[1] for pair in good[1:] if len(pair[0].free) <= 1)
            return *good[0], "".join(f"; or {name}" for name in names)
        return *good[most], f"; {counts[most]} returns in annotated boxes then, not {min(counts)}"

    def _witnesses(self, one: Hypothesis, fit: Fit) -> int:
        rotation = self._rotation(one, fit) if one.remounted else self._recording.vehicle_from_lidar.rotation
        return returns_in_boxes(self._recording, some_sweeps(self._recording), rotation)

    def _rotation(self, one: Hypothesis, fit: Fit) -> Array:
        """(3, 3) float64, vehicle from points as the file gives them; of determinant -1 where they are mirrored."""
        level_from_vehicle = np.eye(3)
        level_from_vehicle[:2, :2] = one.mounting.turned(fit.values[-1]).level_from_vehicle
        return np.asarray(level_from_vehicle.T @ self._compared.steps.lidar_from_level.T)

    def _named(self, one: Hypothesis, fit: Fit) -> tuple[str, str]:
        """Field, and what it is if the hypothesis is right."""
        if one.remounted:
            stated = self._recording.vehicle_from_lidar.rotation
            return "lidar.vehicle_from_lidar, or the axes of the points", mounting_name(
                stated, self._rotation(one, fit)
            )
        if one.reading is not None:
            return "poses", one.reading.description
        speed, turn = fit.values[1:3]
        parts = []
        if "speed" in one.free:
            field = "gear or sign of the speed" if abs(speed + 1.0) < 0.1 else "speed"
            parts.append((field, _factor_name(float(speed), SPEEDS)))
        if "turn" in one.free:
            field = "sign of the yaw rate" if abs(turn + 1.0) < 0.1 else "yaw rate"
            parts.append((field, _factor_name(float(turn), TURNS)))
        if parts:
            return " and ".join(field for field, _ in parts), " and ".join(name for _, name in parts)
        return self._value(one, fit)

    def _value(self, one: Hypothesis, fit: Fit) -> tuple[str, str]:
        """Field, and the fitted value with its interval of 95 %."""
        value, sigma = fit.of(one.free[0])
        about = one.quantity
        value, half = about.scale * (value - about.stated), 1.96 * about.scale * sigma
        return about.field, f"{value:+.3g} [{value - half:+.3g}, {value + half:+.3g}] {about.unit}"

    def _gross(self, one: Hypothesis, fit: Fit, witnesses: str) -> Finding:
        field, name = self._named(one, fit)
        what = f"sweeps {100 * self._stated.apart_m:.0f} cm apart" if self._upright else "a road that is not below"
        return Finding(
            check="lidar-pose" if one.remounted else "ego-motion-unit",
            file=calibration_file(self._recording) if one.remounted else str(self._recording.trajectory.source),
            field=field,
            expected="mounting of the lidar and ego-motion with which neighbouring lidar sweeps meet",
            got=f"{what}; {100 * fit.apart_m:.1f} cm if this is {name}{witnesses}",
            hint="correct the axes of the points, or the mounting" if one.remounted else _remedy(one, fit),
            times=len(self._compared.steps.motion),
        )

    def _small(self, one: Hypothesis, fit: Fit) -> Finding:
        cause = one.free[0]
        field, value = self._value(one, fit)
        file, check, hint = str(self._recording.trajectory.source), "ego-motion-scale", "correct it by that"
        if cause == "yaw_rad":
            file, check = calibration_file(self._recording), "lidar-pose"
            hint = "turn vehicle_from_lidar by that about the vehicle's z (positive to the left)"
        if cause == "late_s":
            check, (file, hint) = "clock-offset", self._late_clock(float(fit.values[0]))
        return Finding(
            check=check,
            severity=Severity.ERROR if cause == "late_s" else Severity.WARNING,
            file=file,
            field=field,
            expected=one.quantity.expected,
            got=f"{value}, as lidar sweeps meet best",
            hint=hint,
            times=len(self._compared.steps.motion),
        )

    def _late_clock(self, late_s: float) -> tuple[str, str]:
        """File and hint: annotated times say whether sweeps were moved."""
        sweeps_ns = sweep_times(self._recording)
        annotated_ns = annotated_times(self._recording)
        odometry = str(self._recording.trajectory.source)
        shift = f"{abs(1e3 * late_s):.0f} ms"
        sweeps = f"sweeps are {shift} {'late: subtract it from' if late_s > 0 else 'early: add it to'} their times"
        ego = f"the ego-motion is {shift} {'early: add it to' if late_s > 0 else 'late: subtract it from'} its times"
        if len(annotated_ns):
            on_time = np.median(distance_to(annotated_ns, sweeps_ns)) < QUANTITIES["late_s"].tolerated * 1e9
            moved = sweeps_ns - round(late_s * 1e9)
            if on_time:
                return odometry, f"{ego}; annotations have the times of the sweeps"
            if np.median(distance_to(annotated_ns, moved)) < 2 * QUANTITIES["late_s"].tolerated * 1e9:
                return str(self._recording.sweeps[0].path.parent), f"{sweeps}; annotations have those times"
        return odometry, f"the clock of one of them: {sweeps}, or {ego}"

    def _unknown(self, tried: Sequence[tuple[Hypothesis, Fit]]) -> Iterator[Undecided]:
        few = f"too few pairs of sweeps match ({len(self._compared.steps.motion)})"
        for one, fit in tried:
            if not one.free:
                continue
            about, (_, sigma) = one.quantity, fit.of(one.free[0])
            if len(one.free) == 1 and one.mounting is self._mounting and sigma > about.known:
                known = f": known to {1.96 * about.scale * sigma:.2g} {about.unit} only"
                why = f"{about.why}, or {few}" if about.why else few
                yield Undecided(about=about.field, why=why + (known if sigma < about.small else ""))


def _penalised(pair: tuple[Hypothesis, Fit]) -> float:
    """Cost with ten for a quantity that is fitted, and forty for two: one mistake is likelier than two."""
    return pair[1].cost + 10.0 * len(pair[0].free) ** 2


def _usual(factor: float, names: dict[float, str]) -> float:
    """The known factor that a fitted one is, else itself."""
    near = [value for value in names if abs(factor - value) < max(0.06 * abs(value), 4e-4)]
    return min(near, key=lambda value: abs(value - factor), default=factor)


def _factor_name(factor: float, names: dict[float, str]) -> str:
    return names.get(_usual(factor, names), f"{factor:.3g} times as large")


def _remedy(one: Hypothesis, fit: Fit) -> str:
    """Hint where odometry of these factors, or of this reading, is right."""
    if one.reading is not None:
        return one.reading.hint
    known = (("speed", "the speed", SPEEDS), ("turn", "the yaw rate", TURNS))
    usual = {name: _usual(fit.of(free)[0], names) for free, name, names in known if free in one.free}
    scaled = [f"multiply {name} by {factor:.4g}" for name, factor in usual.items() if factor not in {0.0, 1.0}]
    return f"check unit and sign: {' and '.join(scaled)}" if scaled else "check unit and sign"
