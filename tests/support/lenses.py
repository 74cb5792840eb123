"""One lens per model, and the real ones where they are at hand."""

import json
from collections.abc import Iterator

import cv2
import numpy as np

from bench.adapters.kitti360 import Kitti360Options, read_rig
from bench.adapters.woodscape import Intrinsic
from bench.cameras.angular import KannalaBrandtCamera, OcamCamera, RadialPolynomialCamera
from bench.cameras.model import CameraModel
from bench.cameras.pinhole import PinholeCamera
from bench.cameras.spheres import BrownConradyCamera, DoubleSphereCamera, ExtendedUnifiedCamera, UnifiedCamera
from tests.support.real import REAL

LENSES: dict[str, CameraModel] = {
    "radial_polynomial": RadialPolynomialCamera(
        width=640,
        height=480,
        coefficients=(170.0, -16.0, 24.0, -3.6),
        principal_point=(321.5, 237.9),
        aspect_ratio=1.02,
    ),
    "kannala_brandt": KannalaBrandtCamera(
        width=960,
        height=640,
        focal=(302.0, 320.0),
        principal_point=(496.6, 331.2),
        coefficients=(-0.0437, 0.0217, -0.0264, 0.0084),
    ),
    "unified": UnifiedCamera(
        width=1400,
        height=1400,
        xi=2.2134,
        focal=(1336.3, 1335.8),
        principal_point=(716.9, 705.8),
        radial=(0.0168, 1.6549),
        tangential=(4.2e-4, 4.2e-4),
    ),
    "brown_conrady": BrownConradyCamera(
        width=640,
        height=480,
        focal=(330.0, 332.0),
        principal_point=(325.5, 236.0),
        radial=(-0.28, 0.09, -0.013),
        tangential=(1.1e-3, -6e-4),
    ),
    "pinhole": PinholeCamera(width=640, height=480, focal=(400.0, 410.0), principal_point=(319.5, 239.5)),
    "double_sphere": DoubleSphereCamera(
        width=512, height=512, focal=(158.0, 157.8), principal_point=(254.9, 256.7), xi=-0.172, alpha=0.593
    ),
    "extended_unified": ExtendedUnifiedCamera(
        width=752, height=480, focal=(460.8, 459.4), principal_point=(371.6, 240.1), alpha=0.592, beta=1.13
    ),
    "ocam": OcamCamera(
        width=1280,
        height=800,
        principal_point=(643.2, 401.4),
        coefficients=(-347.0, 0.0, 9.5e-4, -2.1e-7, 6.3e-10),
        stretch=(1.0, -2.1e-4, 3.4e-4, 0.9987),
    ),
}


def real_woodscape() -> list[RadialPolynomialCamera]:
    files = sorted((REAL / "woodscape" / "calibration").glob("*.json"))
    return [Intrinsic(**json.loads(f.read_text())["intrinsic"]).lens(None) for f in files]


def real_kannala_brandt() -> Iterator[tuple[KannalaBrandtCamera, np.ndarray, np.ndarray]]:
    for file in sorted((REAL / "surround_view_kb" / "yaml").glob("*.yaml")):
        storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_READ)
        matrix, terms = storage.getNode("camera_matrix").mat(), storage.getNode("dist_coeffs").mat().ravel()
        width, height = storage.getNode("resolution").mat().ravel()
        camera = KannalaBrandtCamera(
            width=int(width),
            height=int(height),
            focal=(matrix[0, 0], matrix[1, 1]),
            principal_point=(matrix[0, 2], matrix[1, 2]),
            coefficients=terms,
        )
        yield camera, matrix, terms


def real_unified() -> list[CameraModel]:
    _, _, cameras = read_rig(REAL / "kitti360", ("image_02", "image_03"), Kitti360Options())
    return [camera.model for camera in cameras.values()]
