"""The statement of what is annotated, and boxes for themselves: sizes, tilt, height over the road, two at one place."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.plain_text import listed
from bench.recordings import COMPLETELY, NOT_ANNOTATED, Cuboid, Recording, Track
from bench.recordings.validation import keys_twice
from bench.records.reference import Category
from bench.validation.drive import annotation_file, boxes_of, object_field
from bench.validation.findings import BODIES, Finding, Severity, Span, occurrences, unusable


def check_annotated(recording: Recording) -> Iterator[Finding]:
    """Complete annotations without any object, ones that nothing uses, stated times at which no image was taken."""
    images = [image for images in recording.images.values() for image in images]
    annotated, objects = recording.annotated, [track for track in recording.tracks if track.states]
    if annotated == NOT_ANNOTATED and objects:
        yield Finding(
            check="annotated",
            severity=Severity.WARNING,
            field="annotated",
            expected="no annotations, as the recording is said to be not annotated",
            got=f"{len(objects)} objects, which nothing uses",
            hint="take `annotated: none` out of the card or recording.json to score by them",
        )
    if annotated == NOT_ANNOTATED or any(image.moving_path is not None for image in images):
        return
    if not objects:
        part = "all of the recording" if annotated == COMPLETELY else "part of the recording"
        yield Finding(
            check="annotated",
            severity=Severity.WARNING,
            field="annotated",
            expected=f"objects, as {part} is said to be annotated",
            got="none",
            hint="right if nothing moves there; else whatever is detected counts as wrong: state annotated: none",
        )
    if images and not any(annotated.covers(image.timestamp_ns) for image in images):
        times_ns = sorted(image.timestamp_ns for image in images)
        yield Finding(
            check="annotated",
            field="annotated.timestamps_ns",
            expected=f"times of the images, {times_ns[0]} to {times_ns[-1]}",
            got="times at which there is none",
            hint="check the unit and the epoch of the clock",
        )


TILTED_RAD, ODD_TILT_RAD = float(np.radians(45)), float(np.radians(20))
CHANGES = 1.6  # a rigid body does not grow by so much; people swing arms and legs
NEAR_M = 25.0
OFF_ROAD_M = 0.5
LEAST_BOXES = 3
SAME_PLACE = 0.5  # intersection over union of two footprints
MOST_PAIRS = 200_000  # of footprints that touch, in a recording; five seconds
QUERIED_AT_ONCE = 64  # footprints; of 5000 that all touch, their pairs take 5 MB
MOST_PAIRS_LISTED = 100  # pairs of objects, each for itself
INSIDE_EGO_M = 0.3


def check_boxes(recording: Recording) -> Iterator[Finding]:
    """Sizes by class, tilt, names, and boxes that overlap."""
    yield from _names(recording)
    for track in recording.tracks:
        yield from _sizes(track)
        yield from _tilt(track)
    yield from _above_road(recording)
    yield from _same_place(recording)
    yield from _in_ego_vehicle(recording)


def _names(recording: Recording) -> Iterator[Finding]:
    file = Path(annotation_file(recording))
    if file.suffix == ".json":
        yield from (unusable(error, check="key-twice") for error in keys_twice(file))
    for what, names in (
        ("track_id", [track.track_id for track in recording.tracks]),
        ("instance_id", [str(track.instance_id) for track in recording.tracks if track.instance_id is not None]),
    ):
        twice = sorted(name for name, times in Counter(names).items() if times > 1)
        if twice:
            yield Finding(
                check="id-twice",
                field=what,
                expected="each object once",
                got=f"{listed(twice)} more than once",
                times=len(twice),
            )
    stateless = [track.track_id for track in recording.tracks if not track.states]
    if stateless:
        yield Finding(
            check="object-without-frames",
            severity=Severity.WARNING,
            field="objects",
            expected="a place at some time",
            got=f"none for {listed(stateless)}",
            times=len(stateless),
        )
    known = {category.value for category in Category}
    for track in recording.tracks:
        unknown = {state.category for state in track.states} - known - {None}
        if unknown:
            yield Finding(
                check="category",
                field=f"object {track.track_id!r}",
                expected=f"one of {', '.join(sorted(known))}",
                got=listed(sorted(str(name) for name in unknown)),
            )


def _sizes(track: Track) -> Iterator[Finding]:
    limits, field = BODIES.get(track.object_class), object_field(track)
    if limits is None:
        yield Finding(check="class", field=field, expected=f"one of {', '.join(BODIES)}", got=repr(track.object_class))
        return
    boxed = boxes_of(track)
    if not boxed:
        return
    times_ns = np.array([state.timestamp_ns for state, _ in boxed], dtype=np.int64)
    sizes_m = np.array([box.size_m for _, box in boxed])
    flat = np.sort(sizes_m[:, :2], axis=1)
    sides: tuple[tuple[str, np.ndarray, Span], ...] = (
        ("longer side", flat[:, 1], limits.long_side_m),
        ("shorter side", flat[:, 0], limits.short_side_m),
        ("height", sizes_m[:, 2], limits.height_m),
    )
    for what, values, (low, high) in sides:
        off = (values < low) | (values > high)
        if off.any():
            worst = values[off][np.argmax(np.maximum(low / values[off], values[off] / high))]
            yield Finding(
                check="box-size",
                field=f"{field}: {what}",
                expected=f"{low} to {high} m for a {track.object_class}",
                got=f"{worst:.2f} m",
                hint="check the class, the unit and the order of the sizes (length, width, height; full, not half)",
                **occurrences(off, times_ns),
            )
    boxes = np.array([isinstance(state.shape, Cuboid) for state, _ in boxed])
    if track.object_class == "vehicle" and boxes.sum() > 1:
        spread = sizes_m[boxes].max(axis=0) / sizes_m[boxes].min(axis=0)
        if spread.max() > CHANGES:
            axis = int(np.argmax(spread))
            values = sizes_m[boxes][:, axis]
            yield Finding(
                check="box-grows",
                severity=Severity.WARNING,
                field=f"{field}: {('length', 'width', 'height')[axis]}",
                expected="one size of a rigid body",
                got=f"{values.min():.2f} to {values.max():.2f} m",
                hint="two objects under one name, or boxes of what is seen instead of the whole",
            )


def _tilt(track: Track) -> Iterator[Finding]:
    boxed = [(s.timestamp_ns, s.shape.vehicle_from_object) for s in track.states if isinstance(s.shape, Cuboid)]
    times_ns = np.array([time_ns for time_ns, _ in boxed], dtype=np.int64)
    tilt_rad = np.arccos(np.clip([pose.rotation[2, 2] for _, pose in boxed], -1.0, 1.0))
    tilted = tilt_rad > ODD_TILT_RAD
    if tilted.any():
        yield Finding(
            check="box-tilt",
            severity=Severity.ERROR if tilt_rad.max() > TILTED_RAD else Severity.WARNING,
            field=object_field(track),
            expected="an upright box",
            got=f"one tilted by up to {np.degrees(tilt_rad.max()):.0f} degrees",
            hint="check the order of the quaternion (OpenLABEL: x, y, z, w) and of angles",
            **occurrences(tilted, times_ns),
        )


def _above_road(recording: Recording) -> Iterator[Finding]:
    """Bottoms of near boxes: centres taken for bottoms, or the other way round, put all off by half a height."""
    road_m = recording.ground_m
    every: list[float] = []
    for track in recording.tracks:
        gaps = [
            float(box.vehicle_from_object.translation_m[2] - box.size_m[2] / 2) - road_m
            for _, box in boxes_of(track)
            if np.hypot(*box.vehicle_from_object.translation_m[:2]) < NEAR_M
        ]
        if gaps:
            every.append(float(np.median(gaps)))
    off_m = np.median(every) if every else 0.0
    if abs(off_m) > OFF_ROAD_M:
        side = "above" if off_m > 0 else "below"
        yield Finding(
            check="box-height",
            severity=Severity.ERROR if len(every) >= LEAST_BOXES else Severity.WARNING,
            field="cuboid, z",
            expected=f"objects within {NEAR_M:.0f} m that are on the road, at {road_m:+.2f} m",
            got=f"their undersides {abs(off_m):.2f} m {side} it, median of {len(every)} objects",
            hint="the origin of a box is its centre here; some formats give the middle of its bottom",
            times=len(every),
        )


def _same_place(recording: Recording) -> Iterator[Finding]:
    """Two objects of one class whose footprints overlap: one object under two names."""
    at: dict[int, list[tuple[Track, shapely.Polygon]]] = defaultdict(list)
    for track in recording.tracks:
        for state, box in boxes_of(track):
            at[state.timestamp_ns].append((track, _footprint(box)))
    overlapping: dict[tuple[str, str], list[int]] = defaultdict(list)
    left, given_up_ns = MOST_PAIRS, []
    for time_ns, present in sorted(at.items()):
        pairs, overlap, whole = _overlapping(present, most=left)
        left -= len(pairs)
        for i, j in pairs[overlap]:
            overlapping[present[i][0].track_id, present[j][0].track_id].append(time_ns)
        if not whole:
            given_up_ns.append(time_ns)
    often = sorted(overlapping.items(), key=lambda pair: -len(pair[1]))
    rows = [
        (f"objects {one!r} and {other!r}", f"at {len(times_ns)} times", len(times_ns), times_ns[0])
        for (one, other), times_ns in often[:MOST_PAIRS_LISTED]
    ]
    if rest := often[MOST_PAIRS_LISTED:]:
        first_ns = min(times_ns[0] for _, times_ns in rest)
        rows.append(("objects", f"in {len(rest)} more pairs of objects", len(rest), first_ns))
    for field, when, times, first_ns in rows:
        yield Finding(
            check="same-object",
            field=field,
            expected="one box for each object",
            got=f"boxes that overlap by more than half {when}",
            hint="one object under two names",
            times=times,
            timestamp_ns=first_ns,
        )
    if given_up_ns:
        yield Finding(
            check="crowded-boxes",
            severity=Severity.WARNING,
            field="cuboid",
            expected=f"at most {MOST_PAIRS} pairs of boxes of a class that touch",
            got=f"more; at {len(given_up_ns)} of {len(at)} times not all were compared",
            hint="fix the reported ones, then validate again",
            times=len(given_up_ns),
            timestamp_ns=given_up_ns[0],
        )


def _overlapping(
    present: Sequence[tuple[Track, shapely.Polygon]], *, most: int
) -> tuple[NDArray[np.int64], NDArray[np.bool_], bool]:
    """Pairs of objects of one class that touch, and which of them overlap by more than half.

    Args:
        present: objects with their footprints, at one time.
        most: pairs that are looked at.

    Returns:
        pairs: (N, 2) indices, N <= `most`.
        overlap: (N,) bool.
        whole: whether these are all pairs.
    """
    footprints = np.array([footprint for _, footprint in present])
    classes = np.unique([track.object_class for track, _ in present], return_inverse=True)[1]
    names = np.unique([track.track_id for track, _ in present], return_inverse=True)[1]
    tree = shapely.STRtree(footprints)
    parts: list[NDArray[np.int64]] = []
    count = 0
    for first in range(0, len(present), QUERIED_AT_ONCE):
        i, j = tree.query(footprints[first : first + QUERIED_AT_ONCE], predicate="intersects")
        i = i + first
        parts.append(np.column_stack([i, j])[(i < j) & (classes[i] == classes[j]) & (names[i] != names[j])])
        count += len(parts[-1])
        if count > most:
            break
    pairs = np.concatenate(parts)[:most]
    one, other = footprints[pairs.T]
    common = shapely.area(shapely.intersection(one, other))
    overlap = np.asarray(common > SAME_PLACE * (shapely.area(one) + shapely.area(other) - common))
    return pairs, overlap, count <= most


def _in_ego_vehicle(recording: Recording) -> Iterator[Finding]:
    ego = shapely.Polygon(recording.vehicle_outline_m).buffer(-INSIDE_EGO_M)
    for track in recording.tracks:
        inside = [
            state.timestamp_ns
            for state, box in boxes_of(track)
            if ego.contains(shapely.Point(box.vehicle_from_object.translation_m[:2]))
        ]
        if inside:
            yield Finding(
                check="object-in-ego",
                field=object_field(track),
                expected="objects outside of the ego vehicle",
                got=f"its centre in the ego vehicle at {len(inside)} times",
                hint="check the frame of the annotations: the vehicle's, not the lidar's or the world's",
                times=len(inside),
                timestamp_ns=inside[0],
            )


def _footprint(box: Cuboid) -> shapely.Polygon:
    corners = np.array([[0.5, 0.5, 0.0], [-0.5, 0.5, 0.0], [-0.5, -0.5, 0.0], [0.5, -0.5, 0.0]]) * box.size_m
    return shapely.Polygon(box.vehicle_from_object.apply(corners)[:, :2])
