"""Times of images, sweeps, ego-motion and annotations: their unit, each series for itself, and against each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from bench.plain_text import counted
from bench.recordings import ImageRef, Recording, SweepRef
from bench.times import other_unit
from bench.validation.findings import (
    Finding,
    annotated_times,
    annotation_file,
    calibration_file,
    distance_to,
    nearest_to,
    new_finding,
    sensor_times,
    sweep_times,
    times_of,
)

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
MOST_OUTSIDE = 0.5  # of the annotated times; with more, these are of another clock
NEAR_SWEEP_NS = 100_000_000


def check_time_units(recording: Recording) -> Iterator[Finding]:
    """Times of images, sweeps, ego-motion and annotations that are no nanoseconds."""
    series: list[tuple[object, str, NDArray[np.int64]]] = [
        (recording.images[camera][0].path.parent, f"names of the images of {camera}", times_of(recording, camera))
        for camera in recording.cameras
        if recording.images[camera]
    ]
    if recording.sweeps:
        series.append((recording.sweeps[0].path.parent, "names of the sweeps", sweep_times(recording)))
    series.append((recording.trajectory.source, "times", recording.trajectory.timestamps_ns))
    series.append((annotation_file(recording), "timestamp", annotated_times(recording)))
    for file, field, times_ns in series:
        if (meant := other_unit(times_ns)) is not None:
            unit, factor = meant
            got, hint = f"{unit}: {', '.join(map(str, times_ns[:3]))} ...", f"multiply them by {factor}"
            yield new_finding("time-unit", got, file=file, field=field, hint=hint, times=len(times_ns))


def check_clocks(recording: Recording) -> Iterator[Finding]:
    """Rates, gaps, jitter, and clocks that run apart."""
    for camera in recording.cameras:
        yield from _rate(recording, camera)
        yield from _gaps("image-gaps", recording.images[camera], recording.frame_interval_ns, f"images of {camera}")
    if len(recording.sweeps) > LEAST_SWEEP_STEPS:
        interval_ns = float(np.median(np.diff(sweep_times(recording))))
        yield from _gaps("sweep-gaps", recording.sweeps, interval_ns, "lidar sweeps")
    for what, times_ns in sensor_times(recording).items():
        yield from _jitter(times_ns, what)
    yield from _drift(recording)


def _rate(recording: Recording, camera: str) -> Iterator[Finding]:
    steps_ns = np.diff(times_of(recording, camera))
    if not len(steps_ns):
        yield new_finding("image-times: few", str(len(recording.images[camera])), field=f"images of {camera}")
        return
    median_ns = float(np.median(steps_ns))
    if abs(median_ns / recording.frame_interval_ns - 1.0) > OFF_RATE:
        got, file = f"{recording.frame_interval_ns} ns", calibration_file(recording)
        field = "frame_interval_ns"
        yield new_finding("image-times", got, file=file, field=field, camera=camera, median_ns=median_ns)


def _gaps(kind: str, seen: Sequence[ImageRef | SweepRef], interval_ns: float, field: str) -> Iterator[Finding]:
    times_ns = np.array([ref.timestamp_ns for ref in seen], dtype=np.int64)
    steps_ns = np.diff(times_ns)
    gaps = steps_ns > NEAR_INTERVALS * interval_ns
    if 0 < gaps.sum() <= len(steps_ns) / 2:  # with more it is the stated interval that is wrong
        got = f"{counted(int(gaps.sum()), 'gap')}, the longest {steps_ns[gaps].max() / 1e6:.1f} ms"
        file, interval_ms = seen[int(np.argmax(gaps)) + 1].path, interval_ns / 1e6
        yield new_finding(kind, got, file=file, field=field, interval_ms=interval_ms, at_ns=times_ns[1:][gaps])


def _jitter(times_ns: NDArray[np.int64], what: str) -> Iterator[Finding]:
    steps_ns = np.diff(times_ns)
    if len(steps_ns) < LEAST_IMAGES:
        return
    middle_ns = float(np.median(steps_ns))
    unsteady = np.abs(steps_ns - _whole(steps_ns) * middle_ns) > JITTER * middle_ns
    if unsteady.mean() > MOST_JITTERY:
        got = f"{int(unsteady.sum())} of {len(steps_ns)} more than a quarter off"
        middle_ms = middle_ns / 1e6
        yield new_finding("irregular-times", got, field=what, middle_ms=middle_ms, at_ns=times_ns[1:][unsteady])


def _whole(steps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Steps in whole intervals: a missing image is a gap, neither jitter nor drift."""
    return np.maximum(np.round(steps_ns / float(np.median(steps_ns))), 1.0)


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
            yield new_finding(
                "clock-drift" if abs(rate) <= CRYSTAL_RATE else "clock-drift: free-running",
                f"{1e6 * rate:+.0f} ppm more, {apart_ns / 1e6:.1f} ms over the recording",
                field=f"{one} and {other}",
                at_ns=[first_ns],
                ratio=f"{simple.denominator} to {simple.numerator}",
            )


