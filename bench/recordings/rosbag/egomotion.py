"""Ego-motion from the messages of a bag: poses, or speed and yaw rate from whatever topics have them."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.egomotion import Trajectory, planar_trajectory
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings.rosbag.index import NO_STAMP, Consumer, Times
from bench.recordings.rosbag.messages import ODOMETRY, POSES, decode, message_type, number_at
from bench.recordings.rosbag.rig import EgoMotionRig, ReverseRig, SignalRig
from bench.recordings.rosbag.storage import Topic
from bench.recordings.rosbag.times import Clock, usable_times

UNIT_TOLERANCE = 1e-2


class EgoMotionMessages:
    """Collects what messages say of the ego-motion while a bag is walked through.

    Args:
        rig: which messages say it.
        clock: whose times count; messages without a header have the time at which they were recorded.
    """

    def __init__(self, rig: EgoMotionRig, clock: Clock) -> None:
        self._rig, self._clock = rig, clock
        self._poses = _Series(7)
        self._speed, self._yaw_rate, self._reverse = _Series(1), _Series(1), _Series(1)

    def consumers(self) -> Mapping[str, Consumer]:
        """What takes the messages of each topic."""
        rig = self._rig
        topics = [entry.topic for entry in (rig.odometry, rig.speed, rig.yaw_rate, rig.reverse) if entry is not None]
        return dict.fromkeys(topics, self._take)

    def trajectory(self, *, child_from_vehicle: RigidTransform, file: Path, losses: list[DataError]) -> Trajectory:
        """The path that the messages describe.

        Speed and yaw rate may come at other times: the one that comes more often is kept, the other is interpolated
        between its neighbours, where they are no further apart than `max_gap_ns`.

        Args:
            child_from_vehicle: of the frame whose poses are told.
            file: for messages.
            losses: takes what is left out.

        Raises:
            DataError: no messages, or too few that can be used.
        """
        rig = self._rig
        if rig.odometry is not None:
            times_ns, poses = self._poses.table(rig.odometry.topic, self._clock, file, losses)
            return _posed(times_ns, poses, child_from_vehicle, rig, file, losses)
        assert rig.speed is not None
        assert rig.yaw_rate is not None
        speed = self._speed.table(rig.speed.topic, self._clock, file, losses)
        yaw_rate = self._yaw_rate.table(rig.yaw_rate.topic, self._clock, file, losses)
        often, seldom = (speed, yaw_rate) if len(speed[0]) >= len(yaw_rate[0]) else (yaw_rate, speed)
        values, valid = _between(*seldom, often[0], rig.max_gap_ns)
        times_ns = often[0][valid]
        if len(times_ns) < 2:
            got = f"{len(speed[0])} of speed, {len(yaw_rate[0])} of yaw rate, {len(times_ns)} in common"
            raise DataError(file, field="ego_motion", expected="at least two times with speed and yaw rate", got=got)
        pair = (often[1][valid, 0], values[valid])
        speed_mps, yaw_rate_radps = pair if often is speed else pair[::-1]
        if rig.reverse is not None:
            told = self._reverse.table(rig.reverse.topic, self._clock, file, losses)
            speed_mps = _signed(speed_mps, times_ns, *told)
        path = planar_trajectory(
            source=str(file), timestamps_ns=times_ns, speed_mps=speed_mps, yaw_rate_radps=yaw_rate_radps
        )
        return replace(path, max_gap_ns=rig.max_gap_ns)

    def _take(self, topic: Topic, times: Times, payload: bytes, file: Path) -> None:
        message = decode(topic, payload, file=file)
        rig = self._rig
        if rig.odometry is not None and rig.odometry.topic == topic.name:
            self._poses.add(times, _pose(topic, message, file))
        for signal, series in ((rig.speed, self._speed), (rig.yaw_rate, self._yaw_rate)):
            if signal is not None and signal.topic == topic.name:
                series.add(times, (_signal(signal, message, file),))
        if rig.reverse is not None and rig.reverse.topic == topic.name:
            self._reverse.add(times, (float(_is_reverse(rig.reverse, message, file)),))


class _Series:
    """Times and numbers, as they come."""

    def __init__(self, columns: int) -> None:
        self._log_ns, self._stamp_ns, self._values = array("q"), array("q"), array("d")
        self._columns, self._headed = columns, True

    def add(self, times: Times, values: tuple[float, ...]) -> None:
        self._log_ns.append(times.log_ns)
        self._headed = times.stamp_ns is not None
        self._stamp_ns.append(NO_STAMP if times.stamp_ns is None else times.stamp_ns)
        self._values.extend(values)

    def table(
        self, topic: str, clock: Clock, file: Path, losses: list[DataError]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Times that increase, and (N, columns) finite numbers."""
        if not self._log_ns:
            raise DataError(file, field=topic, expected="messages of the ego-motion", got="none")
        log_ns, stamp_ns = (np.array(column, dtype=np.int64) for column in (self._log_ns, self._stamp_ns))
        values = np.array(self._values, dtype=np.float64).reshape(-1, self._columns)
        order = np.argsort(log_ns, kind="stable")
        used: Clock = clock if self._headed else "bag"
        times_ns, valid = usable_times(log_ns[order], stamp_ns[order], clock=used, what=topic, file=file, losses=losses)
        values = values[order]
        finite = np.asarray(np.isfinite(values).all(axis=1))
        if not finite.all():
            got = f"NaN or infinity in {int((~finite).sum())} of {len(finite)} messages"
            losses.append(DataError(file, field=topic, expected="finite numbers", got=got))
        return times_ns[valid & finite], values[valid & finite]


