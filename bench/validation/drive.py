"""Parts of a drive that several checks ask for: files for findings, times of its sensors, annotated boxes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.geometry import RigidTransform
from bench.recordings import Cuboid, GroundPolygon, ObjectShape, ObjectState, Recording, Track


def calibration_file(recording: Recording) -> str:
    """File of the calibration, or the recording's folder where it is not known."""
    file = recording.root / "recording.json"
    return str(file if file.is_file() else recording.root)


def annotation_file(recording: Recording) -> str:
    """File of the annotations, or the recording's folder where it is not known."""
    file = recording.root / "annotations.json"
    return str(file if file.is_file() else recording.root)


def object_field(track: Track) -> str:
    """Name of an object in findings."""
    return f"object {track.track_id!r} ({track.object_class})"


def sweep_times(recording: Recording) -> NDArray[np.int64]:
    """(N,) int64, reference times of the sweeps."""
    return np.array([sweep.timestamp_ns for sweep in recording.sweeps], dtype=np.int64)


def times_of(recording: Recording, camera: str) -> NDArray[np.int64]:
    """(N,) int64, times of a camera's images."""
    return np.array([image.timestamp_ns for image in recording.images[camera]], dtype=np.int64)


def nearest_to(times_ns: NDArray[np.int64], known_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) int64, of sorted times the one nearest to each time."""
    return np.asarray(known_ns[np.searchsorted((known_ns[:-1] + known_ns[1:]) // 2, times_ns)])


def distance_to(times_ns: NDArray[np.int64], known_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) int64, from each time to the nearest of sorted times."""
    return np.asarray(np.abs(nearest_to(times_ns, known_ns) - times_ns))


def sensor_times(recording: Recording) -> dict[str, NDArray[np.int64]]:
    """Times of the images of each camera and of the sweeps, by the name of the sensor in findings."""
    images = {f"images of {camera}": times_of(recording, camera) for camera in recording.cameras}
    return images | {"lidar sweeps": sweep_times(recording)}


def annotated_times(recording: Recording) -> NDArray[np.int64]:
    """(N,) int64, sorted times at which objects are annotated."""
    return np.unique(np.array([s.timestamp_ns for track in recording.tracks for s in track.states], dtype=np.int64))


def box_of(shape: ObjectShape) -> Cuboid | None:
    """The box, or the upright one around an outline; None for point indices."""
    if isinstance(shape, Cuboid):
        return shape
    if isinstance(shape, GroundPolygon):
        corners = shapely.get_coordinates(shapely.MultiPoint(shape.outline_m).minimum_rotated_rectangle)
        if len(corners) < 4:
            return None
        along, across = corners[1] - corners[0], corners[2] - corners[1]
        if np.hypot(*along) < np.hypot(*across):
            along, across = across, along
        centre = np.append(corners[:4].mean(axis=0), (shape.bottom_m + shape.top_m) / 2)
        return Cuboid(
            vehicle_from_object=RigidTransform.from_yaw(float(np.arctan2(along[1], along[0])), centre),
            size_m=np.array([np.hypot(*along), np.hypot(*across), shape.top_m - shape.bottom_m]),
        )
    return None


def boxes_of(track: Track) -> list[tuple[ObjectState, Cuboid]]:
    """The states of a track that have a box or an outline."""
    return [(state, box) for state in track.states if (box := box_of(state.shape)) is not None]


def boxes_near(recording: Recording, time_ns: int, *, within_ns: int) -> Iterator[Cuboid]:
    """The boxes of all objects at about a time."""
    for track in recording.tracks:
        state = track.state_near(time_ns, within_ns=within_ns)
        box = None if state is None else box_of(state.shape)
        if box is not None:
            yield box


BOX_SLACK_M = 1.0
NEAR_STATE_NS = 300_000_000  # of a state to a sweep


def on_objects(points_vehicle: NDArray[np.float64], time_ns: int, recording: Recording) -> NDArray[np.bool_]:
    """Points on annotated objects: those that drive along would suggest a stationary vehicle."""
    inside = np.zeros(len(points_vehicle), dtype=bool)
    for box in boxes_near(recording, time_ns, within_ns=NEAR_STATE_NS):
        local = box.vehicle_from_object.inverse().apply(points_vehicle)
        inside |= (np.abs(local) < box.size_m / 2 + BOX_SLACK_M).all(axis=1)
    return inside
