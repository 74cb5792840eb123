"""Lenses in the streams of an OpenLABEL file <-> camera models.

`intrinsics_custom` with the fields of our camera models says everything and goes first. `intrinsics_fisheye` is read in
the schema's spelling (lens_coeffs, center_x_px, center_y_px) and in the library's (lens_coeffs_1x4, lens_coeffs_1xN,
center_x, center_y). What its coefficients mean depends on the rest:

- four without a focal length, or the model "radial_poly": r = k1 t + k2 t^2 + k3 t^3 + k4 t^4, px, t in radians;
- four with a focal length, or the model "opencv_fisheye": r = f (t + k1 t^3 + k2 t^5 + k3 t^7 + k4 t^9);
- five, or the model "kannala": r = f (k1 t + k2 t^3 + k3 t^5 + k4 t^7 + k5 t^9), f = 1 without a focal length.

`intrinsics_pinhole` is read without distortion. Files do not say where a pixel has its centre: (0, 0) is taken for the
centre of the first one, as everywhere here.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bench.cameras import CameraModel, camera_from_parameters, camera_parameters
from bench.cameras.kannala_brandt import KannalaBrandtCamera
from bench.cameras.pinhole import PinholeCamera
from bench.cameras.radial_polynomial import RadialPolynomialCamera
from bench.errors import DataError, ShapeError, UnknownNameError
from bench.layers.openlabel_file import StreamProperties
from bench.layers.tool_model import finite_number
from bench.recordings.validation import data_error

COEFFICIENTS = ("lens_coeffs", "lens_coeffs_1x4", "lens_coeffs_1xN")
CENTRES = (("center_x_px", "center_x"), ("center_y_px", "center_y"))
MODELS = ("model", "fisheye_model")
MATRICES, DISTORTIONS = ("camera_matrix", "camera_matrix_3x4"), ("distortion_coeffs", "distortion_coeffs_1xN")
SCHEMA_COEFFICIENTS = 4
NO_DISTORTION = [0.0] * 5


def read_lens(properties: StreamProperties, file: Path, field: str) -> CameraModel | None:
    """The lens of a stream; None where the file tells none.

    Raises:
        DataError: numbers that are missing or make no lens, a lens that no camera model here can hold.
    """
    try:
        if properties.intrinsics_custom is not None and "model" in properties.intrinsics_custom:
            return _custom(properties.intrinsics_custom, file, f"{field}.intrinsics_custom")
        if properties.intrinsics_fisheye is not None:
            return _fisheye(properties.intrinsics_fisheye, file, f"{field}.intrinsics_fisheye")
        if properties.intrinsics_pinhole is not None:
            return _pinhole(properties.intrinsics_pinhole, file, f"{field}.intrinsics_pinhole")
    except ShapeError as error:
        raise data_error(error, file=file, field=field) from error
    return None


def lens_properties(camera: CameraModel) -> dict[str, Any]:
    """`stream_properties` of a camera: the schema's names where it has any for the lens, and all of it as ours."""
    parameters = camera_parameters(camera)
    size = {"width_px": camera.width, "height_px": camera.height}
    u, v = camera.principal_point
    centre = {"center_x_px": u, "center_y_px": v}
    properties: dict[str, Any] = {}
    if isinstance(camera, PinholeCamera):
        fx, fy = camera.focal
        matrix = [fx, 0.0, u, 0.0, 0.0, fy, v, 0.0, 0.0, 0.0, 1.0, 0.0]
        properties["intrinsics_pinhole"] = {**size, "camera_matrix": matrix, "distortion_coeffs": NO_DISTORTION}
    elif isinstance(camera, RadialPolynomialCamera) and len(camera.coefficients) <= SCHEMA_COEFFICIENTS:
        properties["intrinsics_fisheye"] = {
            **size,
            **centre,
            "model": "radial_poly",
            "aspect_ratio": camera.aspect_ratio,
            "lens_coeffs": _padded(camera.coefficients),
        }
    elif isinstance(camera, KannalaBrandtCamera) and len(camera.coefficients) <= SCHEMA_COEFFICIENTS:
        properties["intrinsics_fisheye"] = {
            **size,
            **centre,
            "model": "opencv_fisheye",
            "focal_length_x": camera.focal[0],
            "focal_length_y": camera.focal[1],
            "lens_coeffs": _padded(camera.coefficients),
        }
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
        do = "some files have the distance from the middle of the image here: add (width - 1) / 2, (height - 1) / 2"
        expected = f"a centre in the image of {width} x {height} px"
        raise DataError(file, field=f"{field}.center_x_px, center_y_px", expected=expected, got=f"{u}, {v}", do=do)
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
    told = any(values.get(name) not in (None, []) for name in DISTORTIONS)
    distortion = _list(values, DISTORTIONS, file, field) if told else []
    if any(distortion) or matrix[1]:
        expected = "a pinhole without distortion or skew"
        do = "give images without distortion, or another camera model in intrinsics_custom"
        raise DataError(file, field=field, expected=expected, got=f"{distortion}, skew {matrix[1]}", do=do)
    width, height = _size(values, file, field)
    return camera_from_parameters(
        "pinhole",
        width=width,
        height=height,
        focal=(matrix[0], matrix[columns + 1]),
        principal_point=(matrix[2], matrix[columns + 2]),
    )


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
    told = [number for number in numbers if number is not None]
    if not numbers or len(told) < len(numbers):
        raise DataError(file, field=f"{field}.{names[0]}", expected="finite numbers", got=repr(found)[:80])
    return told


def _number(
    values: Mapping[str, Any], names: tuple[str, ...], file: Path, field: str, *, default: float | None = None
) -> float:
    found = next((values[name] for name in names if values.get(name) is not None), default)
    number = finite_number(found)
    if number is None:
        raise DataError(file, field=f"{field}.{names[0]}", expected="a finite number", got=repr(found)[:80])
    return number


def _padded(coefficients: tuple[float, ...]) -> list[float]:
    return [*coefficients, *[0.0] * (SCHEMA_COEFFICIENTS - len(coefficients))]
