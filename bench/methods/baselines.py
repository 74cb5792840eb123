"""Baselines that every table should carry: what the constraints must beat, and the ends of the scale.

None has a parameter that was tuned on our data; each class says where its threshold comes from.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated

import cv2
import numpy as np
from pydantic import Field

from bench.cameras.model import ray_grid
from bench.flow.dense import dense_flow
from bench.geometry import Floats, angle_between
from bench.methods.contract import Method, MethodInput
from bench.methods.spherical.likelihood import PAPER_ANGLE_RAD
from bench.methods.two_views import cell_flow, flow_parts, flow_rays
from bench.records.segmentation import Segmentation

GREY_LEVELS = 255
MOG2_FOREGROUND = 255  # other values are background, and 127 for shadows


class Nothing(Method):
    """Nothing moves: detection rate 0, false positives 0."""

    name = "nothing"

    def segment(self, frame: MethodInput) -> Segmentation:
        """An empty mask."""
        return Segmentation(cell_size_px=1, mask=np.zeros(frame.valid.shape, dtype=bool))


class Everything(Method):
    """Everything moves: detection rate 1, coverage 1, and false positives over the rest."""

    name = "everything"

    def segment(self, frame: MethodInput) -> Segmentation:
        """A full mask."""
        return Segmentation(cell_size_px=1, mask=np.ones(frame.valid.shape, dtype=bool))


@dataclass(frozen=True, kw_only=True)
class FrameDifference(Method):
    """Marks pixels whose grey value differs from the one in the image before.

    Attributes:
        threshold_grey: difference above which a pixel moves, grey levels of 255. The default is what
            `background-subtraction` begins with: four standard deviations of a grey value of variance 15, which OpenCV
            takes for a new background.

    Source:
        Jain and Nagel, On the analysis of accumulative difference pictures, 1979.
    """

    name = "frame-difference"

    threshold_grey: Annotated[float, Field(ge=0, lt=GREY_LEVELS)] = 4 * 15**0.5

    def segment(self, frame: MethodInput) -> Segmentation:
        """Compare the last image with the one before it."""
        difference = np.where(frame.valid, cv2.absdiff(frame.images[-1], frame.images[-2]), 0)
        return Segmentation(
            cell_size_px=1,
            mask=difference > self.threshold_grey,
            likelihood=difference.astype(np.float32) / np.float32(GREY_LEVELS),
            likelihood_is_score=True,
            threshold=self.threshold_grey / GREY_LEVELS,
        )


@dataclass(frozen=True, kw_only=True)
class BackgroundSubtraction(Method):
    """Marks pixels that the grey values of the last second do not explain: MOG2 of OpenCV.

    The model is learnt anew for every image, from the images before it, oldest first; so an image's mask depends
    neither on where a drive was cut into pieces nor on what was segmented before. It has no likelihood, since OpenCV
    gives none. Every other parameter is OpenCV's own. It is made for a stationary camera.

    Attributes:
        images: images before the current one that the model learns from, fewer where there are fewer; 15 are one
            second at 15 frames per second. Time grows with their number.
        deviations: a pixel is background within so many standard deviations.
        shadows: whether what is recognised as a shadow is background.

    Source:
        Zivkovic 2004; Zivkovic and van der Heijden 2006.
    """

    name = "background-subtraction"

    images: Annotated[int, Field(ge=1, le=500)] = 15
    deviations: Annotated[float, Field(gt=0, le=1000)] = 4.0
    shadows: bool = True

    @property
    def longest_history(self) -> int:  # type: ignore[override]
        """Earlier images that it can use."""
        return self.images

    def segment(self, frame: MethodInput) -> Segmentation:
        """Learn from the earlier images, then segment the last one."""
        *earlier, current = frame.images[-self.images - 1 :]
        model = cv2.createBackgroundSubtractorMOG2(
            history=max(self.images, 2), varThreshold=self.deviations**2, detectShadows=self.shadows
        )
        for image in earlier:
            model.apply(image)
        classes = np.asarray(model.apply(current, learningRate=0))
        return Segmentation(cell_size_px=1, mask=(classes == MOG2_FOREGROUND) & frame.valid)


@dataclass(frozen=True, kw_only=True)
class FlowMagnitude(Method):
    """Marks what moves in the image: the angle between a cell's rays now and before.

    An angle and not a length in pixels, so that it means the same all over the lens. The flow and the cells are those
    of the paper's method, and so is the threshold: the angle at which that sees motion by its epipolar or its positive
    depth constraint alone. Neither ego-motion nor scene has a part in it.

    Attributes:
        flow: name of the dense flow, see `bench.flow.DENSE_FLOWS`.
        flow_parameters: what the flow takes.
        cell_size_px: side of the cells on which the flow is averaged.
        threshold: angle above which a cell moves, rad between two images.
    """

    name = "flow-magnitude"

    flow: str = "farneback"
    flow_parameters: dict[str, object] = field(default_factory=dict)
    cell_size_px: Annotated[int, Field(ge=1)] = 5
    threshold: Annotated[float, Field(gt=0, le=math.pi)] = PAPER_ANGLE_RAD

    def __post_init__(self) -> None:
        dense_flow(self.flow, **self.flow_parameters)

    def compensated(self, rays_previous: Floats, frame: MethodInput) -> Floats:  # noqa: ARG002
        """Previous rays as they are compared with current ones; here as they are."""
        return rays_previous

    def segment(self, frame: MethodInput) -> Segmentation:
        """Segment the last image of the pair; see `bench.methods.contract`."""
        flow = cell_flow(frame, self.flow, self.flow_parameters, self.cell_size_px)
        cells = ray_grid(frame.camera, self.cell_size_px)
        rays_previous, seen = flow_rays(frame, cells, flow)
        angles_rad = np.where(seen, angle_between(self.compensated(rays_previous, frame), cells.rays_camera), 0.0)
        return Segmentation(
            cell_size_px=self.cell_size_px,
            mask=angles_rad > self.threshold,
            likelihood=angles_rad.astype(np.float32),
            undefined=~seen,
            parts=flow_parts(flow),
            threshold=self.threshold,
        )


@dataclass(frozen=True, kw_only=True)
class RotationCompensatedFlow(FlowMagnitude):
    """Marks what moves in the image beside the camera's rotation: the angle between p' and q = R p.

    Of the ego-motion only the rotation is used. For a camera that only rotates it is exact; for one that translates,
    everything near moves.
    """

    name = "rotation-compensated-flow"

    def compensated(self, rays_previous: Floats, frame: MethodInput) -> Floats:
        """Previous rays, rotated into the current frame."""
        return frame.current_from_previous[-1].rotate(rays_previous)
