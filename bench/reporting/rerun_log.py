"""A recording for the viewer rerun: the path, the lidar in the world, boxes, and the overlay of each image.

The viewer knows pinhole cameras only, so what a fisheye sees is projected here and logged as a flat picture.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.atomic import refuse_foreign, replacing
from bench.errors import OutputError, UsageError
from bench.recordings import Cuboid, ImageRef, Recording
from bench.reporting.video import SeenSweep

TIMELINE = "exposure"
NEAR_STATE_NS = 60_000_000
POINT_RADIUS_M = 0.03
LEAST_ROOM_BYTES = 65_536  # with less the library waits for ever


class RerunLog:
    """Takes frames in turn; see `rerun_log`."""

    def __init__(self, rerun: ModuleType, stream: Any, recording: Recording) -> None:
        self._rr, self._stream, self._recording = rerun, stream, recording
        stream.log("world", rerun.ViewCoordinates.FLU, static=True)
        path_m = recording.trajectory.positions_m.astype(np.float32)
        stream.log("world/path", rerun.LineStrips3D([path_m]), static=True)
        outline = np.column_stack([recording.vehicle_outline_m, np.zeros(len(recording.vehicle_outline_m))])
        stream.log("world/vehicle/outline", rerun.LineStrips3D([np.vstack([outline, outline[:1]])]), static=True)

    def add(self, image: ImageRef, picture: NDArray[np.uint8], seen: SeenSweep | None) -> None:
        """Log one image.

        Args:
            image: which.
            picture: (H, W, 3) BGR uint8, its overlay.
            seen: its lidar sweep, if there is one.

        Raises:
            DataError: no ego-motion at the image.
        """
        rr, stream = self._rr, self._stream
        stream.set_time(TIMELINE, timestamp=np.datetime64(image.timestamp_ns, "ns"))
        pose = self._recording.trajectory.world_from_vehicle(image.timestamp_ns)
        stream.log("world/vehicle", rr.Transform3D(translation=pose.translation_m, mat3x3=pose.rotation))
        rgb = cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)
        stream.log(f"images/{image.camera}", rr.Image(rgb).compress(jpeg_quality=90))
        if seen is not None:
            stream.log("world/lidar", rr.Points3D(seen.points_world.astype(np.float32), radii=POINT_RADIUS_M))
        self._boxes(image.timestamp_ns)

    def _boxes(self, time_ns: int) -> None:
        centres, halves, turns, labels = [], [], [], []
        for track in self._recording.tracks:
            state = track.state_near(time_ns, within_ns=NEAR_STATE_NS)
            if state is None or not isinstance(state.shape, Cuboid):
                continue
            pose = self._recording.trajectory.world_from_vehicle(state.timestamp_ns) @ state.shape.vehicle_from_object
            centres.append(pose.translation_m)
            halves.append(state.shape.size_m / 2)
            turns.append(Rotation.from_matrix(pose.rotation).as_quat(scalar_first=False))
            labels.append(f"{track.object_class} {track.track_id}")
        boxes = self._rr.Boxes3D(
            centers=np.array(centres).reshape(-1, 3),
            half_sizes=np.array(halves).reshape(-1, 3),
            quaternions=np.array(turns).reshape(-1, 4),
            labels=labels,
        )
        self._stream.log("world/objects", boxes)


@contextmanager
def rerun_log(path: Path, *, recording: Recording, cameras: Sequence[str]) -> Iterator[RerunLog]:
    """A file for the viewer that appears whole or not at all.

    Args:
        path: *.rrd.
        recording: the drive.
        cameras: names of the cameras whose images are logged.

    Yields:
        Takes the frames.

    Raises:
        UsageError: the viewer's library is not installed, or another suffix.
        OutputError: the file is there, cannot be written, or not to its end.
    """
    rerun = viewer()
    refuse_other_log(path)
    refuse_foreign(path)
    with replacing(path) as temporary:
        stream = rerun.RecordingStream("fisheye-bench", recording_id="-".join([recording.name, *cameras]))
        temporary.write_bytes(bytes(LEAST_ROOM_BYTES))
        with _write_errors(path):
            stream.save(str(temporary))
        try:
            yield RerunLog(rerun, stream, recording)
            with _write_errors(path):
                stream.flush()
        finally:
            stream.disconnect()


@contextmanager
def _write_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except RuntimeError as error:  # the library's thread that writes has ended; why, it prints itself
        raise OutputError(path, got=str(error), hint="free some disk space, then run the same command again") from error


def viewer() -> ModuleType:
    """The viewer's library, which is optional.

    Raises:
        UsageError: it is not installed.
    """
    try:
        import rerun
    except ImportError as error:
        raise UsageError(
            f"--rrd: expected the optional viewer rerun, got none ({error}); "
            "install it: pip install 'fisheye-bench[viewer]', or write a --video instead"
        ) from error
    module: ModuleType = rerun
    return module


def refuse_other_log(path: Path) -> None:
    """Refuse a file that is not *.rrd.

    Raises:
        UsageError: it is not.
    """
    if path.suffix.lower() != ".rrd":
        raise UsageError(f"--rrd: expected a file *.rrd, got {path.name!r}")
