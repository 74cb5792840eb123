"""Projects for labelling tools: point clouds, images, calibration and boxes of a recording, as each tool finds them.

A project's frames are named after the sweeps, or by their times, so that what people label in it comes back by
`import_labels`. Points, boxes and calibration are in the frame of the lidar at the time of the sweep. Of the tools only
SUSTechPOINTS projects boxes into images, by a pinhole: its images are rectified, three level views of a wide lens. The
others show the images as they are.

Source:
    SUSTechPOINTS: scene_reader.py and public/js/image.js; CVAT: the layout of 3D tasks with `related_images`, and
    Datumaro's reader of KITTI's raw data; labelCloud: its default configuration.
"""

from __future__ import annotations

import json
import re
from bisect import bisect_left
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import radians, tan
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.atomic import new_folder, write_bytes, write_text
from bench.cameras.pinhole import PinholeCamera
from bench.errors import UnknownNameError
from bench.geometry import RigidTransform
from bench.labels.formats import LabelOptions, LabelSet, export_labels
from bench.labels.frames import frame_names
from bench.labels.kitti_tracklets import ID_ATTRIBUTE, CvatTracklets
from bench.labels.motion import states_at_sweeps
from bench.lidar import LidarSweep
from bench.lidar.cloud_files import write_pcd
from bench.recordings import Cuboid, MountedCamera, ObjectState, Recording, read_image
from bench.reference.clusters import object_cluster
from bench.reference.sweeps import pose_sweep

Points = Literal["deskewed", "recorded"]
Image = NDArray[np.uint8]
Images = Mapping[str, Image]
LONGEST_APART_NS = 100_000_000  # a sweep and an image that is shown with it
JPEG_QUALITY = 92
WIDEST_VIEW_RAD = radians(50.0)  # half the width of one pinhole view; a wider lens gets three
SIDE_RAD, VIEW_RAD = radians(60.0), radians(42.0)  # their directions, and half their width
SIDES = {"left": -SIDE_RAD, "middle": 0.0, "right": SIDE_RAD}
HEIGHT = 3 / 4  # of a view, as a part of its width: SUSTechPOINTS stretches others
STEEPEST = 0.9  # sine of the angle to the road of an axis that has a direction over it
CLEARANCE_M = 0.1  # returns lower above the bottom of a box are the ground's, which does not move with it


@dataclass(frozen=True, slots=True, kw_only=True)
class _Layout:
    """Places of a tool's files.

    Attributes:
        label_format: of the boxes.
        clouds: folder of the point clouds.
        prepare: writes what belongs to the whole recording, and gives a function that writes the images of a frame.
    """

    label_format: str
    clouds: str
    prepare: Callable[[Recording, Path], Callable[[str, Images], None]]


def write_project(
    recording: Recording,
    out: Path,
    *,
    tool: str,
    points: Points = "deskewed",
    progress: Callable[[float], None] = lambda _: None,
) -> tuple[str, ...]:
    """Write a recording with its tracks as a project for a labelling tool.

    Args:
        recording: with the tracks that people are to begin with; all its sweeps become frames.
        out: folder of the project, new or empty; it appears whole or not at all.
        tool: one of `PROJECTS`.
        points: "deskewed" moves every point to the time of the sweep, with the ego vehicle and, inside of a track's
            box, with the track; "recorded" leaves points as the lidar gives them.
        progress: called with the share of sweeps that are written.

    Returns:
        One line for each thing that the tool cannot hold, and for sweeps that could not be de-skewed.

    Raises:
        UnknownNameError: no such tool.
        DataError: something is in the folder, or a sweep or image cannot be read.
        OutputError: the project cannot be written.
    """
    if tool not in PROJECTS:
        raise UnknownNameError("labelling tool", tool, PROJECTS)
    layout, names = PROJECTS[tool], _sorted_names(recording)
    states, _ = states_at_sweeps(LabelSet(tracks=recording.tracks, timestamps_ns=()), recording, (Cuboid,))
    sweeps = tuple(replace(ref, path=Path(f"{names[ref.timestamp_ns]}.pcd")) for ref in recording.sweeps)
    as_recorded = 0
    with new_folder(out) as folder:
        write_images = layout.prepare(recording, folder)
        for number, ref in enumerate(recording.sweeps):
            sweep, name = ref.read(), names[ref.timestamp_ns]
            moved = None
            if points == "deskewed":
                moved = deskewed_points(sweep, recording, [state for _, state in states.get(ref.timestamp_ns, ())])
                as_recorded += moved is None and len(sweep.points_lidar) > 0
            write_pcd(
                folder / layout.clouds / f"{name}.pcd", sweep.points_lidar if moved is None else moved, sweep.intensity
            )
            write_images(name, _images_at(recording, ref.timestamp_ns))
            progress((number + 1) / len(recording.sweeps))
        _, lost = export_labels(layout.label_format, replace(recording, sweeps=sweeps), folder, LabelOptions())
    without = [f"{as_recorded} sweeps without ego-motion: their points are as recorded"] if as_recorded else []
    return (*lost, *without)


