"""Coordinate systems, lenses and mountings of an OpenLABEL file.

Coordinate systems of an OpenLABEL file, chained to our vehicle frame.

The chain ends at the lidar where the file knows one, since what was labelled are the points of the lidar, and our
recording has its mounting: a file's own vehicle frame may have its origin elsewhere. Without a lidar, or where the file
states no pose between it and the other systems, other chains end at the file's one local system, which is taken for our
vehicle frame.

Lenses in the streams of an OpenLABEL file <-> camera models.

`intrinsics_custom` with the fields of our camera models says everything and goes first. `intrinsics_fisheye` is read in
the schema's spelling (lens_coeffs, center_x_px, center_y_px) and in the library's (lens_coeffs_1x4, lens_coeffs_1xN,
center_x, center_y). What its coefficients mean depends on the rest:

- four without a focal length, or the model "radial_poly": r = k1 t + k2 t^2 + k3 t^3 + k4 t^4, px, t in radians;
- four with a focal length, or the model "opencv_fisheye": r = f (t + k1 t^3 + k2 t^5 + k3 t^7 + k4 t^9);
- five, or the model "kannala": r = f (k1 t + k2 t^3 + k3 t^5 + k4 t^7 + k5 t^9), f = 1 without a focal length.

The distortion of `intrinsics_pinhole` is OpenCV's: k1, k2, p1, p2 and, where there is a fifth, k3. Files do not say
where a pixel has its centre: (0, 0) is taken for the centre of the first one, as everywhere here.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from bench.cameras import CameraModel, camera_from_parameters, camera_parameters
from bench.cameras.angular import KannalaBrandtCamera, RadialPolynomialCamera
from bench.cameras.brown import BrownConradyCamera
from bench.cameras.pinhole import PinholeCamera
from bench.errors import DataError, ShapeError, UnknownNameError
from bench.geometry import RigidTransform
from bench.labels.formats import finite_number
from bench.labels.openlabel_file import Root, StreamProperties, TransformData, read_label_file
from bench.recordings import Recording
from bench.recordings.schema import CameraHead, LidarHead, Mounting
from bench.recordings.validation import located, validated

LIDAR_WORDS = ("lidar", "velo", "laser", "pandar", "ouster", "hesai")


class Systems:
    """Poses of the file's systems in our vehicle frame.

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
        self._constant = constant_poses(content, file)
        self._anchors = self._anchored(recording)
        self._taken: str | None = None

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
    def guesses(self) -> list[str]:
        """One line for each thing that the file does not say and that was taken for granted."""
        if not self._content.coordinate_systems:
            return ["the file names no coordinate system: read in the frame of the lidar"]
        if self._taken is None:
            return []
        lidar = next(iter(self._anchors))
        guess = (
            f"the file does not say where {lidar!r} lies: {self._taken!r} is taken for the vehicle frame, origin on the"
        )
        return [f"{guess} ground below the rear axle; where that is wrong, add pose_wrt_parent to {lidar!r}"]

    def _chain(self, name: str | None, frame: str | None) -> RigidTransform:
        start = next(iter(self._anchors)) if name is None else name
        field = "openlabel.coordinate_systems" + ("" if frame is None else f", frame {frame}")
        if start not in self._anchors and start not in self._content.coordinate_systems:
            known = ", ".join(self._content.coordinate_systems) or "none"
            raise DataError(self._file, field=field, expected=f"one of {known}", got=repr(start))
        edges = dict(self._constant)
        if frame is not None:
            for key, moved in self._content.frames[frame].frame_properties.transforms.items():
                place = f"openlabel.frames.{frame}.frame_properties.transforms.{key}"
                edges.pop((moved.src, moved.dst), None)
                edges[(moved.dst, moved.src)] = read_transform(moved.transform_src_to_dst, self._file, place)
        for number, (anchor, vehicle_from_anchor) in enumerate(self._anchors.items()):
            chained = chain(start, anchor, edges)
            if chained is not None:
                self._taken = anchor if number else self._taken
                return vehicle_from_anchor @ chained
        hint = "give pose_wrt_parent, or frame_properties.transforms in every frame"
        expected = f"poses from {start!r} to {' or '.join(map(repr, self._anchors))}"
        raise DataError(self._file, field=field, expected=expected, got="none", hint=hint)

    def _anchored(self, recording: Recording) -> dict[str, RigidTransform]:
        """Systems at which a chain may end, the first that it reaches, and our vehicle frame from each."""
        systems, streams = self._content.coordinate_systems, self._content.streams
        if not systems:
            return {"lidar": recording.vehicle_from_lidar}
        lidars = [name for name in systems if name in streams and streams[name].type == "lidar"]
        lidars = lidars or [
            name
            for name, system in systems.items()
            if system.type in {"sensor_cs", "sensor"} and any(word in name.casefold() for word in LIDAR_WORDS)
        ]
        local = [name for name, system in systems.items() if system.type in {"local_cs", "local"}]
        anchors = {lidars[0]: recording.vehicle_from_lidar} if len(lidars) == 1 else {}
        if len(local) == 1 and not (anchors and self._is_placed(lidars[0])):
            anchors[local[0]] = RigidTransform.identity()
        if not anchors:
            raise DataError(
                self._file,
                field="openlabel.coordinate_systems",
                expected="one system of a lidar (a sensor_cs with a stream of type lidar of its name), or one local_cs",
                got=f"{len(lidars)} and {len(local)} in {', '.join(systems)}"[:200],
            )
        return anchors

    def _is_placed(self, name: str) -> bool:
        """Return True where a pose leads to or from a system, always or in any frame."""
        moved = (m for frame in self._content.frames.values() for m in frame.frame_properties.transforms.values())
        return any(name in edge for edge in self._constant) or any(name in (m.src, m.dst) for m in moved)


