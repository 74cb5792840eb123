"""The aiMotive data set's own odometry: `sensor/gnssins/egomotion.json`, a pose for each frame."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.adapters.aimotive.calibration import AimotiveOptions
from bench.atomic import linked_folder, path_inside
from bench.egomotion import Trajectory, read_bus_signals
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings.files import read_object
from bench.recordings.validation import located

FILE = "sensor/gnssins/egomotion.json"
POSE = "RT_ECEF_body"
AXES_M = np.array([6_378_137.0, 6_378_137.0, 6_356_752.3142])  # of the WGS 84 ellipsoid


def sequence_trajectory(root: Path, folder: Path, options: AimotiveOptions, times_ns: Mapping[int, int]) -> Trajectory:
    """The ego-motion that the card names, or the data set's own; arguments and errors as for `read_egomotion`."""
    if options.ego_motion is None:
        return read_egomotion(linked_folder(root, folder, levels=options.follow_links), folder, times_ns)
    name = options.ego_motion.file.replace("{sequence}", folder.name)
    path = path_inside(root, name, file=root, field="options.ego_motion.file")
    return read_bus_signals(path, columns=options.ego_motion.columns).trajectory()


def read_egomotion(root: Path, folder: Path, times_ns: Mapping[int, int]) -> Trajectory:
    """Read the poses.

    The file maps frame numbers to entries with a 4 x 4 matrix that takes points of the body into the earth-centred,
    earth-fixed frame. The world here begins at the first pose, with z along the local vertical.

    Args:
        root: folder of the data set, which the file must not leave.
        folder: of the sequence.
        times_ns: of frames, from the files of boxes; poses of other frames are passed over.

    Raises:
        DataError: missing, not JSON, an entry that is no pose, or fewer than two poses.
    """
    file = folder / FILE
    content = read_object(root, file, expected="poses by frame number")
    poses = {int(key): _pose(entry, key, file) for key, entry in content.items() if _is_wanted(key, times_ns)}
    frames = sorted(poses)
    if len(frames) < 2:
        expected = f"poses of two frames at least, of those from {min(times_ns)} to {max(times_ns)}"
        raise DataError(file, expected=expected, got=str(len(frames)))
    start = poses[frames[0]]
    world_from_earth = RigidTransform(upright := _upright(start.translation_m), -upright @ start.translation_m)
    placed = [world_from_earth @ poses[frame] for frame in frames]
    return Trajectory(
        source=str(file),
        timestamps_ns=np.array([times_ns[frame] for frame in frames], dtype=np.int64),
        rotations=Rotation.from_matrix(np.stack([pose.rotation for pose in placed])),
        positions_m=np.stack([pose.translation_m for pose in placed]),
    )


def _is_wanted(key: str, times_ns: Mapping[int, int]) -> bool:
    return key.isascii() and key.isdigit() and len(key) < 10 and int(key) in times_ns


def _pose(entry: Any, key: str, file: Path) -> RigidTransform:
    field = f"{key}.{POSE}"
    try:
        with located(file, field):
            return RigidTransform.from_matrix(np.array(entry[POSE], dtype=np.float64))
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(file, field=field, expected="a 4 x 4 matrix", got=f"none ({type(error).__name__})") from None


def _upright(position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation that turns the local vertical at a place on the earth to z; which way x looks does not matter."""
    up = position_m / AXES_M**2
    if not np.linalg.norm(position_m) > 1_000_000.0:  # a local frame, with z up already
        return np.eye(3)
    up = up / np.linalg.norm(up)
    east = np.cross([0.0, 0.0, 1.0], up) if abs(up[2]) < 0.99 else np.cross([1.0, 0.0, 0.0], up)
    east /= np.linalg.norm(east)
    return np.stack([east, np.cross(up, east), up])