def deskewed_points(sweep: LidarSweep, recording: Recording, objects: list[ObjectState]) -> NDArray[np.float64] | None:
    """Points of a sweep where they were at its reference time.

    Args:
        sweep: of the recording.
        recording: for its ego-motion.
        objects: boxes at the time of the sweep; points on them are moved with them, so that the boxes fit.

    Returns:
        (N, 3) float64, m, lidar frame at the time of the sweep; None without points or ego-motion.
    """
    placed = pose_sweep(sweep, recording.trajectory, recording.vehicle_from_lidar, recording.lidar_from_sensor)
    rotations, positions_m, valid = recording.trajectory.at(np.array([sweep.timestamp_ns], dtype=np.int64))
    if placed is None or not valid[0]:
        return None
    world_from_vehicle = RigidTransform(rotations[0], positions_m[0])
    points_world = placed.points_world()
    for state in objects:
        cluster = object_cluster(
            placed,
            state,
            velocity_world_mps=world_from_vehicle.rotate(state.velocity_mps),
            world_from_vehicle=world_from_vehicle,
            exposure_ns=sweep.timestamp_ns,
            clearance_m=CLEARANCE_M,
        )
        points_world[cluster.rows] = cluster.points_world
    return (world_from_vehicle @ recording.vehicle_from_lidar).inverse().apply(points_world)


def _sorted_names(recording: Recording) -> dict[int, str]:
    """Sweep's time -> name of its frame: tools sort names as text, so that times stand where others would not do."""
    names = frame_names(recording, LabelOptions())
    return names if sorted(names.values()) == [*names.values()] else {time_ns: f"{time_ns:019d}" for time_ns in names}


def _images_at(recording: Recording, timestamp_ns: int) -> dict[str, Image]:
    """The image of each camera that is nearest to a time, BGR; none that is too far from it."""
    found = {}
    for name, camera in recording.cameras.items():
        images = recording.images.get(name, ())
        later = bisect_left(images, timestamp_ns, key=lambda image: image.timestamp_ns)
        around = images[max(later - 1, 0) : later + 1]
        nearest = min(around, key=lambda image: abs(image.timestamp_ns - timestamp_ns), default=None)
        if nearest is not None and abs(nearest.timestamp_ns - timestamp_ns) <= LONGEST_APART_NS:
            found[name] = read_image(nearest, camera, colour=True)
    return found


def _write_jpeg(file: Path, pixels: Image) -> None:
    written, content = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert written
    write_bytes(file, content.tobytes())


def _plain(name: str) -> str:
    """A camera's name as that of a file."""
    return re.sub(r"[^A-Za-z0-9_-]", "_", name)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PinholeView:
    """A part of a camera's image as a pinhole sees it.

    Attributes:
        name: of the camera, with the side where there are several.
        pinhole: its lens.
        camera_from_view: its direction, and no displacement.
        positions: (height, width, 2) float32, px, where its pixels lie in the camera's image; -1 for nowhere.
    """

    name: str
    pinhole: PinholeCamera
    camera_from_view: RigidTransform
    positions: NDArray[np.float32]


def pinhole_views(camera: MountedCamera) -> tuple[PinholeView, ...]:
    """Pinhole views of a camera, level where it looks over the road: one, or three of more than 100 degrees."""
    model = camera.model
    edges = np.array([[0.0, model.principal_point[1]], [model.width - 1.0, model.principal_point[1]]])
    rays, valid = model.unproject(edges)
    half_rad = float(np.arccos(rays[:, 2]).min()) if valid.all() else model.limit_angle_rad
    if half_rad <= WIDEST_VIEW_RAD:
        return (_pinhole_view(camera, camera.name, 0.0, half_rad),)
    return tuple(_pinhole_view(camera, f"{camera.name}_{side}", angle, VIEW_RAD) for side, angle in SIDES.items())