def constant_poses(content: Root, file: Path) -> dict[tuple[str, str], RigidTransform]:
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

    Angles are rotated about the axes that `sequence` names, one after the other about the rotated axes.

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
        with located(file, f"{field}.matrix4x4"):
            return RigidTransform.from_matrix(matrix)
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


COEFFICIENTS = ("lens_coeffs", "lens_coeffs_1x4", "lens_coeffs_1xN")
CENTRES = (("center_x_px", "center_x"), ("center_y_px", "center_y"))
MODELS = ("model", "fisheye_model")
MATRICES, DISTORTIONS = ("camera_matrix", "camera_matrix_3x4"), ("distortion_coeffs", "distortion_coeffs_1xN")
NO_DISTORTION = [0.0] * 5


def read_lens(properties: StreamProperties, file: Path, field: str) -> CameraModel | None:
    """The lens of a stream; None where the file has none.

    Raises:
        DataError: numbers that are missing or make no lens, a lens that no camera model here can hold.
    """
    with located(file, field):
        if properties.intrinsics_custom is not None and "model" in properties.intrinsics_custom:
            return _custom(properties.intrinsics_custom, file, f"{field}.intrinsics_custom")
        if properties.intrinsics_fisheye is not None:
            return _fisheye(properties.intrinsics_fisheye, file, f"{field}.intrinsics_fisheye")
        if properties.intrinsics_pinhole is not None:
            return _pinhole(properties.intrinsics_pinhole, file, f"{field}.intrinsics_pinhole")
    return None


def lens_properties(camera: CameraModel) -> dict[str, Any]:
    """`stream_properties` of a camera: the schema's names where it has any for the lens, and all of it as ours."""
    parameters = camera_parameters(camera)
    size = {"width_px": camera.width, "height_px": camera.height}
    u, v = camera.principal_point
    centre = {"center_x_px": u, "center_y_px": v}
    properties: dict[str, Any] = {}
    if isinstance(camera, PinholeCamera | BrownConradyCamera):
        fx, fy = camera.focal
        matrix = [fx, 0.0, u, 0.0, 0.0, fy, v, 0.0, 0.0, 0.0, 1.0, 0.0]
        distortion = NO_DISTORTION
        if isinstance(camera, BrownConradyCamera):
            k1, k2, k3 = (*camera.radial, 0.0, 0.0, 0.0)[:3]
            distortion = [k1, k2, *camera.tangential, k3]
        properties["intrinsics_pinhole"] = {**size, "camera_matrix": matrix, "distortion_coeffs": distortion}
    elif isinstance(camera, RadialPolynomialCamera | KannalaBrandtCamera) and len(camera.coefficients) <= 4:
        lens: dict[str, Any]
        if isinstance(camera, RadialPolynomialCamera):
            lens = {"model": "radial_poly", "aspect_ratio": camera.aspect_ratio}
        else:
            focal_x, focal_y = camera.focal
            lens = {"model": "opencv_fisheye", "focal_length_x": focal_x, "focal_length_y": focal_y}
        padded = [*camera.coefficients, *[0.0] * (4 - len(camera.coefficients))]  # the schema has four
        properties["intrinsics_fisheye"] = {**size, **centre, **lens, "lens_coeffs": padded}
    return {**properties, "intrinsics_custom": parameters}


