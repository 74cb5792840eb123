"""Cameras against the static world: flow and edges seen in images, and those that calibration and lidar predict.

First the calibration as stated; where it predicts little of the flow, readings of it as people confuse them; where it
predicts most, a least squares for each cause on its own: rotation, focal length, centre, position, clock. A finding
names the one that fits best, if it does so clearly. Where the drive cannot tell, it says why.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bench.cameras import CameraModel, KannalaBrandtCamera, PinholeCamera
from bench.errors import ShapeError
from bench.geometry import RigidTransform
from bench.recordings import MountedCamera, Recording
from bench.validation.camera_fit import CAUSES, PARTS, SLICES, CameraFit, Fit
from bench.validation.drive import calibration_file
from bench.validation.findings import DEGREE, Finding, Severity, Undecided
from bench.validation.scan_matching import MeasuredMotion, measured_motion, scan_steps
from bench.validation.static_flow import SeenFlow, reduced, seen_flows
from bench.validation.static_readings import signed_axes

HALF_TURN = np.diag([-1.0, -1.0, 1.0])
OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # vehicle axes from camera axes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reading:
    """A calibration that may have been meant.

    Attributes:
        field: of the camera in the calibration, or "images".
        description: what was confused, as in "with ..."
        camera: so.
        mirrored: the images are.
    """

    field: str
    description: str
    camera: MountedCamera
    mirrored: bool = False

    def flows(self, flows: Sequence[SeenFlow]) -> list[SeenFlow]:
        """Flow as this reading sees it."""
        if not self.mirrored:
            return list(flows)
        mirror = np.array([-1, 1])
        return [
            replace(
                one,
                flow=one.flow[:, ::-1] * mirror.astype(np.float32),
                edges=replace(one.edges, offsets=one.edges.offsets[[0, 3, 2, 1], :, ::-1] * mirror.astype(np.int16)),
            )
            for one in flows
        ]


def readings(camera: MountedCamera, others: Sequence[MountedCamera]) -> Iterator[Reading]:
    """All that are tried.

    Args:
        camera: as stated.
        others: cameras whose images may be taken for those of this one, all at one size.
    """
    model, mounting = camera.model, camera.vehicle_from_camera
    rotation, place_m = mounting.rotation, mounting.translation_m

    def lens_of(description: str, model: CameraModel) -> Reading:
        return Reading(field="model", description=description, camera=replace(camera, model=model))

    def mounted(field: str, description: str, vehicle_from_camera: RigidTransform) -> Reading:
        there = replace(camera, vehicle_from_camera=vehicle_from_camera)
        return Reading(field=field, description=description, camera=there)

    def turned(description: str, matrix: np.ndarray) -> Reading:
        return mounted("vehicle_from_camera.quaternion_wxyz", description, RigidTransform(matrix, place_m))

    for factor in (0.5, 2.0):
        yield lens_of(f"the focal length times {factor:g}", zoomed(model, factor))
    for name, other_lens in _other_lenses(model):
        yield lens_of(name, other_lens)
    yield mounted("vehicle_from_camera", "the inverse of the mounting", mounting.inverse())
    w, x, y, z = mounting.quaternion_wxyz
    for order, numbers in (("x, y, z, w", (z, w, x, y)), ("w, x, y, z, given as x, y, z, w,", (x, y, z, w))):
        yield turned(f"the quaternion read as {order}", RigidTransform.from_quaternion(numbers, place_m).rotation)
    yield turned("the inverse of the rotation", rotation.T)
    yield turned("the camera frame read as x forward, y left, z up", rotation @ OPTICAL)
    yield turned("the camera frame read as x right, y down, z forward twice", rotation @ OPTICAL.T)
    yield turned("the images upside down", rotation @ HALF_TURN)
    yield Reading(field="images", description="the images mirrored", camera=camera, mirrored=True)
    for other in others:
        yield Reading(field="images", description=f"the images of {other.name}", camera=other)
    for matrix in signed_axes():
        if np.linalg.det(matrix) < 0 or np.array_equal(matrix, np.eye(3)):
            continue
        axes = ", ".join("{}{}".format("-" if row.sum() < 0 else "", "xyz"[int(np.abs(row).argmax())])
                         for row in matrix)  # fmt: skip
        yield turned(f"the camera's axes as {axes}", rotation @ matrix)


def zoomed(model: CameraModel, factor: float) -> CameraModel:
    """The lens with another focal length, in an image of the same size."""
    size = round(model.width * factor), round(model.height * factor)
    return replace(model.scaled(*size), width=model.width, height=model.height, principal_point=model.principal_point)


def _other_lenses(model: CameraModel) -> Iterator[tuple[str, CameraModel]]:
    """A pinhole for what is no pinhole and a fisheye for what is none, of the same focal length at the middle."""
    ray = np.array([[1e-4, 0.0, 1.0]])
    try:
        focal = float(np.abs(model.project(ray)[0][0, 0] - model.principal_point[0]) / 1e-4)
        if not isinstance(model, PinholeCamera):
            yield (
                "a pinhole lens",
                PinholeCamera(
                    width=model.width, height=model.height, principal_point=model.principal_point, focal=(focal, focal)
                ),
            )
        if not isinstance(model, KannalaBrandtCamera):
            yield "a fisheye lens", KannalaBrandtCamera(
                width=model.width, height=model.height, principal_point=model.principal_point,
                focal=(focal, focal), coefficients=(),
            )  # fmt: skip
    except ShapeError:
        return


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraLimits:
    """Size and certainty from which a deviation is reported; tuned on clean rendered drives.

    Attributes:
        predicted: share of the flow that a calibration must predict for anything to be said.
        sure: share that the best fit must predict; else the drive cannot tell, but for what is doubted, see `doubtful`.
        doubtful: share that the fit of one of `TOLD_AS_DOUBT` must predict to be told as a doubt, if it stands out.
        least: share that the best fit predicts in any drive that is right: clean drives have 0.86 and more by day, and
            a real one at night 0.36; wrong lenses and clocks there have up to 0.15.
        better: share that another reading predicts more than the stated one.
        mirrored: the same for mirrored images, where the stated ones predict enough: straight on they look alike.
        alike: of the returns that the stated calibration sees in the image, as many another reading must see.
        against: what the flow may lose to the edges, part of what a cause gains.
        as_well: causes that raise it by so much less may be the one as well.
        deviations: standard deviations that it must differ from 0.
        turn_spread_radps: standard deviation of the yaw rate over the drive, from which on it tells a clock; on a
            steady drive a wrong clock looks like a wrong position.
        speed_spread: the same of the speed, part of its mean.
        known_s: standard deviation up to which a clock counts as known.
    """

    predicted: float = 0.6
    sure: float = 0.84
    doubtful: float = 0.7
    least: float = 0.2
    better: float = 0.15
    mirrored: float = 0.05
    alike: float = 0.2
    against: float = 0.2
    as_well: float = 10.0
    deviations: float = 4.0
    turn_spread_radps: float = 1.5 * DEGREE
    speed_spread: float = 0.08
    known_s: float = 0.005


LIMITS = CameraLimits()
# Light that moves along with the vehicle looks like a position, not like these; and what looks much like each of them.
TOLD_AS_DOUBT = {"clock": (), "rotation": ("centre",)}
INTERVAL = 1.96
SMALLEST_PX = 16  # a side of images of which flow is computed
EXPECTED = "flow of the static world as camera calibration, lidar and ego-motion predict it ({})"


def check_cameras(recording: Recording) -> Iterator[Finding | Undecided]:
    """Verdicts on all cameras; none of a camera that fits."""
    for camera in recording.cameras.values():
        if (verdict := camera_verdict(recording, camera)) is not None:
            yield verdict


def camera_verdict(recording: Recording, camera: MountedCamera) -> Finding | Undecided | None:
    """Try a camera against the static world: what is wrong with it, or why the drive cannot tell; None if it fits."""

    def undecided(why: str) -> Undecided:
        return Undecided(about=f"calibration and clock of camera {camera.name}", why=why)

    seen = reduced(camera)
    if not recording.sweeps:
        return undecided("no lidar")
    if min(seen.model.width, seen.model.height) < SMALLEST_PX:
        return undecided(f"images below {SMALLEST_PX} px show no flow")
    measured = measured_motion(recording, scan_steps(recording))
    flows = list(seen_flows(recording, seen, measured))
    if not flows:
        return undecided("no flow is seen: too dark, too little texture, or the vehicle stands")
    stated = CameraFit(flows, recording.trajectory, seen, measured)
    clean = stated.fit(())
    wrong = clean is None or clean.share < LIMITS.predicted
    if (better := _best_reading(recording, seen, flows, measured, clean, all_readings=wrong)) is not None:
        return _misread(recording, camera, clean, *better)
    if clean is None:
        return undecided("too few lidar returns on texture in the image")
    causes = [cause for cause in CAUSES if cause != "clock" or _motion_changes(recording, flows)]
    fits = {cause: fit for cause in causes if (fit := stated.fit((cause,), beside=clean)) is not None}
    best = min(fits.values(), key=lambda fit: fit.cost)
    told = {cause: fit for cause, fit in fits.items() if _explains(cause, fit, clean) and _is_large(cause, fit)}
    if best.share < LIMITS.least:
        return _unlike(recording, camera, clean, best)
    if best.share < LIMITS.sure:
        doubt = f"only {100 * best.share:.0f} % of the flow is that of a static world"
        cause = next((cause for cause in TOLD_AS_DOUBT if _stands_out(cause, told, fits)), None)
        if cause is None:
            return undecided(doubt)
        likely = _deviation(recording, camera, cause, clean, fits[cause])
        return replace(likely, severity=Severity.WARNING, got=f"perhaps {likely.got}; {doubt}")
    if not told:
        return _unknown_clock(camera, fits.get("clock"))
    if (better := _best_reading(recording, seen, flows, measured, best, all_readings=True, better=0.0)) is not None:
        return _misread(recording, camera, clean, *better)
    ranked = sorted(told.items(), key=lambda entry: entry[1].cost)
    enough = ranked[0][1].cost + LIMITS.as_well
    first, *others = (_deviation(recording, camera, cause, clean, fit) for cause, fit in ranked if fit.cost < enough)
    return replace(
        first,
        got=first.got + "".join(f"; almost as well: {other.got}" for other in others),
        hint=first.hint + "".join(f"; or, in {other.field}, {other.hint}" for other in others),
    )


def _unknown_clock(camera: MountedCamera, fit: Fit | None) -> Undecided | None:
    """Why the drive cannot tell the clock of the images; None where it can."""
    sigma_s = np.inf if fit is None else float(fit.sigmas[SLICES["clock"]][0])
    if sigma_s < LIMITS.known_s:
        return None
    known = "" if fit is None else f": known to {1e3 * INTERVAL * sigma_s:.0f} ms only"
    why = f"the drive hardly brakes, speeds up or turns in and out{known}"
    return Undecided(about=f"clock of the images of camera {camera.name}", why=why)


def _explains(cause: str, fit: Fit, clean: Fit) -> bool:
    """A fit is clearly better, and not by edges against flow: a fence has many, all wrong in one way."""
    gain, of_flow = clean.cost - fit.cost, float((clean.losses - fit.losses).sum())
    return gain > PARTS[cause].gain and of_flow > -LIMITS.against * gain


def _stands_out(cause: str, told: Mapping[str, Fit], fits: Mapping[str, Fit]) -> bool:
    """A cause explains clearly more than any other that does not look the same."""
    others = min(fit.cost for other, fit in fits.items() if other != cause and other not in TOLD_AS_DOUBT[cause])
    fit = told.get(cause)
    return fit is not None and fit.share > LIMITS.doubtful and fit.cost < others - LIMITS.as_well


def _motion_changes(recording: Recording, flows: Sequence[SeenFlow]) -> bool:
    """The drive turns, brakes or accelerates enough that a shift of time shows."""
    times_ns = np.array([(flow.previous_ns, flow.current_ns) for flow in flows], dtype=np.int64)
    rotations, positions_m, _ = recording.trajectory.at(times_ns.ravel())
    rotations, positions_m = rotations.reshape(-1, 2, 3, 3), positions_m.reshape(-1, 2, 3)
    seconds = np.diff(times_ns, axis=1)[:, 0] / 1e9
    speeds = np.linalg.norm(positions_m[:, 1] - positions_m[:, 0], axis=1) / seconds
    turns = (rotations[:, 0].transpose(0, 2, 1) @ rotations[:, 1])[:, 1, 0] / seconds
    return bool(
        np.std(turns) > LIMITS.turn_spread_radps or np.std(speeds) > LIMITS.speed_spread * max(np.mean(speeds), 1.0)
    )


def _best_reading(
    recording: Recording,
    camera: MountedCamera,
    flows: Sequence[SeenFlow],
    measured: MeasuredMotion,
    stated: Fit | None,
    *,
    all_readings: bool,
    better: float = LIMITS.better,
) -> tuple[Reading, Fit] | None:
    """The reading that predicts clearly more of the flow than the stated calibration; None without one.

    Args:
        recording: the drive.
        camera: `reduced`.
        flows: of pairs of its images.
        measured: what the lidar says of the ego-motion.
        stated: fit of the stated calibration, or the best one so far; None where too little is seen by it.
        all_readings: try all of them, not mirrored images alone.
        better: share that one must predict more.
    """
    others = [reduced(other) for other in recording.cameras.values() if other.name != camera.name]
    same_size = [o for o in others if (o.model.width, o.model.height) == (camera.model.width, camera.model.height)]
    share = 0.0 if stated is None else stated.share
    tried: list[tuple[float, Reading, CameraFit]] = []
    for reading in readings(camera, same_size):
        if all_readings or reading.mirrored:
            fit = CameraFit(reading.flows(flows), recording.trajectory, reading.camera, measured)
            if fit.enough and (all_readings or fit.share() > share + LIMITS.mirrored):
                tried.append((fit.share(), reading, fit))
    most = max((fit.points for _, _, fit in tried), default=0)
    best = sorted((entry for entry in tried if entry[2].points > LIMITS.alike * most), key=lambda entry: -entry[0])[:3]
    fitted = [(reading, again) for _, reading, fit in best if (again := fit.fit(())) is not None]
    if not fitted:
        return None
    reading, fitting = max(fitted, key=lambda entry: entry[1].share)
    enough = max(LIMITS.predicted, share + (better if all_readings else LIMITS.mirrored))
    return (reading, fitting) if fitting.share > enough else None


def _unlike(recording: Recording, camera: MountedCamera, clean: Fit, best: Fit) -> Finding:
    return Finding(
        check="camera-flow",
        severity=Severity.WARNING,
        file=calibration_file(recording),
        field=f"cameras.{camera.name}, images of {camera.name}",
        expected=EXPECTED.format(camera.name) + f", of which at least {100 * LIMITS.least:.0f} % fits, at night too",
        got=f"{100 * clean.share:.0f} % of it; {100 * best.share:.0f} % by the calibration or clock that fits best",
        hint="another lens model or mounting, images of another drive or camera, or clocks that are tenths of a second "
        "apart; look at it by `view --calibration`",
    )


def _misread(recording: Recording, camera: MountedCamera, clean: Fit | None, reading: Reading, best: Fit) -> Finding:
    field = f"images of {camera.name}" if reading.field == "images" else f"cameras.{camera.name}.{reading.field}"
    before = "none of it is in the image" if clean is None else f"{clean.residual_px:.1f} px off"
    return Finding(
        check="camera-calibration",
        file=calibration_file(recording),
        field=field,
        expected=EXPECTED.format(camera.name),
        got=f"flow {before}; {best.residual_px:.1f} px with {reading.description}",
        hint=f"the camera's calibration fits with {reading.description}: correct it",
    )


def _is_large(cause: str, fit: Fit) -> bool:
    """A number of a cause is large, and certainly not small."""
    sizes, sigmas, smallest = np.abs(fit.values[SLICES[cause]]), fit.sigmas[SLICES[cause]], PARTS[cause].smallest
    large = sizes > np.maximum(smallest, LIMITS.deviations * sigmas)
    return bool((large & (sizes - INTERVAL * sigmas > smallest / 2)).any())


def _deviation(recording: Recording, camera: MountedCamera, cause: str, clean: Fit, best: Fit) -> Finding:
    values, half = best.values[SLICES[cause]], INTERVAL * best.sigmas[SLICES[cause]]
    field = f"cameras.{camera.name}"
    mounting = f"{field}.vehicle_from_camera"
    if cause == "clock":
        milliseconds, interval = -1e3 * values[0], 1e3 * half[0]
        late = "late" if milliseconds > 0 else "early"
        return Finding(
            check="image-clock",
            file=str(recording.root / "images"),
            field=f"images of {camera.name}",
            expected="image times in the clock of the ego-motion",
            got=f"images {abs(milliseconds):.0f} ms {late} (95 % interval +- {interval:.0f} ms); {_fall(clean, best)}",
            hint=f"{'subtract' if milliseconds > 0 else 'add'} {abs(milliseconds):.0f} ms; or the clock of the sweeps "
            f"is as much {'early' if milliseconds > 0 else 'late'}, if boxes disagree with it alike, or that of the "
            "ego-motion, if the lidar does",
        )
    if cause == "rotation":
        degrees, interval = values / DEGREE, half / DEGREE
        text = ", ".join(
            f"{abs(value):.1f} +- {around:.1f} degrees {ways[int(value < 0)]}"
            for value, around, ways in zip(
                degrees,
                interval,
                (("up", "down"), ("to its right", "to its left"), ("clockwise", "anticlockwise")),
                strict=True,
            )
        )
        got, field = f"a camera that is turned against its stated mounting: {text}", f"{mounting}.quaternion_wxyz"
        hint = "turn the stated mounting so, about the camera's own axes"
    elif cause == "focal":
        percent, interval_percent = 100.0 * float(np.expm1(values[0])), 100.0 * float(half[0])
        way = "longer" if percent > 0 else "shorter"
        got = f"a focal length {abs(percent):.1f} +- {interval_percent:.1f} % {way} than stated"
        field, hint = f"{field}.model", f"multiply the lens's scale (focal or coefficients) by {np.exp(values[0]):.3f}"
    elif cause == "centre":
        got = (
            f"a centre {values[0]:+.1f} +- {half[0]:.1f} px to the right and {values[1]:+.1f} +- {half[1]:.1f} px down"
        )
        field, hint = f"{field}.model.principal_point", "add that to the principal point (the image as evaluated)"
    else:
        got = "a camera {:+.2f} m to the front, {:+.2f} m to the left, {:+.2f} m up".format(*values)
        got += " (95 % intervals +- {:.2f}, {:.2f}, {:.2f} m)".format(*half)
        field, hint = f"{mounting}.translation_m", "add that to the stated position of the camera"
    return Finding(
        check="camera-calibration",
        severity=Severity.WARNING,
        file=calibration_file(recording),
        field=field,
        expected=EXPECTED.format(camera.name),
        got=f"{got}; {_fall(clean, best)}",
        hint=hint,
    )


def _fall(clean: Fit, best: Fit) -> str:
    return f"with that the residual of the flow falls from {clean.residual_px:.2f} to {best.residual_px:.2f} px"
