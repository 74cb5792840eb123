"""Ego-motion, from poses or from speed and yaw rate, and frames: made of messages while a bag is walked through."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.adapters.rosbag.bag import BagMessage, Clock, TimedRows
from bench.adapters.rosbag.messages import ODOMETRY, POSES, TRANSFORMS, decode, field_value
from bench.adapters.rosbag.rig import EgoMotionRig, OdometryRig, ReverseRig, SignalRig
from bench.egomotion import Trajectory, planar_trajectory
from bench.errors import DataError, ShapeError
from bench.geometry import RigidTransform

UNIT_TOLERANCE = 1e-2  # of the length of a quaternion
STATIC_FRAMES = "/tf_static"
MOST_FRAMES = 10_000


class EgoMotionMessages:
    """Collects the numbers of the ego-motion while a bag is walked through.

    Args:
        rig: which messages have them.
    """

    def __init__(self, rig: EgoMotionRig) -> None:
        self._max_gap_ns = rig.max_gap_ns
        signals = {"odometry": rig.odometry, "speed": rig.speed, "yaw_rate": rig.yaw_rate, "reverse": rig.reverse}
        self._signals = {name: signal for name, signal in signals.items() if signal is not None}
        self._rows = {name: TimedRows(7 if name == "odometry" else 1, "d") for name in self._signals}
        self.topics = frozenset(signal.topic for signal in self._signals.values())

    def take(self, message: BagMessage) -> None:
        """Take a message of one of the `topics`.

        Raises:
            DataError: another message, or one without the fields that the rig file names.
        """
        content = decode(message.topic, message.start, file=message.file)
        for name, signal in self._signals.items():
            if signal.topic == message.topic.name:
                self._rows[name].add(message, _numbers(signal, content, message))

    def trajectory(
        self, clock: Clock, *, child_from_vehicle: RigidTransform, file: Path, losses: list[DataError]
    ) -> Trajectory:
        """The path of the vehicle.

        Args:
            clock: whose times count.
            child_from_vehicle: of the frame whose poses the odometry gives.
            file: for errors.
            losses: gets an error for what is left out.

        Raises:
            DataError: no messages, or too few that can be used.
        """
        tables = {}
        for name, rows in self._rows.items():
            if rows.topic is None:
                topic = self._signals[name].topic
                raise DataError(file, field=topic, expected="messages of the ego-motion", got="none")
            tables[name] = rows.usable(clock, file=file, losses=losses)
        if "odometry" not in tables:
            return replace(self._steered(tables, file), max_gap_ns=self._max_gap_ns)
        (times_ns, poses), topic = tables["odometry"], self._signals["odometry"].topic
        unit = np.abs(np.linalg.norm(poses[:, 3:], axis=1) - 1.0) < UNIT_TOLERANCE
        if not unit.all():
            got = f"{int((~unit).sum())} of {len(unit)} of another length"
            losses.append(DataError(file, field=topic, expected="quaternions of length 1", got=got))
        if unit.sum() < 2:
            raise DataError(file, field=topic, expected="at least two poses", got=f"{int(unit.sum())} that can be used")
        world_from_child = Rotation.from_quat(poses[unit, 3:], scalar_first=True)
        return Trajectory(
            source=str(file),
            timestamps_ns=times_ns[unit],
            rotations=world_from_child * Rotation.from_matrix(child_from_vehicle.rotation),
            positions_m=poses[unit, :3] + world_from_child.apply(np.array(child_from_vehicle.translation_m)),
            max_gap_ns=self._max_gap_ns,
        )

    def _steered(self, tables: dict[str, tuple[NDArray[np.int64], NDArray[Any]]], file: Path) -> Trajectory:
        """From speed and yaw rate: at the times of the one that comes more often, the other interpolated."""
        (speed_ns, _), (yaw_rate_ns, _) = tables["speed"], tables["yaw_rate"]
        times_ns = speed_ns if len(speed_ns) >= len(yaw_rate_ns) else yaw_rate_ns
        speed_mps = self._interpolated(*tables["speed"], times_ns)
        yaw_rate_radps = self._interpolated(*tables["yaw_rate"], times_ns)
        valid = np.isfinite(speed_mps) & np.isfinite(yaw_rate_radps)
        if valid.sum() < 2:
            got = f"{len(speed_ns)} of speed, {len(yaw_rate_ns)} of yaw rate, {int(valid.sum())} in common"
            raise DataError(file, field="ego_motion", expected="at least two times with speed and yaw rate", got=got)
        if "reverse" in tables:
            # The gear is that of the last message; before the first one, that of the first.
            gear_ns, reverse = tables["reverse"]
            last = np.maximum(np.searchsorted(gear_ns, times_ns, side="right") - 1, 0)
            speed_mps = np.where(reverse[last, 0] > 0, -np.abs(speed_mps), np.abs(speed_mps))
        return planar_trajectory(
            source=str(file),
            timestamps_ns=times_ns[valid],
            speed_mps=speed_mps[valid],
            yaw_rate_radps=yaw_rate_radps[valid],
        )

    def _interpolated(
        self, known_ns: NDArray[np.int64], known: NDArray[Any], times_ns: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """(N,) values at times; NaN where not between two known ones that are close enough, or at a known one."""
        if known_ns is times_ns:
            return known[:, 0]
        if len(known_ns) < 2:
            return np.full(len(times_ns), np.nan)
        right = np.clip(np.searchsorted(known_ns, times_ns), 1, len(known_ns) - 1)
        values = np.interp(times_ns - known_ns[0], known_ns - known_ns[0], known[:, 0], left=np.nan, right=np.nan)
        return np.where(known_ns[right] - known_ns[right - 1] <= self._max_gap_ns, values, np.nan)


def _numbers(signal: OdometryRig | SignalRig | ReverseRig, content: Any, message: BagMessage) -> tuple[float, ...]:
    """Position (x, y, z) and quaternion (w, x, y, z), or the signal's value, or 1 for reverse gear and 0 for others."""
    if isinstance(signal, OdometryRig):
        message.topic.refuse_others(ODOMETRY, *POSES, file=message.file)
        pose = getattr(content.pose, "pose", content.pose)
        at, q = pose.position, pose.orientation
        return at.x, at.y, at.z, q.w, q.x, q.y, q.z
    paths = (signal.field,) if isinstance(signal.field, str) else signal.field
    values: list[Any] = [field_value(content, path, file=message.file, topic=signal.topic) for path in paths]
    for path, value in zip(paths, values, strict=True):
        number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
        if not number and not (isinstance(signal, ReverseRig) and isinstance(value, bool | np.bool_ | str)):
            field = f"{signal.topic}, {path}"
            raise DataError(message.file, field=field, expected="a number", got=type(value).__name__)
    if isinstance(signal, ReverseRig):
        return (float(values[0] in signal.values),)
    return (signal.factor * float(np.mean(values)),)


