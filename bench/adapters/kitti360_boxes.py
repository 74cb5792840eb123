"""KITTI-360's files of boxes, read object by object, since they may hold tens of thousands; and the tracks in them.

A child `object<n>` is a box (or the outline of a building, a road, ...): `transform` maps its local `vertices` into the
global world and holds the size of the box as a scale, so orientation and size come from a polar decomposition. What
stands has `timestamp` -1, what moves one child per frame, joined by semanticId and instanceId. `start_frame` and
`end_frame` are the stretch of the drive that was annotated together, not the time for which the object is seen
(kitti360Scripts #103).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import polar

from bench.adapters.kitti_files import FrameClock
from bench.egomotion.trajectory import Trajectory
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings.annotations import box_state
from bench.recordings.files import numbers, xml_parts
from bench.records.recording import Cuboid, ObjectState, Track, world_velocities, world_yaw_rates


class Label(NamedTuple):
    """A label that things which move can have.

    Attributes:
        name: as the data set writes it.
        number: its number in label images and global ids.
        kitti_number: its number in the files of boxes, there called semanticId.
        object_class: what it is here.
    """

    name: str
    number: int
    kitti_number: int
    object_class: str


LABELS = (  # the numbers are facts of the data set's label table
    Label("person", 24, 19, "pedestrian"),
    Label("rider", 25, 20, "cyclist"),
    Label("car", 26, 13, "vehicle"),
    Label("truck", 27, 14, "vehicle"),
    Label("bus", 28, 34, "vehicle"),
    Label("caravan", 29, 16, "vehicle"),
    Label("trailer", 30, 15, "vehicle"),
    Label("train", 31, 33, "vehicle"),
    Label("motorcycle", 32, 17, "cyclist"),
    Label("bicycle", 33, 18, "cyclist"),
    Label("unknown vehicle", 43, 36, "vehicle"),
)
BY_KITTI_NUMBER = {label.kitti_number: label for label in LABELS}
BY_NAME = {label.name: label for label in LABELS} | {"pedestrian": LABELS[0], "unknownVehicle": LABELS[-1]}
GLOBAL_ID_STEP = 1000  # global id = number * 1000 + instance

LARGEST_OBJECT_BYTES = 32_000_000  # of XML without the end of a child of the root
DEEPEST = 50
STATIONARY = -1
STATIC_RANGE_M = 25.0  # stationary objects are annotated while they are this near, since they hide what moves
Window = tuple[int, int]  # first and last frame of a stretch that was annotated together


@dataclass(frozen=True, slots=True, eq=False)
class WorldBox:
    """A box at a frame, or a stationary one.

    Attributes:
        label: None for one that is marked dynamic but has a label that is not known to move.
        dynamic: as marked.
        frame: of the box; -1 for a stationary one.
        window: None where the file does not say.
        rotation: (3, 3) float64, global world from box, a proper rotation.
        centre_m: (3,) float64, global world.
        size_m: (3,) float64, full lengths along the box's own axes.
    """

    label: Label | None
    dynamic: bool
    frame: int
    window: Window | None
    rotation: NDArray[np.float64]
    centre_m: NDArray[np.float64]
    size_m: NDArray[np.float64]


def read_boxes(file: Path) -> tuple[dict[str, list[WorldBox]], set[Window]]:
    """Read the boxes of everything that can move.

    Args:
        file: of boxes.

    Returns:
        The boxes of each object, by what joins them and in the order of the file; and the windows of all objects.

    Raises:
        DataError: missing, cut short, not XML, with entities, or an object that is not whole.
    """
    boxes: dict[str, list[WorldBox]] = defaultdict(list)
    windows: set[Window] = set()
    for element in xml_parts(file, level=1, parts="objects", largest_bytes=LARGEST_OBJECT_BYTES, deepest=DEEPEST):
        if element.find("transform") is None:
            continue
        window = _window(element, file)
        if window is not None:
            windows.add(window)
        semantic, name = _integer(element, "semanticId", file), (element.findtext("label") or "").strip()
        label = BY_NAME.get(name) if semantic is None else BY_KITTI_NUMBER.get(semantic)
        dynamic = bool(_integer(element, "dynamic", file) or 0)
        if label is not None or dynamic:
            key, extent = _key(element, label, semantic, file), _extent(element, file)
            frame = _integer(element, "timestamp", file)
            if frame is None or frame < STATIONARY:
                field = f"{element.tag}.timestamp"
                raise DataError(file, field=field, expected="a frame number, or -1", got=str(frame))
            boxes[key].append(WorldBox(label, dynamic, frame, window, *extent))
    return boxes, windows


def _key(element: Element, label: Label | None, semantic: int | None, file: Path) -> str:
    instance = _integer(element, "instanceId", file)
    if semantic is not None and instance:
        return str((label.number if label else 10_000 + semantic) * GLOBAL_ID_STEP + instance)
    sequence = _integer(element, "dynamicSeq", file)
    if sequence is not None and sequence >= 0 and _integer(element, "dynamic", file):
        return f"dynamic-{sequence}"
    return f"index-{_integer(element, 'index', file)}-{element.tag}"


def _window(element: Element, file: Path) -> Window | None:
    first, last = _integer(element, "start_frame", file), _integer(element, "end_frame", file)
    if first is None or last is None or first < 0 or last < 0:
        return None
    if last < first:
        raise DataError(file, field=f"{element.tag}.end_frame", expected=f"{first} or later", got=str(last))
    return first, last


def _integer(element: Element, name: str, file: Path) -> int | None:
    text = (element.findtext(name) or "").strip()
    if not text:
        return None
    try:
        value = int(text)
    except ValueError:
        value = 1 << 40
    if abs(value) >= 1 << 31:
        raise DataError(file, field=f"{element.tag}.{name}", expected="a whole number", got=repr(text[:40]))
    return value


def _extent(element: Element, file: Path) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Rotation, centre and size of the box around the vertices, along the axes of the transform."""
    transform = _matrix(element, "transform", file)
    vertices = _matrix(element, "vertices", file)
    if transform.shape != (4, 4) or vertices.shape[1] != 3:
        got = f"{transform.shape} and {vertices.shape}"
        raise DataError(file, field=element.tag, expected="a transform (4, 4) and vertices (N, 3)", got=got)
    mirror = np.array([-1.0 if np.linalg.det(transform[:3, :3]) < 0 else 1.0, 1.0, 1.0])
    rotation, stretch = polar(transform[:3, :3] * mirror)
    corners = (vertices * mirror) @ stretch.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    if not (np.linalg.det(rotation) > 0.5 and (high - low > 1e-3).all()):
        got = f"one of {np.array2string((high - low), precision=3)} m"
        raise DataError(file, field=f"{element.tag}.transform", expected="a box with length, width and height", got=got)
    return np.asarray(rotation), rotation @ ((low + high) / 2) + transform[:3, 3], high - low