def _custom(values: Mapping[str, Any], file: Path, field: str) -> CameraModel:
    try:
        return camera_from_parameters(**values)
    except UnknownNameError as error:
        raise DataError(
            file, field=f"{field}.model", expected=f"one of {', '.join(error.known)}", got=error.name
        ) from error
    except ShapeError:
        raise
    except (TypeError, ValueError, OverflowError) as error:
        expected = "width, height and the parameters of the camera model"
        raise DataError(file, field=field, expected=expected, got=", ".join(map(str, values))[:200]) from error


def _fisheye(values: Mapping[str, Any], file: Path, field: str) -> CameraModel:
    coefficients = _list(values, COEFFICIENTS, file, field)
    width, height = _size(values, file, field)
    u, v = (_number(values, names, file, field) for names in CENTRES)
    if not (0 < u < width and 0 < v < height):
        hint = "some files have the distance from the middle of the image here: add (width - 1) / 2, (height - 1) / 2"
        expected = f"a centre in the image of {width} x {height} px"
        raise DataError(file, field=f"{field}.center_x_px, center_y_px", expected=expected, got=f"{u}, {v}", hint=hint)
    focal_x = _number(values, ("focal_length_x",), file, field, default=0.0)
    ratio = _number(values, ("aspect_ratio",), file, field, default=1.0) or 1.0
    model = next((values[name] for name in MODELS if isinstance(values.get(name), str)), None)
    model = model or ("kannala" if len(coefficients) == 5 else "opencv_fisheye" if focal_x else "radial_poly")
    shape: dict[str, Any] = {"width": width, "height": height, "principal_point": (u, v)}
    if model == "radial_poly":
        scale = focal_x or 1.0
        return camera_from_parameters(
            "radial_polynomial", **shape, coefficients=tuple(scale * k for k in coefficients), aspect_ratio=ratio
        )
    if model not in {"kannala", "opencv_fisheye"}:
        known = "radial_poly, kannala or opencv_fisheye"
        raise DataError(file, field=f"{field}.model", expected=known, got=repr(model)[:80])
    focal_x = focal_x or 1.0
    focal_y = _number(values, ("focal_length_y",), file, field, default=0.0) or focal_x / ratio
    if model == "kannala":
        first, *rest = coefficients
        if first <= 0:
            raise DataError(file, field=f"{field}.lens_coeffs", expected="a first one above 0", got=str(first))
        focal_x, focal_y, coefficients = focal_x * first, focal_y * first, [k / first for k in rest]
    return camera_from_parameters("kannala_brandt", **shape, focal=(focal_x, focal_y), coefficients=tuple(coefficients))


def _pinhole(values: Mapping[str, Any], file: Path, field: str) -> CameraModel:
    matrix = _list(values, MATRICES, file, field)
    if len(matrix) not in {9, 12}:
        raise DataError(file, field=f"{field}.camera_matrix", expected="9 or 12 numbers", got=str(len(matrix)))
    columns = len(matrix) // 3
    distorted = any(values.get(name) not in (None, []) for name in DISTORTIONS)
    distortion = _list(values, DISTORTIONS, file, field) if distorted else []
    if matrix[1]:
        raise DataError(file, field=field, expected="a pinhole without skew", got=f"skew {matrix[1]}")
    width, height = _size(values, file, field)
    shape: dict[str, Any] = {
        "width": width,
        "height": height,
        "focal": (matrix[0], matrix[columns + 1]),
        "principal_point": (matrix[2], matrix[columns + 2]),
    }
    if not any(distortion):
        return camera_from_parameters("pinhole", **shape)
    if len(distortion) < 4 or any(distortion[5:]):
        hint = "give images without distortion, or another camera model in intrinsics_custom"
        expected, place = "k1, k2, p1, p2 and k3", f"{field}.distortion_coeffs"
        raise DataError(file, field=place, expected=expected, got=f"{len(distortion)} coefficients", hint=hint)
    k1, k2, p1, p2, k3 = (*distortion, 0.0)[:5]
    return camera_from_parameters("brown_conrady", **shape, radial=(k1, k2, k3), tangential=(p1, p2))


