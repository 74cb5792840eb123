"""Camera models by name, and cameras as they are stored: a name and parameters."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from bench.cameras.angular import KannalaBrandtCamera, OcamCamera, RadialPolynomialCamera
from bench.cameras.model import CameraModel
from bench.cameras.pinhole import PinholeCamera
from bench.cameras.spheres import BrownConradyCamera, DoubleSphereCamera, ExtendedUnifiedCamera, UnifiedCamera
from bench.errors import ShapeError, UnknownNameError

CAMERA_MODELS: dict[str, type[CameraModel]] = {
    "radial_polynomial": RadialPolynomialCamera,
    "kannala_brandt": KannalaBrandtCamera,
    "unified": UnifiedCamera,
    "brown_conrady": BrownConradyCamera,
    "pinhole": PinholeCamera,
    "double_sphere": DoubleSphereCamera,
    "extended_unified": ExtendedUnifiedCamera,
    "ocam": OcamCamera,
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
    name = OTHER_NAMES.get(model.lower(), model.lower())
    if name not in CAMERA_MODELS:
        raise UnknownNameError("camera model", name, CAMERA_MODELS)
    try:
        return CAMERA_MODELS[name](width=width, height=height, **parameters)
    except TypeError as error:
        known = ", ".join(f.name for f in fields(CAMERA_MODELS[name]) if f.init)
        given = ", ".join(("width", "height", *parameters))
        raise ShapeError(f"camera model {model!r}: expected the parameters {known}, got {given}") from error


def camera_parameters(camera: CameraModel) -> dict[str, Any]:
    """The stored form of a camera: `camera_from_parameters(**camera_parameters(camera)) == camera`."""
    name = next((name for name, model in CAMERA_MODELS.items() if type(camera) is model), type(camera).__name__)
    return {"model": name} | {f.name: getattr(camera, f.name) for f in fields(camera) if f.init}
