"""Cameras evaluated at another size than their images are stored at."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from bench.recordings.records import MountedCamera


def scaled_camera(camera: MountedCamera, size_px: tuple[int, int] | None) -> MountedCamera:
    """The same camera evaluated at another size; the images on disk stay as they are.

    Args:
        camera: at any size.
        size_px: (width, height); None to change nothing.
    """
    if size_px is None or tuple(size_px) == (camera.model.width, camera.model.height):
        return camera
    body = camera.ego_body
    if body is not None:
        body = cv2.resize(body.astype(np.uint8), tuple(size_px), interpolation=cv2.INTER_NEAREST).astype(bool)
    return replace(camera, model=camera.model.scaled(*size_px), ego_body=body)