def _pose(topic: Topic, message: Any, file: Path) -> tuple[float, ...]:
    if message_type(topic) not in (ODOMETRY, *POSES):
        expected = f"messages {', '.join((ODOMETRY, *POSES))}"
        raise DataError(file, field=topic.name, expected=expected, got=topic.message_type)
    pose = getattr(message.pose, "pose", message.pose)
    place, turn = pose.position, pose.orientation
    return place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z


def _signal(signal: SignalRig, message: Any, file: Path) -> float:
    paths = (signal.field,) if isinstance(signal.field, str) else signal.field
    values = [number_at(message, path, file=file, topic=signal.topic) for path in paths]
    for path, value in zip(paths, values, strict=True):
        if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.number):
            field = f"{signal.topic}, {path}"
            raise DataError(file, field=field, expected="a number", got=type(value).__name__)
    return signal.factor * float(np.mean(values))


def _is_reverse(rig: ReverseRig, message: Any, file: Path) -> bool:
    value = number_at(message, rig.field, file=file, topic=rig.topic)
    return any(value == expected for expected in rig.values)


def _between(
    known_ns: NDArray[np.int64], known: NDArray[np.float64], times_ns: NDArray[np.int64], max_gap_ns: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Values at times, each between two known ones that are not too far apart."""
    if len(known_ns) < 2:
        return np.full(len(times_ns), np.nan), np.zeros(len(times_ns), dtype=bool)
    right = np.clip(np.searchsorted(known_ns, times_ns), 1, len(known_ns) - 1)
    span_ns = known_ns[right] - known_ns[right - 1]
    share = (times_ns - known_ns[right - 1]) / span_ns.astype(np.float64)
    values = known[right - 1, 0] + share * (known[right, 0] - known[right - 1, 0])
    valid = (share >= 0) & (share <= 1) & (span_ns <= max_gap_ns)
    return np.where(valid, values, np.nan), valid


def _signed(
    speed_mps: NDArray[np.float64],
    times_ns: NDArray[np.int64],
    told_ns: NDArray[np.int64],
    reverse: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Backwards where the last message said so; before the first one what that says."""
    last = np.maximum(np.searchsorted(told_ns, times_ns, side="right") - 1, 0)
    return np.where(reverse[last, 0] > 0, -np.abs(speed_mps), np.abs(speed_mps))


def _posed(
    times_ns: NDArray[np.int64],
    poses: NDArray[np.float64],
    child_from_vehicle: RigidTransform,
    rig: EgoMotionRig,
    file: Path,
    losses: list[DataError],
) -> Trajectory:
    unit = np.asarray(np.abs(np.linalg.norm(poses[:, 3:], axis=1) - 1.0) < UNIT_TOLERANCE)
    assert rig.odometry is not None
    if not unit.all():
        got = f"{int((~unit).sum())} of {len(unit)} of another length"
        losses.append(DataError(file, field=rig.odometry.topic, expected="quaternions of length 1", got=got))
    if unit.sum() < 2:
        got = f"{int(unit.sum())} that can be used"
        raise DataError(file, field=rig.odometry.topic, expected="at least two poses", got=got)
    world_from_child = Rotation.from_quat(poses[unit, 3:], scalar_first=True)
    return Trajectory(
        source=str(file),
        timestamps_ns=times_ns[unit],
        rotations=world_from_child * Rotation.from_matrix(child_from_vehicle.rotation),
        positions_m=poses[unit, :3] + world_from_child.apply(np.array(child_from_vehicle.translation_m)),
        max_gap_ns=rig.max_gap_ns,
    )