def _matrix(element: Element, name: str, file: Path) -> NDArray[np.float64]:
    field = f"{element.tag}.{name}"
    node = element.find(name)
    if node is None:
        raise DataError(file, field=field, expected="a matrix", got="none")
    rows, columns = _integer(node, "rows", file) or 0, _integer(node, "cols", file) or 0
    if rows < 1 or columns < 1:
        raise DataError(file, field=field, expected="rows and cols", got=f"{rows} and {columns}")
    words = (node.findtext("data") or "").split()
    return np.array(numbers(words, rows * columns, file=file, field=f"{field}.data")).reshape(rows, columns)


# From boxes in the data set's world to tracks in the vehicle frame, frame by frame


def tracks_from_world(
    boxes: Mapping[str, Sequence[WorldBox]],
    trajectory: Trajectory,
    world_from_global: RigidTransform,
    clock: FrameClock,
) -> tuple[Track, ...]:
    """Put boxes where the vehicle sees them.

    Stationary boxes get a state at each frame of their window at which they are near. Frames without ego-motion have no
    states, since the vehicle frame is unknown there. People whose box is not marked dynamic are unclear: some of them
    do walk (kitti360Scripts #77).

    Args:
        boxes: of each object.
        trajectory: of the vehicle.
        world_from_global: its world from that of the boxes.
        clock: times of frames.

    Returns:
        Tracks of everything that can move, whether it does or not.
    """
    ego = _EgoPath(trajectory, world_from_global, clock)
    tracks = [_track(key, group, ego) for key, group in boxes.items()]
    kinds = {key: group[0].label.name for key, group in boxes.items() if group[0].label is not None}
    return joined_riders([track for track in tracks if track.states], kinds)


