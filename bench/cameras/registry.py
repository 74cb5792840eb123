"""Camera models by name, as recordings store them."""

from __future__ import annotations

from dataclasses import fields
from importlib import import_module
from typing import Any

from bench.cameras.model import CameraModel
from bench.errors import ShapeError, UnknownNameError

CAMERA_MODELS = {
    "radial_polynomial": "bench.cameras.angular:RadialPolynomialCamera",
    "kannala_brandt": "bench.cameras.angular:KannalaBrandtCamera",
    "unified": "bench.cameras.unified:UnifiedCamera",
    "brown_conrady": "bench.cameras.brown:BrownConradyCamera",
    "pinhole": "bench.cameras.pinhole:PinholeCamera",
    "double_sphere": "bench.cameras.spheres:DoubleSphereCamera",
    "extended_unified": "bench.cameras.spheres:ExtendedUnifiedCamera",
    "ocam": "bench.cameras.ocam:OcamCamera",
}
OTHER_NAMES = {  # of ROS, Kalibr, OpenCV and others
    **dict.fromkeys(("equidistant", "equidist", "fisheye", "opencv_fisheye", "kb4", "kb8"), "kannala_brandt"),
    **dict.fromkeys(("mei", "omni", "cmei", "ucm"), "unified"),
    **dict.fromkeys(("plumb_bob", "radtan", "opencv", "opencv_pinhole", "brown"), "brown_conrady"),
    **dict.fromkeys(("ds", "doublesphere"), "double_sphere"),
    **dict.fromkeys(("eucm", "extended_unified_camera"), "extended_unified"),
    **dict.fromkeys(("scaramuzza", "ocamcalib", "omnidirectional"), "ocam"),
}


def camera_from_parameters(model: str, *, width: int, height: int, **parameters: Any) -> CameraModel:
    """Build a camera from its stored form.

    Args:
        model: a name of `CAMERA_MODELS` or `OTHER_NAMES`, in any case.
        width: image width, px.
        height: image height, px.
        parameters: the model's own fields.

    Raises:
        UnknownNameError: no such model.
        ShapeError: parameters that are missing, unknown or out of their domain.
    """
    cls = _model_class(OTHER_NAMES.get(model.lower(), model.lower()))
    try:
        return cls(width=width, height=height, **parameters)
    except TypeError as error:
        known = ", ".join(f.name for f in fields(cls) if f.init)
        given = ", ".join(("width", "height", *parameters))
        raise ShapeError(f"camera model {model!r}: expected the parameters {known}, got {given}") from error


def camera_parameters(camera: CameraModel) -> dict[str, Any]:
    """The stored form of a camera: `camera_from_parameters(**camera_parameters(camera)) == camera`."""
    name = next((n for n in CAMERA_MODELS if type(camera) is _model_class(n)), type(camera).__name__)
    return {"model": name} | {f.name: getattr(camera, f.name) for f in fields(camera) if f.init}


def _model_class(model: str) -> type[CameraModel]:
    if model not in CAMERA_MODELS:
        raise UnknownNameError("camera model", model, CAMERA_MODELS)
    module, name = CAMERA_MODELS[model].split(":")
    found: type[CameraModel] = getattr(import_module(module), name)
    return found