class StaticFrames:
    """The frames of /tf_static. Each has one parent, the last that was published."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, RigidTransform | DataError]] = {}  # child -> parent, parent_from_child

    def take(self, message: BagMessage) -> None:
        """Take a message of /tf_static.

        A transform that is none matters where its frame is asked for.

        Raises:
            DataError: another message.
        """
        message.topic.refuse_others(TRANSFORMS, file=message.file)
        for entry in decode(message.topic, message.start, file=message.file).transforms:
            child = str(entry.child_frame_id).lstrip("/")
            rotation, translation = entry.transform.rotation, entry.transform.translation
            parent_from_child: RigidTransform | DataError
            try:
                parent_from_child = RigidTransform.from_quaternion(
                    (rotation.w, rotation.x, rotation.y, rotation.z), (translation.x, translation.y, translation.z)
                )
            except ShapeError as error:
                field = f"{STATIC_FRAMES}, {child[:40]}"
                parent_from_child = DataError(message.file, field=field, expected="a transform", got=str(error))
            self._parents[child] = str(entry.header.frame_id).lstrip("/"), parent_from_child
        if len(self._parents) > MOST_FRAMES:
            raise DataError(message.file, field=STATIC_FRAMES, expected=f"at most {MOST_FRAMES} frames", got="more")

    def vehicle_from(self, frame: str, *, vehicle: str, file: Path, field: str) -> RigidTransform:
        """Return the pose of a frame on the vehicle.

        Args:
            frame: its name.
            vehicle: name of the vehicle frame.
            file: that names them, for errors.
            field: where in the file.

        Raises:
            DataError: a frame that is not there, or not joined to the vehicle.
        """
        names = set(self._parents) | {parent for parent, _ in self._parents.values()}
        got = ", ".join(sorted(names)[:20]) or "none; is /tf_static recorded?"
        frame, vehicle = frame.lstrip("/"), vehicle.lstrip("/")
        for name in (vehicle, frame):
            if name not in names and frame != vehicle:
                raise DataError(file, field=field, expected=f"the frame {name!r} in {STATIC_FRAMES}", got=got)
        (root, root_from_frame), (vehicle_root, root_from_vehicle) = self._root_from(frame), self._root_from(vehicle)
        if root != vehicle_root:
            got = f"one below {root!r}, the other below {vehicle_root!r}"
            raise DataError(file, field=field, expected=f"{frame!r} joined to {vehicle!r} in {STATIC_FRAMES}", got=got)
        return root_from_vehicle.inverse() @ root_from_frame

    def _root_from(self, frame: str) -> tuple[str, RigidTransform]:
        """The frame above all others of this one's tree, and this one in it."""
        root, root_from_frame, passed = frame, RigidTransform.identity(), set[str]()
        while root in self._parents and root not in passed:
            passed.add(root)
            root, parent_from_child = self._parents[root]
            if isinstance(parent_from_child, DataError):
                raise parent_from_child
            root_from_frame = parent_from_child @ root_from_frame
        return root, root_from_frame
