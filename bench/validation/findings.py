"""Findings of the checks, and the parts of a drive that several of them ask for.

What each check expects, and what a user can do about it, stands in findings.yaml.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from pathlib import Path

import numpy as np
import shapely
import yaml
from numpy.typing import NDArray

from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings import Cuboid, GroundPolygon, ObjectState, Recording, Track
from bench.records.recording import ObjectShape


class Severity(StrEnum):
    """Certainty that something is wrong."""

    ERROR = "error"  # wrong: a file that cannot be used, or a value that cannot be
    WARNING = "warning"  # unusual: correct in some recordings, worth checking


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One fault, reported once however often it occurs.

    Attributes:
        check: name of the check, for example "clock-drift".
        severity: how sure it is.
        recording: name; empty for the data set as a whole.
        file: the file, or the folder where none can be named; empty for the one that `report.CHECKS` names.
        field: the field, camera or object in it; None for the whole file.
        expected: the correct state.
        got: what was found.
        hint: what the user can do about it.
        times: how often it was found.
        timestamp_ns: of the first time; None where no time belongs to it.
    """

    check: str
    severity: Severity = Severity.ERROR
    recording: str = ""
    file: str = ""
    field: str | None = None
    expected: str
    got: str
    hint: str = ""
    times: int = 1
    timestamp_ns: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Undecided:
    """A quantity that a recording cannot tell.

    Attributes:
        about: the quantity.
        why: what is missing.
    """

    about: str
    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """A mistake from which others may follow.

    Attributes:
        name: of it.
        known_by: checks whose errors tell it.
        following: checks whose findings may follow from it.
    """

    name: str
    known_by: tuple[str, ...]
    following: tuple[str, ...]


@cache
def _texts() -> tuple[dict[str, dict[str, str]], tuple[Cause, ...]]:
    texts, causes = yaml.safe_load_all(Path(__file__).with_name("findings.yaml").read_text("utf-8"))
    return texts, tuple(Cause(**cause) for cause in causes)


def causes() -> tuple[Cause, ...]:
    """What other findings may follow from."""
    return _texts()[1]


def new_finding(
    kind: str,
    got: str | None = None,
    *,
    file: object = "",
    field: str | None = None,
    severity: Severity | None = None,
    hint: str | None = None,
    times: int | None = None,
    at_ns: Sequence[int] | NDArray[np.int64] = (),
    **values: object,
) -> Finding:
    """A finding with the texts of findings.yaml.

    Args:
        kind: key there, the name of the check, or "check: variant".
        got: what was found; None where its text stands there.
        file: as in `Finding`.
        field: as in `Finding`.
        severity: where it is not the one that stands there.
        hint: the same.
        times: as in `Finding`; None for once at each of `at_ns`, or once.
        at_ns: times at which it was found, the first one first; none where no time belongs to it.
        values: named in braces in the texts.
    """
    text = _texts()[0][kind]
    return Finding(
        check=kind.split(":")[0],
        severity=severity or Severity(text.get("severity", "error")),
        file=str(file),
        field=field,
        expected=text["expected"].format(**values),
        got=text["got"].format(**values) if got is None else got,
        hint=text.get("hint", "").format(**values) if hint is None else hint,
        times=times or len(at_ns) or 1,
        timestamp_ns=int(at_ns[0]) if len(at_ns) else None,
    )


def unusable(error: DataError, *, check: str = "file", timestamp_ns: int | None = None) -> Finding:
    """Finding of a file that cannot be read, from its reader's error."""
    fields = {name: getattr(error, name) for name in ("file", "field", "expected", "got", "hint")}
    return Finding(check=check, timestamp_ns=timestamp_ns, **fields)


# ---------------------------------------------------------------- parts of a drive that several checks ask for


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