def _pinhole_view(camera: MountedCamera, name: str, angle_rad: float, half_rad: float) -> PinholeView:
    width, height = camera.model.width, round(camera.model.width * HEIGHT)
    focal_px = width / 2 / tan(half_rad)
    pinhole = PinholeCamera(
        width=width, height=height, focal=(focal_px, focal_px), principal_point=((width - 1) / 2, (height - 1) / 2)
    )
    turned = Rotation.from_euler("y", angle_rad).as_matrix()
    camera_from_view = RigidTransform(_level(camera.road.down) @ turned, np.zeros(3))
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2)
    rays, _ = pinhole.unproject(grid.astype(np.float64))
    pixels, valid = camera.model.project(camera_from_view.rotate(rays))
    pixels[~valid] = -1.0  # black
    return PinholeView(
        name=_plain(name),
        pinhole=pinhole,
        camera_from_view=camera_from_view,
        positions=pixels.reshape(height, width, 2).astype(np.float32),
    )


def _level(down: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) float64, axes (columns, camera frame) that look over the road as the camera does, y straight down."""
    if abs(down[2]) > STEEPEST:
        return np.eye(3)
    ahead = np.array([0.0, 0.0, 1.0]) - down[2] * down
    ahead /= np.linalg.norm(ahead)
    return np.stack([np.cross(down, ahead), down, ahead], axis=1)


def _prepare_sustechpoints(recording: Recording, out: Path) -> Callable[[str, Images], None]:
    """A scene: calib/camera/, camera/; `extrinsic` maps the lidar to the view, row by row."""
    views = {name: pinhole_views(camera) for name, camera in recording.cameras.items()}
    for name, of_camera in views.items():
        camera_from_lidar = recording.cameras[name].vehicle_from_camera.inverse() @ recording.vehicle_from_lidar
        for view in of_camera:
            (fx, fy), (cu, cv) = view.pinhole.focal, view.pinhole.principal_point
            view_from_lidar = view.camera_from_view.inverse() @ camera_from_lidar
            calibration = {
                "extrinsic": view_from_lidar.matrix.ravel().tolist(),
                "intrinsic": [fx, 0.0, cu, 0.0, fy, cv, 0.0, 0.0, 1.0],
            }
            write_text(out / "calib" / "camera" / f"{view.name}.json", json.dumps(calibration))

    def write_images(frame: str, images: Images) -> None:
        for name, pixels in images.items():
            for view in views[name]:
                seen = cv2.remap(pixels, view.positions, None, cv2.INTER_LINEAR)  # type: ignore[call-overload]
                _write_jpeg(out / "camera" / view.name / f"{frame}.jpg", np.asarray(seen, dtype=np.uint8))

    return write_images


def _prepare_cvat(_: Recording, out: Path) -> Callable[[str, Images], None]:
    """related_images/, and labels.json: the labels of the task, with the attribute that carries a track's id."""
    identity: dict[str, Any] = {"name": ID_ATTRIBUTE, "mutable": False, "input_type": "text"}
    identity |= {"default_value": "", "values": [""]}
    labels = [{"name": name, "attributes": [identity]} for name in CvatTracklets.classes.values()]
    write_text(out / "labels.json", json.dumps(labels, indent=1) + "\n")

    def write_images(frame: str, images: Images) -> None:
        for name, pixels in images.items():
            _write_jpeg(out / "related_images" / f"{frame}_pcd" / f"{_plain(name)}.jpg", pixels)

    return write_images


def _prepare_labelcloud(_: Recording, out: Path) -> Callable[[str, Images], None]:
    """One image for each point cloud, beside it, all cameras side by side."""

    def write_images(frame: str, images: Images) -> None:
        if images:
            height = max(pixels.shape[0] for pixels in images.values())
            even = [
                cv2.resize(pixels, (round(pixels.shape[1] * height / pixels.shape[0]), height))
                for pixels in images.values()
            ]
            _write_jpeg(out / "pointclouds" / f"{frame}.jpg", np.hstack(even).astype(np.uint8))

    return write_images


PROJECTS = {
    "sustechpoints": _Layout(label_format="sustechpoints", clouds="lidar", prepare=_prepare_sustechpoints),
    "cvat": _Layout(label_format="cvat-tracklets", clouds="pointcloud", prepare=_prepare_cvat),
    "labelcloud": _Layout(label_format="labelcloud-centroid-abs", clouds="pointclouds", prepare=_prepare_labelcloud),
}
