"""Where sensors sit on the vehicle, from the frames that a bag publishes once on /tf_static."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any

from bench.errors import DataError, ShapeError
from bench.geometry import RigidTransform
from bench.recordings.rosbag.messages import TRANSFORMS, decode, message_type
from bench.recordings.rosbag.storage import Topic

TOPIC = "/tf_static"
MOST_FRAMES = 10_000


class StaticFrames:
    """The frames of a vehicle, each known by its place in another; a frame told again replaces what was told before."""

    def __init__(self) -> None:
        self._neighbours: dict[str, dict[str, RigidTransform]] = {}
        self._parents: dict[str, str] = {}

    def add(self, topic: Topic, payload: bytes, *, file: Path) -> None:
        """Take a message of /tf_static.

        Raises:
            DataError: another message, or a transform that is none.
        """
        if message_type(topic) != TRANSFORMS:
            raise DataError(file, field=TOPIC, expected=f"messages {TRANSFORMS}", got=topic.message_type)
        for entry in decode(topic, payload, file=file).transforms:
            self._add(str(entry.header.frame_id).lstrip("/"), str(entry.child_frame_id).lstrip("/"), entry, file)

    def vehicle_from(self, frame: str, *, vehicle: str, file: Path, field: str) -> RigidTransform:
        """Where a frame is on the vehicle.

        Args:
            frame: its name.
            vehicle: name of the vehicle frame.
            file: that names them, for messages.
            field: where in the file.

        Raises:
            DataError: a frame that is not there, or not joined to the vehicle.
        """
        known = ", ".join(sorted(self._neighbours)[:20]) or "none; is /tf_static recorded?"
        for name in (vehicle, frame):
            if name not in self._neighbours and frame != vehicle:
                raise DataError(file, field=field, expected=f"the frame {name!r} in {TOPIC}", got=known)
        waiting, reached = deque([vehicle]), {vehicle: RigidTransform.identity()}
        while waiting:
            here = waiting.popleft()
            for name, here_from_name in self._neighbours.get(here, {}).items():
                if name not in reached:
                    reached[name] = reached[here] @ here_from_name
                    waiting.append(name)
        if frame not in reached:
            got = f"no way between them; {vehicle!r} is joined to {', '.join(sorted(reached)[:20])}"
            raise DataError(file, field=field, expected=f"{frame!r} joined to {vehicle!r} in {TOPIC}", got=got)
        return reached[frame]

    def _add(self, parent: str, child: str, entry: Any, file: Path) -> None:
        turn, shift = entry.transform.rotation, entry.transform.translation
        try:
            parent_from_child = RigidTransform.from_quaternion(
                (turn.w, turn.x, turn.y, turn.z), (shift.x, shift.y, shift.z)
            )
        except ShapeError as error:
            raise DataError(file, field=f"{TOPIC}, {child[:40]}", expected="a transform", got=str(error)) from error
        if len(self._neighbours) >= MOST_FRAMES:
            raise DataError(file, field=TOPIC, expected=f"at most {MOST_FRAMES} frames", got="more")
        for other in list(self._neighbours.get(child, {})):  # a frame has one parent: the last that was told
            if self._parents.get(child) == other and other != parent:
                del self._neighbours[child][other], self._neighbours[other][child]
        self._parents[child] = parent
        self._neighbours.setdefault(parent, {})[child] = parent_from_child
        self._neighbours.setdefault(child, {})[parent] = parent_from_child.inverse()
