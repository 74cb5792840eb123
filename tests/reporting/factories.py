"""Synthetic frames to draw: a textured fisheye disc with a few objects, and flow and deviations to match."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, box

from bench.records.reference import Category, IgnoreReason, ObjectGeometry, ReferenceFrame, ReferenceObject, Status
from bench.records.segmentation import Segmentation
from tests.evaluation import frames
from tests.support.tiny import OUTLINE_M

CELL_PX = 5


def fisheye_image(width: int = 640, height: int = 480) -> NDArray[np.uint8]:
    noise = np.random.default_rng(1).integers(0, 255, (height // 8, width // 8)).astype(np.uint8)
    image = cv2.GaussianBlur(cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC), (0, 0), 3)
    shade = np.linspace(1.0, 0.5, height)[:, None]
    image = np.clip(60 + 0.5 * image * shade, 0, 255).astype(np.uint8)
    image[~field_of_view(width, height)] = 0
    return image


def field_of_view(width: int = 640, height: int = 480) -> NDArray[np.bool_]:
    v, u = np.mgrid[:height, :width]
    return np.hypot(u - width / 2, v - height / 2) < 0.58 * width


def reference_object(
    track_id: str, polygon: Polygon, *, status: Status = Status.EVALUATED, **changes: object
) -> ReferenceObject:
    reason = IgnoreReason.RANGE if status is Status.IGNORED else None
    return frames.reference_object(track_id, polygon=polygon, status=status, reason=reason, **changes)


def reference_frame(objects: list[ReferenceObject], *, width: int = 640, height: int = 480) -> ReferenceFrame:
    labels = np.zeros((height, width), dtype=np.int32)
    ignored = np.zeros((height, width), dtype=np.uint8)
    valid = field_of_view(width, height)
    for index in reversed(range(len(objects))):
        target = objects[index]
        assert target.polygon is not None
        corners = np.round(np.asarray(target.polygon.exterior.coords)).astype(np.int32)
        if target.status is Status.EVALUATED:
            cv2.fillPoly(labels, [corners], index + 1)
        elif target.status is Status.IGNORED:
            cv2.fillPoly(ignored, [corners], 1)
    labels[~valid] = 0
    ignored = (ignored > 0) & (labels == 0) & valid
    return frames.reference_frame(labels, objects=objects, ignored=ignored, valid=valid, recording="demo")


def busy_frame() -> ReferenceFrame:
    return reference_frame(
        [
            reference_object("pedestrian-1", Polygon([(150, 180), (185, 170), (200, 230), (190, 330), (150, 335)])),
            reference_object("pedestrian-2", Polygon([(190, 185), (215, 180), (225, 320), (195, 325)])),
            reference_object("car-7", box(420, 200, 590, 320), category=Category.OVERTAKING),
            reference_object("car-8", box(330, 215, 360, 240), category=Category.PRECEDING),
            reference_object("van-3", box(255, 190, 315, 240), status=Status.IGNORED),
        ]
    )


def banded_frame() -> ReferenceFrame:
    """A core of 10 x 10 px in a band 2 px wide, and far away an ignored object."""
    objects = [
        replace(reference_object("a", box(300, 200, 309, 209)), unknown_px=14 * 14 - 10 * 10),
        reference_object("b", box(330, 200, 339, 209), status=Status.IGNORED),
    ]
    frame = reference_frame(objects)
    unknown = np.zeros_like(frame.ignored)
    unknown[198:212, 298:312] = frame.labels[198:212, 298:312] == 0
    return replace(frame, ignored=frame.ignored | unknown, unknown=unknown)


def segmentation(reference: ReferenceFrame, *, parts: bool = True) -> Segmentation:
    """Of a drive ahead: flow to the image before points up below the horizon; moving cells deviate, and some others."""
    height, width = reference.labels.shape
    v, u = np.mgrid[2:height:CELL_PX, 2:width:CELL_PX].astype(np.float32)
    objects = reference.labels[2::CELL_PX, 2::CELL_PX] > 0
    wrong = (u - 80) ** 2 + (v - 350) ** 2 < 50**2
    shares = {"epipolar": 0.5, "positive_depth": 0.3, "positive_height": 0.1, "anti_parallel": 0.1}
    likelihood = 0.02 * (objects | wrong)
    named = {"flow_u": 0.05 * (330 - u), "flow_v": 0.1 * (220 - v)}
    named |= {name: share * likelihood for name, share in shares.items()}
    return Segmentation(
        cell_size_px=CELL_PX,
        mask=likelihood > 1e-3,
        likelihood=likelihood.astype(np.float32),
        undefined=np.hypot(u - 330, v - 220) < 12,
        parts={name: values.astype(np.float32) for name, values in named.items()} if parts else None,
    )


def cluster() -> dict[str, Any]:
    """What `draw_cluster` takes: the side and the back of a car on the left, in rings on the ground."""
    random = np.random.default_rng(3)
    azimuth, radius = np.tile(np.linspace(-np.pi, np.pi, 90), 20), np.repeat(np.geomspace(3.5, 25, 20), 90)
    ground = np.column_stack([radius * np.cos(azimuth) + 1.4, radius * np.sin(azimuth), np.zeros(azimuth.size)])
    car = random.uniform((4.0, 2.1, 0.2), (8.3, 3.9, 1.5), (420, 3))
    car[:300, 1], car[300:, 0] = 2.1, 4.0
    pixels = np.column_stack([330 - 180 * car[:, 1] / car[:, 0], 250 - 60 * (car[:, 2] - 0.7)])
    return {
        "geometry": ObjectGeometry(
            surroundings_vehicle=np.concatenate([ground, car]),
            cluster_vehicle=car,
            outline_m=np.array([[4.0, 2.1], [8.4, 2.1], [8.4, 3.9], [4.0, 3.9]]),
            pixels=pixels,
        ),
        "image": fisheye_image(),
        "polygon": box(*pixels.min(axis=0), *pixels.max(axis=0)),
        "vehicle_outline_m": OUTLINE_M,
        "title": "fisheye image, front, car-7",
        "image_name": "demo, camera front, 1.20 s",
    }
