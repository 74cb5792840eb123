"""The statement of what is annotated, and boxes for themselves: sizes, tilt, height over the road, two at one place."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.plain_text import counted, listed
from bench.recordings import Cuboid, Recording, Track
from bench.records.recording import COMPLETELY, NOT_ANNOTATED
from bench.validation.findings import Finding, Severity, boxes_of, new_finding, object_field

Span = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyLimits:
    """Spans that an annotated object of a class stays within: wide, so that what lies beyond is wrong.

    Attributes:
        long_side_m: the longer horizontal side.
        short_side_m: the shorter one.
        height_m: height.
        top_speed_mps: over the ground.
        top_turn_radps: about its own centre.

    Sources:
        Sizes of vehicles: Directive 96/53/EC (width 2.6 m, height 4 m, length 18.75 m; long combinations 25.25 m).
        People: ISO 7250-3, 99th percentile of stature 1.96 m, span of arms about as much.
        Speeds: running records (12.4 m/s on foot), and 250 km/h on a motorway.
    """

    long_side_m: Span
    short_side_m: Span
    height_m: Span
    top_speed_mps: float
    top_turn_radps: float

    def sides(self, size_m: NDArray[np.float64]) -> Iterator[tuple[str, Any, Span]]:
        """Name, values and span of each side of boxes, (..., 3): length, width, height."""
        flat = np.sort(size_m[..., :2], axis=-1)
        yield "longer side", flat[..., 1], self.long_side_m
        yield "shorter side", flat[..., 0], self.short_side_m
        yield "height", size_m[..., 2], self.height_m


BODIES = {
    "pedestrian": BodyLimits(long_side_m=(0.15, 1.7), short_side_m=(0.1, 1.5), height_m=(0.4, 2.4),
                             top_speed_mps=12.0, top_turn_radps=7.0),
    "cyclist": BodyLimits(long_side_m=(0.4, 3.2), short_side_m=(0.15, 1.6), height_m=(0.5, 2.7),
                          top_speed_mps=60.0, top_turn_radps=4.0),
    "vehicle": BodyLimits(long_side_m=(1.0, 26.0), short_side_m=(0.5, 3.7), height_m=(0.5, 5.0),
                          top_speed_mps=75.0, top_turn_radps=2.5),
    "animal": BodyLimits(long_side_m=(0.1, 3.5), short_side_m=(0.05, 1.7), height_m=(0.1, 2.8),
                         top_speed_mps=20.0, top_turn_radps=12.0),
}  # fmt: skip


def check_annotated(recording: Recording) -> Iterator[Finding]:
    """Complete annotations without any object, ones that nothing uses, stated times at which no image was taken."""
    images = [image for images in recording.images.values() for image in images]
    annotated, objects = recording.annotated, [track for track in recording.tracks if track.states]
    if annotated == NOT_ANNOTATED and objects:
        yield new_finding("annotated: not", f"{counted(len(objects), 'object')}, which nothing uses", field="annotated")
    if annotated == NOT_ANNOTATED or any(image.moving_path is not None for image in images):
        return
    if not objects:
        part = "all of the recording" if annotated == COMPLETELY else "part of the recording"
        yield new_finding("annotated: empty", "none", field="annotated", part=part)
    if images and not any(annotated.covers(image.timestamp_ns) for image in images):
        times_ns = [image.timestamp_ns for image in images]
        yield new_finding(
            "annotated: elsewhere",
            "times at which there is none",
            field="annotated.timestamps_ns",
            first_ns=min(times_ns),
            last_ns=max(times_ns),
        )


TILTED_RAD, ODD_TILT_RAD = float(np.radians(45)), float(np.radians(20))
CHANGES = 1.6  # a rigid body does not grow by so much; people swing arms and legs
NEAR_M = 25.0
OFF_ROAD_M = 0.5
LEAST_BOXES = 3
SAME_PLACE = 0.5  # intersection over union of two footprints
MOST_PAIRS_LISTED = 100  # pairs of objects, each for itself
INSIDE_EGO_M = 0.3


def check_boxes(recording: Recording) -> Iterator[Finding]:
    """Names, sizes by class, tilt, and boxes that overlap."""
    yield from _names(recording)
    for track in recording.tracks:
        if track.object_class in BODIES:
            yield from _sizes(track, BODIES[track.object_class])
        yield from _tilt(track)
    yield from _above_road(recording)
    yield from _same_place(recording)
    yield from _in_ego_vehicle(recording)


def _names(recording: Recording) -> Iterator[Finding]:
    for field, names in (
        ("track_id", [track.track_id for track in recording.tracks]),
        ("instance_id", [str(track.instance_id) for track in recording.tracks if track.instance_id is not None]),
    ):
        twice = sorted(name for name, times in Counter(names).items() if times > 1)
        if twice:
            yield new_finding("id-twice", f"{listed(twice)} more than once", field=field, times=len(twice))
    stateless = [track.track_id for track in recording.tracks if not track.states]
    if stateless:
        got = f"none for {listed(stateless)}"
        yield new_finding("object-without-frames", got, field="objects", times=len(stateless))


def _sizes(track: Track, limits: BodyLimits) -> Iterator[Finding]:
    boxed, field = boxes_of(track), object_field(track)
    if not boxed:
        return
    times_ns = np.array([state.timestamp_ns for state, _ in boxed], dtype=np.int64)
    sizes_m = np.array([box.size_m for _, box in boxed])
    for side, values, (low, high) in limits.sides(sizes_m):
        off = (values < low) | (values > high)
        if off.any():
            worst = values[off][np.argmax(np.maximum(low / values[off], values[off] / high))]
            span = f"{low} to {high} m for a {track.object_class}"
            yield new_finding("box-size", f"{worst:.2f} m", field=f"{field}: {side}", span=span, at_ns=times_ns[off])
    rigid = sizes_m[[isinstance(state.shape, Cuboid) for state, _ in boxed]]
    if track.object_class == "vehicle" and len(rigid) > 1:
        spread = rigid.max(axis=0) / rigid.min(axis=0)
        axis = int(np.argmax(spread))
        if spread[axis] > CHANGES:
            got = f"{rigid[:, axis].min():.2f} to {rigid[:, axis].max():.2f} m"
            yield new_finding("box-grows", got, field=f"{field}: {('length', 'width', 'height')[axis]}")


def _tilt(track: Track) -> Iterator[Finding]:
    boxed = [(s.timestamp_ns, s.shape.vehicle_from_object) for s in track.states if isinstance(s.shape, Cuboid)]
    times_ns = np.array([time_ns for time_ns, _ in boxed], dtype=np.int64)
    tilt_rad = np.arccos(np.clip([pose.rotation[2, 2] for _, pose in boxed], -1.0, 1.0))
    tilted = tilt_rad > ODD_TILT_RAD
    if tilted.any():
        severity = Severity.ERROR if tilt_rad.max() > TILTED_RAD else Severity.WARNING
        got = f"one tilted by up to {np.degrees(tilt_rad.max()):.0f} degrees"
        yield new_finding("box-tilt", got, field=object_field(track), severity=severity, at_ns=times_ns[tilted])


def _above_road(recording: Recording) -> Iterator[Finding]:
    """Bottoms of near boxes: centres taken for bottoms, or the other way round, put all off by half a height."""
    road_m = recording.ground_m
    gaps_m = (
        [
            box.vehicle_from_object.translation_m[2] - box.size_m[2] / 2 - road_m
            for _, box in boxes_of(track)
            if np.hypot(*box.vehicle_from_object.translation_m[:2]) < NEAR_M
        ]
        for track in recording.tracks
    )
    every = [np.median(gaps) for gaps in gaps_m if gaps]
    off_m = np.median(every) if every else 0.0
    if abs(off_m) > OFF_ROAD_M:
        side = "above" if off_m > 0 else "below"
        yield new_finding(
            "box-height",
            f"their undersides {abs(off_m):.2f} m {side} it, median of {counted(len(every), 'object')}",
            field="cuboid, z",
            severity=Severity.ERROR if len(every) >= LEAST_BOXES else Severity.WARNING,
            times=len(every),
            near_m=NEAR_M,
            road_m=road_m,
        )


def _same_place(recording: Recording) -> Iterator[Finding]:
    """Two objects of one class whose footprints overlap: one object under two names."""
    at: dict[int, list[tuple[Track, shapely.Polygon]]] = defaultdict(list)
    for track in recording.tracks:
        for state, box in boxes_of(track):
            at[state.timestamp_ns].append((track, _footprint(box)))
    overlapping: dict[tuple[str, str], list[int]] = defaultdict(list)
    for time_ns, present in sorted(at.items()):
        for names in _at_one_place(present):
            overlapping[names].append(time_ns)
    often = sorted(overlapping.items(), key=lambda pair: -len(pair[1]))
    for (one, other), times_ns in often[:MOST_PAIRS_LISTED]:
        got = f"boxes that overlap by more than half at {counted(len(times_ns), 'time')}"
        yield new_finding("same-object", got, field=f"objects {one!r} and {other!r}", at_ns=times_ns)
    if rest := often[MOST_PAIRS_LISTED:]:
        got = f"boxes that overlap by more than half in {len(rest)} more pairs of objects"
        yield new_finding("same-object", got, field="objects", times=len(rest))


def _at_one_place(present: Sequence[tuple[Track, shapely.Polygon]]) -> list[tuple[str, str]]:
    """Names of each two objects of one class whose footprints overlap by more than half."""
    tracks, footprints = zip(*present, strict=True)
    classes, names = (np.array([getattr(track, key) for track in tracks]) for key in ("object_class", "track_id"))
    i, j = shapely.STRtree(footprints).query(footprints, predicate="intersects")
    i, j = np.column_stack([i, j])[(i < j) & (classes[i] == classes[j]) & (names[i] != names[j])].T
    one, other = np.array(footprints)[[i, j]]
    common = shapely.area(shapely.intersection(one, other))
    same = common > SAME_PLACE * (shapely.area(one) + shapely.area(other) - common)
    return list(zip(names[i[same]].tolist(), names[j[same]].tolist(), strict=True))


def _in_ego_vehicle(recording: Recording) -> Iterator[Finding]:
    ego = shapely.Polygon(recording.vehicle_outline_m).buffer(-INSIDE_EGO_M)
    for track in recording.tracks:
        inside = [
            state.timestamp_ns
            for state, box in boxes_of(track)
            if ego.contains(shapely.Point(box.vehicle_from_object.translation_m[:2]))
        ]
        if inside:
            got = f"its centre in the ego vehicle at {counted(len(inside), 'time')}"
            yield new_finding("object-in-ego", got, field=object_field(track), at_ns=inside)


def _footprint(box: Cuboid) -> shapely.Polygon:
    corners = np.array([[0.5, 0.5, 0.0], [-0.5, 0.5, 0.0], [-0.5, -0.5, 0.0], [0.5, -0.5, 0.0]]) * box.size_m
    return shapely.Polygon(box.vehicle_from_object.apply(corners)[:, :2])