def _size(values: Mapping[str, Any], file: Path, field: str) -> tuple[int, int]:
    sizes = []
    for name in ("width_px", "height_px"):
        size = _number(values, (name,), file, field)
        if not size.is_integer():
            raise DataError(file, field=f"{field}.{name}", expected="a whole number", got=str(size))
        sizes.append(int(size))
    return sizes[0], sizes[1]


def _list(values: Mapping[str, Any], names: tuple[str, ...], file: Path, field: str) -> list[float]:
    found = next((values[name] for name in names if values.get(name) is not None), None)
    numbers = [finite_number(item) for item in found] if isinstance(found, list) else []
    finite = [number for number in numbers if number is not None]
    if not numbers or len(finite) < len(numbers):
        raise DataError(file, field=f"{field}.{names[0]}", expected="finite numbers", got=repr(found)[:80])
    return finite


def _number(
    values: Mapping[str, Any], names: tuple[str, ...], file: Path, field: str, *, default: float | None = None
) -> float:
    found = next((values[name] for name in names if values.get(name) is not None), default)
    number = finite_number(found)
    if number is None:
        raise DataError(file, field=f"{field}.{names[0]}", expected="a finite number", got=repr(found)[:80])
    return number


def calibration_head(file: Path) -> dict[str, Any]:
    """`cameras` and, where the file has one lidar, `lidar` of `recording.json`, as JSON values.

    The file's one local system is taken for the vehicle frame: x forward, y left, z up, origin on the ground below the
    middle of the rear axle. Where its origin is elsewhere, the mountings have to be moved by hand.

    Args:
        file: an OpenLABEL file.

    Raises:
        DataError: not OpenLABEL, no camera with a lens, no or several local systems, a camera without a pose.
    """
    content = read_label_file(file)
    vehicle = _vehicle(content, file)
    head: dict[str, Any] = {"cameras": {}}
    for name, stream in content.streams.items():
        field = f"openlabel.streams.{name}"
        if stream.type == "camera":
            lens = read_lens(stream.stream_properties, file, f"{field}.stream_properties")
            if lens is None:
                continue
            parameters = {k: v for k, v in camera_parameters(lens).items() if k not in {"width", "height"}}
            head["cameras"][name] = {
                "model": parameters,
                "image_size": (lens.width, lens.height),
                "vehicle_from_camera": _mounting(name, vehicle, content, file),
            }
            validated(CameraHead, head["cameras"][name], file=file, field=field)
        elif stream.type == "lidar" and "lidar" not in head:
            head["lidar"] = {"vehicle_from_lidar": _mounting(name, vehicle, content, file)}
            validated(LidarHead, head["lidar"], file=file, field=field)
    if not head["cameras"]:
        expected = "a stream of type camera with intrinsics_fisheye, intrinsics_pinhole or intrinsics_custom"
        raise DataError(file, field="openlabel.streams", expected=expected, got=", ".join(content.streams) or "none")
    return head


def calibration_text(file: Path) -> str:
    """The same as text."""
    return json.dumps(calibration_head(file), indent=1, allow_nan=False) + "\n"


def _vehicle(content: Root, file: Path) -> str:
    local = [name for name, system in content.coordinate_systems.items() if system.type in {"local_cs", "local"}]
    if len(local) != 1:
        field = "openlabel.coordinate_systems"
        raise DataError(file, field=field, expected="one local_cs, the vehicle", got=", ".join(local) or "none")
    return local[0]


def _mounting(name: str, vehicle: str, content: Root, file: Path) -> dict[str, Any]:
    vehicle_from_sensor = chain(name, vehicle, constant_poses(content, file))
    if vehicle_from_sensor is None:
        field = f"openlabel.coordinate_systems.{name}"
        raise DataError(file, field=field, expected=f"poses that lead to {vehicle!r}", got="none")
    return Mounting.of(vehicle_from_sensor).model_dump()