class _EgoPath:
    """The vehicle at every frame that has ego-motion."""

    def __init__(self, trajectory: Trajectory, world_from_global: RigidTransform, clock: FrameClock) -> None:
        self.world_from_global = world_from_global
        frames = np.fromiter(clock.times_ns, dtype=np.int64)
        times_ns = np.fromiter(clock.times_ns.values(), dtype=np.int64)
        rotations, positions_m, valid = trajectory.at(times_ns)
        self.frames, self.times_ns = frames[valid], times_ns[valid]
        self.rotations, self.positions_m = rotations[valid], positions_m[valid]

    def rows(self, box: WorldBox) -> list[int]:
        """Rows of the frames at which a box is there: its own, or of a stationary one those at which it is near."""
        if box.frame != STATIONARY:
            return np.flatnonzero(self.frames == box.frame).tolist()
        centre = self.world_from_global.apply(box.centre_m)
        away_m = np.hypot(*(self.positions_m[:, :2] - centre[:2]).T) - np.linalg.norm(box.size_m) / 2
        first, last = box.window or (0, np.iinfo(np.int64).max)
        return np.flatnonzero((away_m <= STATIC_RANGE_M) & (self.frames >= first) & (self.frames <= last)).tolist()


def _track(key: str, boxes: Sequence[WorldBox], ego: _EgoPath) -> Track:
    label = boxes[0].label
    by_row: dict[int, int] = {}
    for i, box in enumerate(boxes):
        by_row |= {row: i for row in ego.rows(box) if box.frame != STATIONARY or row not in by_row}
    person = label is not None and label.object_class == "pedestrian"
    unclear = label is None or (person and not any(box.dynamic for box in boxes))
    rows = np.array(sorted(by_row), dtype=np.intp)
    states = _states(boxes, rows, np.array([by_row[row] for row in rows], dtype=np.intp), ego, unclear=unclear)
    return Track(track_id=key, object_class="vehicle" if label is None else label.object_class, states=states)


def _states(
    boxes: Sequence[WorldBox], rows: NDArray[np.intp], chosen: NDArray[np.intp], ego: _EgoPath, *, unclear: bool
) -> tuple[ObjectState, ...]:
    """States at rows of the ego path, each with the chosen one of the object's boxes."""
    order = _axes(ego.world_from_global.rotation @ boxes[0].rotation, boxes[0].size_m)
    rotations, centres_m, sizes_m = (
        np.stack(each)[chosen] for each in zip(*(_placed(box, ego, order) for box in boxes), strict=True)
    )
    moves = np.array([box.frame != STATIONARY for box in boxes])[chosen]
    times_ns = ego.times_ns[rows]
    velocities = np.where(moves[:, None], world_velocities(times_ns, centres_m), 0.0)
    along = np.nan_to_num(np.einsum("ni,ni->n", velocities, rotations[:, :, 0])).sum()
    if along < 0:  # the box was drawn facing backwards
        rotations = rotations * np.array([-1.0, -1.0, 1.0])
    turns = np.where(moves, world_yaw_rates(times_ns, rotations), 0.0)
    world_from_vehicle = ego.rotations[rows]
    vehicle_from_object = RigidTransform.each(
        np.einsum("nji,njk->nik", world_from_vehicle, rotations),
        np.einsum("nji,nj->ni", world_from_vehicle, centres_m - ego.positions_m[rows]),
    )
    seen_velocities = np.einsum("nji,nj->ni", world_from_vehicle, velocities)
    return tuple(
        box_state(
            times_ns[i],
            vehicle_from_object[i],
            sizes_m[i],
            seen_velocities[i],
            turns[i],
            unclear=unclear or (boxes[chosen[i]].dynamic and not bool(moves[i])),
        )
        for i in range(len(rows))
    )