def _interval(times_ns: NDArray[np.int64]) -> tuple[float, float] | None:
    """Mean interval and its relative uncertainty, by a line through times over their count; gaps are counted over."""
    if len(times_ns) < LEAST_IMAGES:
        return None
    number = np.concatenate([[0.0], np.cumsum(_whole(np.diff(times_ns)))])
    elapsed_ns = (times_ns - times_ns[0]).astype(np.float64)
    slope, intercept = np.polyfit(number, elapsed_ns, 1)
    left_ns = elapsed_ns - (slope * number + intercept)
    spread = float(np.sqrt((left_ns**2).sum() / max(len(left_ns) - 2, 1) / ((number - number.mean()) ** 2).sum()))
    return float(slope), spread / float(slope)


def check_coverage(recording: Recording) -> Iterator[Finding]:
    """Images and sweeps without ego-motion, and images without a sweep."""
    path, sweeps_ns = recording.trajectory, sweep_times(recording)
    for what, times_ns in sensor_times(recording).items():
        if not len(times_ns):
            continue
        _, _, valid = path.at(times_ns)
        if not valid.all():
            first_ns, last_ns = (int(path.timestamps_ns[i]) for i in (0, -1))
            got = f"none at {int((~valid).sum())} of {len(times_ns)}; it runs from {first_ns} to {last_ns}"
            yield new_finding("ego-motion-missing", got, file=path.source, field=what, at_ns=times_ns[~valid])
        if not len(sweeps_ns):
            continue
        alone = distance_to(times_ns, sweeps_ns) > NEAR_SWEEP_NS
        if alone.any():
            kind = "sensor-overlap" if alone.all() else "sensor-overlap: partly"
            got = f"none for {int(alone.sum())} of {len(times_ns)} images"
            yield new_finding(kind, got, field=what, at_ns=times_ns[alone])


def check_annotation_times(recording: Recording) -> Iterator[Finding]:
    """Annotations outside of the recording, at times at which no sensor looked, or where a sweep is missing."""
    annotated_ns, sweeps_ns = annotated_times(recording), sweep_times(recording)
    sensors_ns = np.unique(np.concatenate([*sensor_times(recording).values()]))
    if not len(annotated_ns) or not len(sensors_ns):
        return
    slack_ns = NEAR_INTERVALS * recording.frame_interval_ns
    outside = (annotated_ns < sensors_ns[0] - slack_ns) | (annotated_ns > sensors_ns[-1] + slack_ns)
    unseen = (distance_to(annotated_ns, sensors_ns) > MATCHED_NS) & ~outside
    alone = distance_to(annotated_ns, sweeps_ns) > MATCHED_NS if len(sweeps_ns) else np.zeros_like(outside)
    lost = alone & ~outside & ~unseen & (alone.mean() < MOST_WITHOUT_SWEEP)
    for kind, at, where in (
        ("annotation-outside: partly" if outside.mean() < MOST_OUTSIDE else "annotation-outside", outside, "outside"),
        ("annotation-time", unseen, "at neither"),
        ("annotation-sweep", lost, "without one"),
    ):
        if at.any():
            yield new_finding(
                kind,
                f"{int(at.sum())} of {len(annotated_ns)} annotated times {where}",
                field="timestamp",
                hint=_apart(annotated_ns[~outside], sweeps_ns) if at is unseen else None,
                first_ns=sensors_ns[0],
                last_ns=sensors_ns[-1],
                at_ns=annotated_ns[at],
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
