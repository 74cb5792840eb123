"""The paper's segmentation, from two images to a mask of the current one; and each two-view constraint alone."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from bench.cameras.model import ray_grid
from bench.flow.dense import cell_mean, dense_flow
from bench.geometry import Bools, RigidTransform
from bench.methods.contract import FlowMethod, MethodInput
from bench.methods.rigid_scene.motion import Correspondences, MotionAccuracy, refine_motion
from bench.methods.rigid_scene.scene import RigidScene, guided_flow
from bench.methods.settings import Positive
from bench.methods.spherical.likelihood import (
    ALONE,
    PAPER_ANGLE_RAD,
    PAPER_WEIGHTS,
    ConstraintWeights,
    LikelihoodMap,
    SphericalSettings,
)
from bench.methods.two_views import cell_flow, extra_motion, flow_rays
from bench.records.segmentation import Segmentation

FLOW_SIGMA_PX = 0.3  # accuracy of Farnebäck's flow on a cell, for the refined motion


@dataclass(frozen=True, kw_only=True)
class SphericalMethod(SphericalSettings, FlowMethod):
    """The paper's method: dense flow on cells, deviations on the sphere, weighted mean, threshold.

    Attributes:
        flow: name of the dense flow, see `bench.flow.DENSE_FLOWS`; it is averaged on the cells.
        flow_parameters: what the flow takes.
        first_guess: the flow starts from the motion of road and horizon, see `bench.methods.rigid_scene.scene`;
            not in the paper.
        refine_motion: the recorded motion is corrected by the flow, see `bench.methods.rigid_scene.motion`; not in
            the paper.

    Source:
        Mariotti and Eising, section III; constants of section III-H and IV.
    """

    name = "spherical"
    blind_at_epipole = True

    flow: str = "farneback"
    flow_parameters: dict[str, object] = field(default_factory=dict)
    first_guess: bool = False
    refine_motion: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        dense_flow(self.flow, **self.flow_parameters)

    def segment(self, frame: MethodInput) -> Segmentation:
        """Segment the last image of the pair; see `bench.methods.contract`."""
        return self.segment_flow(frame, self.mean_flow(frame))

    def segment_flow(self, frame: MethodInput, flow: NDArray[np.float32]) -> Segmentation:
        """Segment the current image with the flow of others in place of its own."""
        return self.segmentation(self.likelihood_map(frame, flow), flow)

    def flow_cell_px(self, width: int) -> int:  # noqa: ARG002 - the same for every image
        """Side of the cells on which it takes flow, px, for images of this width."""
        return self.cell_size_px

    def mean_flow(self, frame: MethodInput) -> NDArray[np.float32]:
        """Flow from the current to the previous image, (rows, columns, 2) float32, px, mean over each cell."""
        if not self.first_guess:
            return cell_flow(frame, self.flow, self.flow_parameters, self.cell_size_px)
        scene, flow = RigidScene.of(frame), dense_flow(self.flow, **self.flow_parameters)
        guided = guided_flow(frame.images[-1], frame.images[-2], valid=frame.valid, scene=scene, flow=flow)
        return cell_mean(guided.flow, self.cell_size_px)

    def _refined(
        self, frame: MethodInput, flow: NDArray[np.float32], *, seen: Bools, motion: RigidTransform
    ) -> RigidScene:
        """Motion and road, corrected by the flow of every second cell."""
        cells, every = ray_grid(frame.camera, self.cell_size_px), (slice(None, None, 2),) * 2
        used = seen[every]
        given = Correspondences(
            rays=cells.rays_camera[every][used],
            pixels=(cells.pixels + flow)[every][used],
            information=np.tile(np.eye(2) / FLOW_SIGMA_PX**2, (int(used.sum()), 1, 1)),
        )
        seconds = (frame.timestamps_ns[-1] - frame.timestamps_ns[-2]) / 1e9
        scene = replace(RigidScene.of(frame), current_from_previous=motion)
        return refine_motion(scene, given, seconds=seconds, accuracy=MotionAccuracy())

    def motion(self, frame: MethodInput) -> RigidTransform | None:
        """Motion of the camera, current_from_previous; None where it is not known and so nothing can be said."""
        return frame.current_from_previous[-1]

    def likelihood_map(self, frame: MethodInput, flow: NDArray[np.float32]) -> LikelihoodMap:
        """Likelihood of motion of each cell, (rows, columns); thresholds have no part in it.

        Args:
            frame: its images are not looked at, unless the motion is found in them.
            flow: from `mean_flow`.
        """
        cells = ray_grid(frame.camera, self.cell_size_px)
        rays_previous, seen = flow_rays(frame, cells, flow)
        motion, road = self.motion(frame), frame.road
        if motion is None:
            motion, seen = RigidTransform.identity(), np.zeros_like(seen)
        if self.refine_motion:
            refined = self._refined(frame, flow, seen=seen, motion=motion)
            motion, road = refined.current_from_previous, refined.road
        return self.likelihood_of_rays(
            rays_previous,
            cells.rays_camera,
            seen=seen,
            current_from_previous=motion,
            road=road,
            extra_motion=extra_motion(frame, cells.pixels, cells.pixels + flow),
        )


# Larger than OpenCV's usual, so that noise of the flow on a cell is smaller; what is left of the flow is small enough.
_SMOOTH: dict[str, object] = {"window_px": 21, "neighbourhood_px": 7, "neighbourhood_sigma": 1.5}


@dataclass(frozen=True, kw_only=True)
class GuidedSphericalMethod(SphericalMethod):
    """The paper's constraints on a flow that holds the road, by the motion that this flow corrects."""

    name = "spherical-guided"

    flow_parameters: dict[str, object] = field(default_factory=_SMOOTH.copy)
    first_guess: bool = True
    refine_motion: bool = True


# Each two-view constraint alone: what the method sees by it and by nothing else. Flow, cells and the stationary camera
# are as in the method. A constraint's threshold is the one that it has among the others (see `ALONE`), so these masks
# are parts of the method's mask.


@dataclass(frozen=True, kw_only=True)
class EpipolarOnly(SphericalMethod):
    """The epipolar constraint alone; scale-free, blind to motion along the ego vehicle's own."""

    name = "epipolar-only"
    weights: ConstraintWeights = ALONE["epipolar"]
    threshold: Positive = PAPER_ANGLE_RAD / PAPER_WEIGHTS.epipolar


@dataclass(frozen=True, kw_only=True)
class PositiveDepthOnly(SphericalMethod):
    """The positive depth constraint alone; scale-free, sees what is faster than the ego vehicle."""

    name = "positive-depth-only"
    weights: ConstraintWeights = ALONE["positive_depth"]
    threshold: Positive = PAPER_ANGLE_RAD / PAPER_WEIGHTS.positive_depth


@dataclass(frozen=True, kw_only=True)
class PositiveHeightOnly(SphericalMethod):
    """The positive height constraint alone; needs scale, sees what would lie below the road."""

    name = "positive-height-only"
    weights: ConstraintWeights = ALONE["positive_height"]
    threshold: Positive = PAPER_ANGLE_RAD / PAPER_WEIGHTS.positive_height


@dataclass(frozen=True, kw_only=True)
class AntiParallelOnly(SphericalMethod):
    """The anti-parallel constraint alone; needs scale, sees what comes nearer than the road behind it allows."""

    name = "anti-parallel-only"
    weights: ConstraintWeights = ALONE["anti_parallel"]
    threshold: Positive = PAPER_ANGLE_RAD / PAPER_WEIGHTS.anti_parallel
