"""Times of images, sweeps, ego-motion and annotations, each for itself and against each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from bench.recordings import ImageRef, Recording, SweepRef
from bench.validation.drive import (
    annotated_times,
    calibration_file,
    distance_to,
    nearest_to,
    sensor_times,
    sweep_times,
    times_of,
)
from bench.validation.findings import Finding, Severity, occurrences

OFF_RATE = 0.02  # of the stated time between images
JITTER = 0.25  # of an interval
MOST_JITTERY = 0.05  # of the intervals
NEAR_INTERVALS = 1.5
MOST_PARTS = 4  # rates of sensors that are triggered together are as small whole numbers
NEAR_RATIO = 0.01
LEAST_DRIFT_NS = 4_000_000  # at 10 m/s that moves a point by 4 cm
CRYSTAL_RATE = 500e-6  # crystals differ by 200 ppm at most, NTP slews by 500; motors and free triggers by more
LEAST_IMAGES = 10
MATCHED_NS = 1_000_000
LEAST_SWEEP_STEPS = 4
MOST_WITHOUT_SWEEP = 0.25  # of the annotated times; with more of them, annotations follow the images
UNPAIRED = "pairs across a gap are not evaluated"
OLDER_POINTS = "images there are scored by the points of another sweep, up to 100 ms away; files missing?"
NEAR_SWEEP_NS = 100_000_000


def check_clocks(recording: Recording) -> Iterator[Finding]:
    """Rates, gaps, jitter, and clocks that run apart."""
    for camera in recording.cameras:
        yield from _rate(recording, camera)
        yield from _gaps(
            recording.images[camera], recording.frame_interval_ns, "image", f"images of {camera}", UNPAIRED
        )
    if len(recording.sweeps) > LEAST_SWEEP_STEPS:
        interval_ns = float(np.median(np.diff(sweep_times(recording))))
        yield from _gaps(recording.sweeps, interval_ns, "sweep", "lidar sweeps", OLDER_POINTS)
    for what, times_ns in sensor_times(recording).items():
        yield from _jitter(times_ns, what)
    yield from _drift(recording)


def check_coverage(recording: Recording) -> Iterator[Finding]:
    """Images and sweeps without ego-motion, and images without a sweep."""
    sweeps_ns = sweep_times(recording)
    for what, times_ns in sensor_times(recording).items():
        yield from _without_motion(recording, times_ns, what)
        if not len(sweeps_ns):
            continue
        without_sweep = distance_to(times_ns, sweeps_ns) > NEAR_SWEEP_NS
        if without_sweep.any():
            none = bool(without_sweep.all())
            yield Finding(
                check="sensor-overlap",
                severity=Severity.ERROR if none else Severity.WARNING,
                field=what,
                expected="a lidar sweep within 100 ms of every image",
                got=f"none for {int(without_sweep.sum())} of {len(times_ns)} images",
                hint="check that both clocks have the same epoch" if none else "objects in them are not evaluated",
                **occurrences(without_sweep, times_ns),
            )


def check_annotation_times(recording: Recording) -> Iterator[Finding]:
    """Annotations outside of the recording, at times at which no sensor looked, or where a sweep is missing."""
    annotated_ns, sensors_ns = (
        annotated_times(recording),
        np.unique(np.concatenate([*sensor_times(recording).values()])),
    )
    if not len(annotated_ns) or not len(sensors_ns):
        return
    slack_ns = NEAR_INTERVALS * recording.frame_interval_ns
    outside = (annotated_ns < sensors_ns[0] - slack_ns) | (annotated_ns > sensors_ns[-1] + slack_ns)
    if outside.any():
        yield Finding(
            check="annotation-outside",
            field="timestamp",
            expected=f"times of the recording, {sensors_ns[0]} to {sensors_ns[-1]}",
            got=f"{int(outside.sum())} of {len(annotated_ns)} annotated times outside",
            hint="check the unit and the epoch of the clock; annotations of another recording?",
            **occurrences(outside, annotated_ns),
        )
    sweeps_ns = sweep_times(recording)
    unseen = (distance_to(annotated_ns, sensors_ns) > MATCHED_NS) & ~outside
    if unseen.any():
        yield Finding(
            check="annotation-time",
            severity=Severity.WARNING,
            field="timestamp",
            expected="the time of an image or of a sweep",
            got=f"{int(unseen.sum())} of {len(annotated_ns)} annotated times at neither",
            hint=_apart(annotated_ns[~outside], sweeps_ns),
            **occurrences(unseen, annotated_ns),
        )
    if not len(sweeps_ns):
        return
    without_sweep = distance_to(annotated_ns, sweeps_ns) > MATCHED_NS
    lost = without_sweep & ~outside & ~unseen
    if lost.any() and without_sweep.mean() < MOST_WITHOUT_SWEEP:
        yield Finding(
            check="annotation-sweep",
            severity=Severity.WARNING,
            field="timestamp",
            expected="a lidar sweep at each annotated time, as at most of them",
            got=f"{int(lost.sum())} of {len(annotated_ns)} annotated times without one",
            hint=OLDER_POINTS,
            **occurrences(lost, annotated_ns),
        )


def _apart(annotated_ns: NDArray[np.int64], sweeps_ns: NDArray[np.int64]) -> str:
    """Hint where all annotated times are as far from the nearest sweep: one of the two clocks is wrong."""
    if not len(sweeps_ns) or not len(annotated_ns):
        return ""
    late_ns = nearest_to(annotated_ns, sweeps_ns) - annotated_ns
    if np.ptp(late_ns) > MATCHED_NS:
        return ""
    late_ms = float(np.median(late_ns)) / 1e6
    sweeps, boxes = ("late", "early") if late_ms > 0 else ("early", "late")
    return (
        f"each is {abs(late_ms):.1f} ms from the nearest sweep: the clock of the sweeps is {sweeps} by that, or the "
        f"boxes are {boxes}"
    )


def _rate(recording: Recording, camera: str) -> Iterator[Finding]:
    steps_ns = np.diff(times_of(recording, camera))
    if not len(steps_ns):
        yield Finding(
            check="image-times",
            field=f"images of {camera}",
            expected="at least two images",
            got=str(len(steps_ns) + 1 if recording.images[camera] else 0),
        )
        return
    median_ns = float(np.median(steps_ns))
    ratio = median_ns / recording.frame_interval_ns
    if abs(ratio - 1.0) <= OFF_RATE:
        return
    unit = {1e-3: "microseconds", 1e-6: "milliseconds", 1e-9: "seconds"}
    meant = next((name for factor, name in unit.items() if abs(ratio / factor - 1) < 0.1), None)
    yield Finding(
        check="image-times",
        file=calibration_file(recording),
        field="frame_interval_ns",
        expected=f"the time between images of {camera}, median {median_ns:.0f} ns",
        got=f"{recording.frame_interval_ns} ns",
        hint=f"the times look like {meant}" if meant else "pairs further apart than 1.5 intervals are not evaluated",
    )


def _gaps(
    seen: Sequence[ImageRef | SweepRef], interval_ns: float, name: str, field: str, hint: str
) -> Iterator[Finding]:
    times_ns = np.array([one.timestamp_ns for one in seen], dtype=np.int64)
    steps_ns = np.diff(times_ns)
    gaps = steps_ns > NEAR_INTERVALS * interval_ns
    if not 0 < gaps.sum() <= len(steps_ns) / 2:  # with more it is the stated interval that is wrong
        return
    yield Finding(
        check=f"{name}-gaps",
        severity=Severity.WARNING,
        file=str(seen[int(np.argmax(gaps)) + 1].path),
        field=field,
        expected=f"{name}s about {interval_ns / 1e6:.1f} ms apart",
        got=f"{int(gaps.sum())} gaps, the longest {steps_ns[gaps].max() / 1e6:.1f} ms",
        hint=hint,
        **occurrences(gaps, times_ns[1:]),
    )


def _jitter(times_ns: NDArray[np.int64], what: str) -> Iterator[Finding]:
    steps_ns = np.diff(times_ns)
    if len(steps_ns) < LEAST_IMAGES:
        return
    middle_ns = float(np.median(steps_ns))
    whole = np.maximum(np.round(steps_ns / middle_ns), 1.0)  # a missing one is a gap, not jitter
    unsteady = np.abs(steps_ns - whole * middle_ns) > JITTER * middle_ns
    if unsteady.mean() > MOST_JITTERY:
        yield Finding(
            check="irregular-times",
            severity=Severity.WARNING,
            field=what,
            expected=f"steps of about {middle_ns / 1e6:.1f} ms",
            got=f"{int(unsteady.sum())} of {len(steps_ns)} more than a quarter off",
            hint="times of arrival instead of exposure?",
            **occurrences(unsteady, times_ns[1:]),
        )


def _without_motion(recording: Recording, times_ns: NDArray[np.int64], what: str) -> Iterator[Finding]:
    if not len(times_ns):
        return
    _, _, valid = recording.trajectory.at(times_ns)
    if not valid.all():
        first_ns, last_ns = (int(recording.trajectory.timestamps_ns[i]) for i in (0, -1))
        yield Finding(
            check="ego-motion-missing",
            file=recording.trajectory.source,
            field=what,
            expected="ego-motion at all of them",
            got=f"none at {int((~valid).sum())} of {len(times_ns)}; it runs from {first_ns} to {last_ns}",
            hint="give ego-motion that covers every image and sweep, without gaps over half a second",
            **occurrences(~valid, times_ns),
        )


def _drift(recording: Recording) -> Iterator[Finding]:
    """Sensors that are triggered together keep the ratio of their rates; a clock that runs apart does not."""
    series = sensor_times(recording)
    fits = {name: fit for name, times_ns in series.items() if (fit := _interval(times_ns)) is not None}
    for (one, (one_ns, one_off)), (other, (other_ns, other_off)) in combinations(fits.items(), 2):
        ratio = other_ns / one_ns
        simple = Fraction(ratio).limit_denominator(MOST_PARTS)
        if not simple or simple.numerator > MOST_PARTS or abs(ratio / float(simple) - 1) > NEAR_RATIO:
            continue
        rate = ratio / float(simple) - 1.0
        first_ns, last_ns = max(series[one][0], series[other][0]), min(series[one][-1], series[other][-1])
        apart_ns = abs(rate) * max(int(last_ns - first_ns), 0)
        if apart_ns > LEAST_DRIFT_NS and abs(rate) > 4.0 * np.hypot(one_off, other_off):
            clocks = abs(rate) <= CRYSTAL_RATE
            yield Finding(
                check="clock-drift",
                severity=Severity.ERROR if clocks else Severity.WARNING,
                field=f"{one} and {other}",
                expected=f"intervals as {simple.denominator} to {simple.numerator}, as sensors of one clock have them",
                got=f"{1e6 * rate:+.0f} ppm more, {apart_ns / 1e6:.1f} ms over the recording",
                hint="two clocks: convert the times to one of them"
                if clocks
                else "take the times of free-running sensors from one clock",
                timestamp_ns=int(first_ns),
            )


def _interval(times_ns: NDArray[np.int64]) -> tuple[float, float] | None:
    """Mean interval and its relative uncertainty, by a line through times over their count; gaps are counted over."""
    if len(times_ns) < LEAST_IMAGES:
        return None
    steps_ns = np.diff(times_ns)
    middle_ns = float(np.median(steps_ns))
    number = np.concatenate([[0.0], np.cumsum(np.maximum(np.round(steps_ns / middle_ns), 1.0))])
    elapsed_ns = (times_ns - times_ns[0]).astype(np.float64)
    slope, intercept = np.polyfit(number, elapsed_ns, 1)
    left_ns = elapsed_ns - (slope * number + intercept)
    spread = float(np.sqrt((left_ns**2).sum() / max(len(left_ns) - 2, 1) / ((number - number.mean()) ** 2).sum()))
    return float(slope), spread / float(slope)
