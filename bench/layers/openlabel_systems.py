"""Coordinate systems of an OpenLABEL file, chained to our vehicle frame.

The chain ends at the lidar where the file knows one, since what was labelled are the points of the lidar, and our
recording says where that sits: a file's own vehicle frame may have its origin elsewhere. Without a lidar it ends at the
file's one local system, which is taken for our vehicle frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from bench.errors import DataError, ShapeError
from bench.geometry import RigidTransform
from bench.layers.openlabel_file import Root, TransformData
from bench.recordings import Recording
from bench.recordings.validation import data_error

LIDAR_WORDS = ("lidar", "velo", "laser", "pandar", "ouster", "hesai")


class Systems:
    """Answers where a system of the file lies in our vehicle frame.

    Args:
        content: of the file.
        recording: for the mounting of the lidar.
        file: for messages.

    Raises:
        DataError: a pose that is none.
    """

    def __init__(self, content: Root, recording: Recording, file: Path) -> None:
        self._content, self._file = content, file
        self._chained: dict[tuple[str | None, str | None], RigidTransform] = {}
        self._standing = standing_poses(content, file)
        self.anchor, self._vehicle_from_anchor = self._anchored(recording)

    def vehicle_from(self, name: str | None, frame: str | None) -> RigidTransform:
        """Our vehicle frame from a system of the file.

        Args:
            name: of the system; None for data that names none.
            frame: number of the frame; None for what holds always.

        Raises:
            DataError: no such system, or no chain of poses from it.
        """
        if frame is not None and not self._content.frames[frame].frame_properties.transforms:
            frame = None
        if (name, frame) not in self._chained:
            self._chained[(name, frame)] = self._chain(name, frame)
        return self._chained[(name, frame)]

    @property
    def guessed(self) -> bool:
        """Whether the file names no system at all, so that its data is taken for lidar coordinates."""
        return not self._content.coordinate_systems

    def _chain(self, name: str | None, frame: str | None) -> RigidTransform:
        start = self.anchor if name is None else name
        field = "openlabel.coordinate_systems" + ("" if frame is None else f", frame {frame}")
        if start != self.anchor and start not in self._content.coordinate_systems:
            known = ", ".join(self._content.coordinate_systems) or "none"
            raise DataError(self._file, field=field, expected=f"one of {known}", got=repr(start))
        edges = dict(self._standing)
        if frame is not None:
            for key, moved in self._content.frames[frame].frame_properties.transforms.items():
                place = f"openlabel.frames.{frame}.frame_properties.transforms.{key}"
                edges.pop((moved.src, moved.dst), None)
                edges[(moved.dst, moved.src)] = read_transform(moved.transform_src_to_dst, self._file, place)
        chained = chain(start, self.anchor, edges)
        if chained is None:
            do = "give pose_wrt_parent, or frame_properties.transforms in every frame"
            raise DataError(
                self._file, field=field, expected=f"poses from {start!r} to {self.anchor!r}", got="none", do=do
            )
        return self._vehicle_from_anchor @ chained

    def _anchored(self, recording: Recording) -> tuple[str, RigidTransform]:
        systems, streams = self._content.coordinate_systems, self._content.streams
        if not systems:
            return "lidar", recording.vehicle_from_lidar
        lidars = [name for name in systems if name in streams and streams[name].type == "lidar"]
        lidars = lidars or [
            name
            for name, system in systems.items()
            if system.type in {"sensor_cs", "sensor"} and any(word in name.casefold() for word in LIDAR_WORDS)
        ]
        if len(lidars) == 1:
            return lidars[0], recording.vehicle_from_lidar
        local = [name for name, system in systems.items() if system.type in {"local_cs", "local"}]
        if len(local) == 1:
            return local[0], RigidTransform.identity()
        raise DataError(
            self._file,
            field="openlabel.coordinate_systems",
            expected="one system of a lidar (a sensor_cs with a stream of type lidar of its name), or one local_cs",
            got=f"{len(lidars)} and {len(local)} in {', '.join(systems)}"[:200],
        )


def standing_poses(content: Root, file: Path) -> dict[tuple[str, str], RigidTransform]:
    """(parent, child) -> parent_from_child of all systems whose pose holds in every frame.

    Raises:
        DataError: a pose that is none.
    """
    poses = {}
    for name, system in content.coordinate_systems.items():
        if system.parent and system.pose_wrt_parent is not None:
            field = f"openlabel.coordinate_systems.{name}.pose_wrt_parent"
            poses[(system.parent, name)] = read_transform(system.pose_wrt_parent, file, field)
    return poses


def read_transform(data: TransformData, file: Path, field: str) -> RigidTransform:
    """A pose of the file: maps points of the source (the child) into the destination (the parent).

    Angles are turned about the axes that `sequence` names, one after the other about the turned axes.

    Raises:
        DataError: none or more than one of the three ways to write it, or numbers that are no pose.
    """
    given = [name for name in ("matrix4x4", "quaternion", "euler_angles") if getattr(data, name) is not None]
    if len(given) != 1:
        expected = "one of matrix4x4, quaternion and euler_angles"
        raise DataError(file, field=field, expected=expected, got=" and ".join(given) or "none")
    if data.matrix4x4 is not None:
        _demand(data.matrix4x4, 16, file, f"{field}.matrix4x4")
        matrix = np.array(data.matrix4x4, dtype=np.float64).reshape(4, 4)
        if not np.allclose(matrix[3], [0.0, 0.0, 0.0, 1.0]):
            got = str(matrix[3].tolist())
            raise DataError(file, field=f"{field}.matrix4x4", expected="a last row of 0, 0, 0, 1", got=got)
        try:
            return RigidTransform.from_matrix(matrix)
        except ShapeError as error:
            raise data_error(error, file=file, field=f"{field}.matrix4x4") from error
    _demand(data.translation, 3, file, f"{field}.translation")
    if data.quaternion is not None:
        _demand(data.quaternion, 4, file, f"{field}.quaternion")
        x, y, z, w = data.quaternion
        if abs(float(np.linalg.norm(data.quaternion)) - 1.0) > 1e-3:
            got = str(list(data.quaternion))
            raise DataError(file, field=f"{field}.quaternion", expected="x, y, z, w of length 1", got=got)
        return RigidTransform.from_quaternion((w, x, y, z), data.translation or ())
    _demand(data.euler_angles, 3, file, f"{field}.euler_angles")
    sequence = data.sequence.upper()
    if len(sequence) != 3 or set(sequence) - set("XYZ") or sequence[0] == sequence[1] or sequence[1] == sequence[2]:
        raise DataError(file, field=f"{field}.sequence", expected="three axes, as ZYX", got=repr(data.sequence)[:80])
    rotation = Rotation.from_euler(sequence, data.euler_angles or ()).as_matrix()
    return RigidTransform(rotation, np.array(data.translation, dtype=np.float64))


def chain(start: str, end: str, edges: Mapping[tuple[str, str], RigidTransform]) -> RigidTransform | None:
    """Follow poses from one system to another.

    Args:
        start: name of a system.
        end: name of another.
        edges: (parent, child) -> parent_from_child.

    Returns:
        `end_from_start` along the fewest poses; None where nothing leads there.
    """
    found = {start: RigidTransform.identity()}
    queue = [start]
    while queue and end not in found:
        here = queue.pop(0)
        for (parent, child), parent_from_child in edges.items():
            if child == here and parent not in found:
                found[parent] = parent_from_child @ found[here]
                queue.append(parent)
            elif parent == here and child not in found:
                found[child] = parent_from_child.inverse() @ found[here]
                queue.append(child)
    return found.get(end)


def _demand(values: Sequence[float] | None, count: int, file: Path, field: str) -> None:
    if values is None or len(values) != count:
        raise DataError(
            file, field=field, expected=f"{count} numbers", got="none" if values is None else str(len(values))
        )