def _placed(
    box: WorldBox, ego: _EgoPath, order: tuple[int, int]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Rotation with x along and z up, centre and size (length, width, height), in our world."""
    axes = ego.world_from_global.rotation @ box.rotation
    along, up = order
    z = axes[:, up] * (1.0 if axes[2, up] > 0 else -1.0)
    x = axes[:, along]
    rotation = np.column_stack([x, np.cross(z, x), z])
    size_m = box.size_m[[along, 3 - along - up, up]]
    return rotation, ego.world_from_global.apply(box.centre_m), size_m


def _axes(rotation: NDArray[np.float64], size_m: NDArray[np.float64]) -> tuple[int, int]:
    """Axes of the box that are its length and its height; one choice for all boxes of an object."""
    up = int(np.argmax(np.abs(rotation[2])))
    along = max((axis for axis in range(3) if axis != up), key=lambda axis: float(size_m[axis]))
    return along, up


# A rider and what is ridden

RIDDEN = frozenset({"bicycle", "motorcycle"})
TOGETHER = 0.5  # share of the frames in which both are seen; a rider passes a parked bicycle in few
CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


def joined_riders(tracks: Sequence[Track], kinds: Mapping[str, str]) -> tuple[Track, ...]:
    """Make one track of each rider and the bicycle or motorcycle below them.

    They belong together where, in half of the frames or more that have both, the middle of one box lies within the
    outline of the other, seen from above; of several pairs the nearest. The box is the one around both, along the axes
    of what is ridden; where only one of them is seen, it is that one's. Motion is that of what is ridden, or of the
    rider where the former is unclear.

    Args:
        tracks: objects of one drive.
        kinds: track -> name of its label.

    Returns:
        All tracks, a pair in the place of the rider.
    """
    riders = [track for track in tracks if kinds.get(track.track_id) == "rider"]
    ridden = [track for track in tracks if kinds.get(track.track_id) in RIDDEN]
    pairs = [(away, a.track_id, b) for a in riders for b in ridden if (away := _apart_m(a, b)) is not None]
    below: dict[str, Track] = {}
    taken: set[str] = set()
    for _, rider, mount in sorted(pairs, key=lambda pair: pair[0]):
        if rider not in below and mount.track_id not in taken:
            below[rider] = mount
            taken.add(mount.track_id)
    return tuple(
        _joined(track, below[track.track_id]) if track.track_id in below else track
        for track in tracks
        if track.track_id not in taken
    )


def _apart_m(rider: Track, mount: Track) -> float | None:
    """Median distance from above of a pair that belongs together; None for one that does not."""
    states = {state.timestamp_ns: state for state in mount.states}
    both = [(state, states[state.timestamp_ns]) for state in rider.states if state.timestamp_ns in states]
    within = [pair for pair in both if _is_within(*pair) or _is_within(*reversed(pair))]
    if not both or len(within) < TOGETHER * len(both):
        return None
    return float(np.median([np.hypot(*(_box(a)[0] - _box(b)[0])[:2]) for a, b in within]))


def _is_within(inner: ObjectState, outer: ObjectState) -> bool:
    """Return True where the middle of one box is in the outline of another, seen from above."""
    centre_m, rotation, size_m = _box(outer)
    along = rotation.T @ (_box(inner)[0] - centre_m)
    return bool((np.abs(along[:2]) <= size_m[:2] / 2).all())


def _box(state: ObjectState) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    assert isinstance(state.shape, Cuboid)
    pose = state.shape.vehicle_from_object
    return pose.translation_m, pose.rotation, state.shape.size_m


def _joined(rider: Track, mount: Track) -> Track:
    alone = {state.timestamp_ns: state for state in rider.states}
    states = dict(alone)
    for state in mount.states:
        other = alone.get(state.timestamp_ns)
        states[state.timestamp_ns] = state if other is None else _around_both(state, other)
    in_time = tuple(states[time_ns] for time_ns in sorted(states))
    return replace(rider, track_id=f"{rider.track_id}+{mount.track_id}", states=in_time)


def _around_both(mount: ObjectState, rider: ObjectState) -> ObjectState:
    centre_m, rotation, size_m = _box(mount)
    rider_m, rider_rotation, rider_size_m = _box(rider)
    corners_m = (rider_m + (CORNERS * rider_size_m) @ rider_rotation.T - centre_m) @ rotation
    low, high = np.minimum(corners_m.min(axis=0), -size_m / 2), np.maximum(corners_m.max(axis=0), size_m / 2)
    middle_m = centre_m + rotation @ ((low + high) / 2)
    clear = (state for state in (mount, rider) if not state.unclear and np.isfinite(state.velocity_mps).all())
    clearest = next(clear, mount)
    return replace(
        mount,
        shape=Cuboid(vehicle_from_object=RigidTransform(rotation, middle_m), size_m=high - low),
        velocity_mps=clearest.velocity_mps,
        yaw_rate_radps=clearest.yaw_rate_radps,
        unclear=mount.unclear and rider.unclear,
    )
