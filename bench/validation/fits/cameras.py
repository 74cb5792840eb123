"""Cameras against the static world: flow and edges seen in images, and those that calibration and lidar predict.

First the calibration as stated; where it predicts little of the flow, readings of it as people confuse them; where it
predicts most, a least squares for each cause on its own: rotation, focal length, centre, position, clock. A finding
names the one that fits best, if it does so clearly. Where the drive cannot tell, it says why.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from bench.recordings import MountedCamera, Recording
from bench.validation.findings import Finding, Severity, Undecided, new_finding
from bench.validation.fits.camera_fit import CAUSES, SLICES, UNKNOWNS, CameraFit, Fit
from bench.validation.fits.flow import SeenFlow, mirrored, reduced, seen_flows
from bench.validation.fits.readings import DEGREE, Reading, camera_readings
from bench.validation.fits.scan_matching import MeasuredMotion, measured_motion, scan_steps

# Size and certainty from which a deviation is reported; tuned on clean rendered drives.
PREDICTED = 0.6  # share of the flow that a calibration must predict for anything to be said
SURE = 0.84  # share that the best fit must predict; else the drive cannot tell, but for what is doubted, see `DOUBTFUL`
DOUBTFUL = 0.7  # share that the fit of one of `TOLD_AS_DOUBT` must predict to be told as a doubt, if it stands out
# Share that the best fit predicts in any drive that is right: clean drives have 0.86 and more by day, and a real one
# at night 0.36; wrong lenses and clocks there have up to 0.15.
LEAST_STATIC = 0.2
BETTER = 0.15  # share that another reading predicts more than the stated one
MIRRORED = 0.05  # the same for mirrored images, where the stated ones predict enough: straight on they look alike
ALIKE = 0.2  # of the returns that the stated calibration sees in the image, as many another reading must see
# Part of the flow's residual, and px, by which it must fall for a rotation to be told by the gain of the smallest one;
# where it falls by less, the gain must be as much larger as the rotation.
FALLS = (0.1, 0.05)
AGAINST = 0.2  # what the flow may lose to the edges, part of what a cause gains
AS_WELL = 10.0  # causes that raise it by so much less may be the one as well
SIGMAS = 4.0  # standard deviations that it must differ from 0
# Standard deviation of the yaw rate over the drive, from which on it tells a clock; on a steady drive a wrong clock
# looks like a wrong position.
TURN_SPREAD_RADPS = 1.5 * DEGREE
SPEED_SPREAD = 0.08  # the same of the speed, part of its mean
KNOWN_S = 0.005  # standard deviation up to which a clock counts as known
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
    wrong = clean is None or clean.share < PREDICTED
    if (better := _best_reading(recording, seen, flows, measured, clean, all_readings=wrong)) is not None:
        return _misread(camera, clean, *better)
    if clean is None:
        return undecided("too few lidar returns on texture in the image")
    causes = [cause for cause in CAUSES if cause != "clock" or _motion_changes(recording, flows)]
    fits = {cause: fit for cause in causes if (fit := stated.fit((cause,), beside=clean)) is not None}
    best = min(fits.values(), key=lambda fit: fit.cost)
    told = {cause: fit for cause, fit in fits.items() if _explains(cause, fit, clean) and _is_large(cause, fit)}
    if best.share < LEAST_STATIC:
        got = f"{100 * clean.share:.0f} % of it; {100 * best.share:.0f} % by the calibration or clock that fits best"
        field, flow = f"cameras.{camera.name}, images of {camera.name}", EXPECTED.format(camera.name)
        return new_finding("camera-flow", got, field=field, flow=flow, least=100 * LEAST_STATIC)
    if best.share < SURE:
        doubt = f"only {100 * best.share:.0f} % of the flow is that of a static world"
        cause = next((cause for cause in TOLD_AS_DOUBT if _stands_out(cause, told, fits)), None)
        if cause is None:
            return undecided(doubt)
        likely = _deviation(recording, camera, cause, clean, fits[cause])
        return replace(likely, severity=Severity.WARNING, got=f"perhaps {likely.got}; {doubt}")
    if not told:
        return _unknown_clock(camera, fits.get("clock"))
    if (better := _best_reading(recording, seen, flows, measured, best, all_readings=True, better=0.0)) is not None:
        return _misread(camera, clean, *better)
    ranked = sorted(told.items(), key=lambda entry: entry[1].cost)
    enough = ranked[0][1].cost + AS_WELL
    first, *others = (_deviation(recording, camera, cause, clean, fit) for cause, fit in ranked if fit.cost < enough)
    return replace(
        first,
        field=" or ".join(dict.fromkeys(str(one.field) for one in (first, *others))),
        got=first.got + "".join(f"; almost as well: {other.got}" for other in others),
        hint=first.hint + "".join(f"; or, in {other.field}, {other.hint}" for other in others),
    )


def _unknown_clock(camera: MountedCamera, fit: Fit | None) -> Undecided | None:
    """Why the drive cannot tell the clock of the images; None where it can."""
    sigma_s = np.inf if fit is None else float(fit.sigmas[SLICES["clock"]][0])
    if sigma_s < KNOWN_S:
        return None
    known = "" if fit is None else f": known to {1e3 * INTERVAL * sigma_s:.0f} ms only"
    why = f"the drive has too little braking, acceleration or turning{known}"
    return Undecided(about=f"clock of the images of camera {camera.name}", why=why)


def _explains(cause: str, fit: Fit, clean: Fit) -> bool:
    """A fit is clearly better, and not by edges against flow: a fence has many, all wrong in one way.

    A turn of degrees moves all flow, so that one which hardly explains any is a chance of few edges.
    """
    gain, of_flow, least = clean.cost - fit.cost, float((clean.losses - fit.losses).sum()), UNKNOWNS[cause].gain
    share, px = FALLS
    if cause == "rotation" and clean.residual_px - fit.residual_px < max(share * clean.residual_px, px):
        least *= max(float(np.abs(fit.values[SLICES[cause]]).max()) / UNKNOWNS[cause].smallest, 1.0)
    return gain > least and of_flow > -AGAINST * gain


def _is_large(cause: str, fit: Fit) -> bool:
    """A number of a cause is large, and certainly not small."""
    sizes, sigmas, smallest = np.abs(fit.values[SLICES[cause]]), fit.sigmas[SLICES[cause]], UNKNOWNS[cause].smallest
    large = sizes > np.maximum(smallest, SIGMAS * sigmas)
    return bool((large & (sizes - INTERVAL * sigmas > smallest / 2)).any())


def _stands_out(cause: str, told: Mapping[str, Fit], fits: Mapping[str, Fit]) -> bool:
    """A cause explains clearly more than any other that does not look the same."""
    others = min(fit.cost for other, fit in fits.items() if other != cause and other not in TOLD_AS_DOUBT[cause])
    fit = told.get(cause)
    return fit is not None and fit.share > DOUBTFUL and fit.cost < others - AS_WELL


def _motion_changes(recording: Recording, flows: Sequence[SeenFlow]) -> bool:
    """The drive turns, brakes or accelerates enough that a shift of time shows."""
    times_ns = np.array([(flow.previous_ns, flow.current_ns) for flow in flows], dtype=np.int64)
    rotations, positions_m, _ = recording.trajectory.at(times_ns.ravel())
    rotations, positions_m = rotations.reshape(-1, 2, 3, 3), positions_m.reshape(-1, 2, 3)
    seconds = np.diff(times_ns, axis=1)[:, 0] / 1e9
    speeds = np.linalg.norm(positions_m[:, 1] - positions_m[:, 0], axis=1) / seconds
    turns = (rotations[:, 0].transpose(0, 2, 1) @ rotations[:, 1])[:, 1, 0] / seconds
    return bool(np.std(turns) > TURN_SPREAD_RADPS or np.std(speeds) > SPEED_SPREAD * max(np.mean(speeds), 1.0))


def _best_reading(
    recording: Recording,
    camera: MountedCamera,
    flows: Sequence[SeenFlow],
    measured: MeasuredMotion,
    stated: Fit | None,
    *,
    all_readings: bool,
    better: float = BETTER,
) -> tuple[Reading[MountedCamera], Fit] | None:
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
    tried: list[tuple[float, Reading[MountedCamera], CameraFit]] = []
    for reading in camera_readings(camera, same_size):
        if all_readings or reading.elsewhere:
            seen = mirrored(flows) if reading.elsewhere else flows
            fit = CameraFit(seen, recording.trajectory, reading.undo, measured)
            if fit.points and (all_readings or fit.share() > share + MIRRORED):
                tried.append((fit.share(), reading, fit))
    most = max((fit.points for _, _, fit in tried), default=0)
    best = sorted((entry for entry in tried if entry[2].points > ALIKE * most), key=lambda entry: -entry[0])[:3]
    fitted = [(reading, again) for _, reading, fit in best if (again := fit.fit(())) is not None]
    if not fitted:
        return None
    reading, fitting = max(fitted, key=lambda entry: entry[1].share)
    enough = max(PREDICTED, share + (better if all_readings else MIRRORED))
    return (reading, fitting) if fitting.share > enough else None


def _misread(camera: MountedCamera, clean: Fit | None, reading: Reading[MountedCamera], best: Fit) -> Finding:
    before = "none of it is in the image" if clean is None else f"{clean.residual_px:.1f} px off"
    return new_finding(
        "camera-calibration",
        f"flow {before}; {best.residual_px:.1f} px with {reading.description}",
        field=f"images of {camera.name}" if reading.field == "images" else f"cameras.{camera.name}.{reading.field}",
        hint=f"the camera's calibration fits with {reading.description}: correct it",
        flow=EXPECTED.format(camera.name),
    )


# Field of the camera that a cause is in, units in one of its numbers, and digits that are told.
DEVIATIONS = {
    "rotation": ("vehicle_from_camera.quaternion_wxyz", 1 / DEGREE, 1),
    "focal": ("model", 100.0, 1),
    "centre": ("model.principal_point", 1.0, 1),
    "position": ("vehicle_from_camera.translation_m", 1.0, 2),
}


def _deviation(recording: Recording, camera: MountedCamera, cause: str, clean: Fit, best: Fit) -> Finding:
    values, half = best.values[SLICES[cause]], INTERVAL * best.sigmas[SLICES[cause]]
    fall = f"with that the residual of the flow falls from {clean.residual_px:.2f} to {best.residual_px:.2f} px"
    if cause == "clock":
        late, interval = -1e3 * float(values[0]), 1e3 * float(half[0])
        word, change, other = ("late", "subtract", "early") if late > 0 else ("early", "add", "late")
        got = f"images {abs(late):.0f} ms {word} (95 % interval +- {interval:.0f} ms); {fall}"
        hint = f"{change} {abs(late):.0f} ms; or the clock of the sweeps is as much {other}, if boxes disagree with it "
        hint += "alike, or that of the ego-motion, if the lidar does"
        file = recording.root / "images"
        return new_finding("image-clock", got, file=file, field=f"images of {camera.name}", hint=hint)
    field, scale, digits = DEVIATIONS[cause]
    scaled = 100.0 * np.expm1(values) if cause == "focal" else scale * values
    return new_finding(
        f"camera-calibration: {cause}",
        field=f"cameras.{camera.name}.{field}",
        numbers=[
            f"{value:+.{digits}f} +- {around:.{digits}f}" for value, around in zip(scaled, scale * half, strict=True)
        ],
        factor=float(np.exp(values[0])),
        fall=fall,
        flow=EXPECTED.format(camera.name),
    )
