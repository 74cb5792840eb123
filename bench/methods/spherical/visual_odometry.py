"""The paper's method where ego-motion is missing or bad: motion from the images themselves."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from bench.egomotion import VisualOdometry
from bench.errors import UsageError
from bench.flow import LucasKanadeTracker
from bench.geometry import RigidTransform
from bench.methods.contract import MethodInput
from bench.methods.spherical.likelihood import PAPER_ANGLE_RAD, PAPER_WEIGHTS, ConstraintWeights, LikelihoodMap
from bench.methods.spherical.method import SphericalMethod

Scale = Literal["none", "given"]
NEED_SCALE = ("positive_height", "anti_parallel")
SCALE_FREE = ConstraintWeights(positive_height=0.0, anti_parallel=0.0)


@dataclass(frozen=True, kw_only=True)
class VisualOdometryMethod(SphericalMethod):
    """The paper's method with visual odometry: rotation and direction of translation from tracks of the same images.

    Two views of one camera do not show how far it moved. Without a scale only the epipolar and the positive depth
    constraint run, and a weight on another one is refused; with `scale="given"` the length of the translation, but
    neither its direction nor the rotation, is that of the given ego-motion, and all constraints run with the paper's
    weights. Where the camera is stationary, or only rotates, the images show no direction, and the constraint of a
    stationary camera is used. Where they show nothing, all is undefined, and so static.

    Attributes:
        weights: those not given are the paper's, but 0 on constraints that need a scale where there is none.
        threshold: as in `SphericalSettings`; NaN for the paper's angle by the sum of the weights that the scale allows.
        scale: "none", or "given" for the length of the given ego-motion.
        tracker: finds the tracks.
        odometry: estimates the motion from them.

    Raises:
        UsageError: a weight on a constraint that needs the scale, without one.
    """

    name = "spherical-visual-odometry"

    weights: ConstraintWeights = SCALE_FREE
    threshold: float = math.nan
    scale: Scale = "none"
    tracker: LucasKanadeTracker = field(default_factory=LucasKanadeTracker)
    odometry: VisualOdometry = field(default_factory=VisualOdometry)

    def __post_init__(self) -> None:
        allowed = PAPER_WEIGHTS if self.scale == "given" else SCALE_FREE
        if self.weights is SCALE_FREE:
            object.__setattr__(self, "weights", allowed)
        elif isinstance(self.weights, dict):
            object.__setattr__(self, "weights", replace(allowed, **self.weights))
        if math.isnan(self.threshold):
            object.__setattr__(self, "threshold", PAPER_ANGLE_RAD / allowed.total)
        super().__post_init__()
        if isinstance(self.tracker, dict):
            object.__setattr__(self, "tracker", LucasKanadeTracker(**self.tracker))
        if isinstance(self.odometry, dict):
            object.__setattr__(self, "odometry", VisualOdometry(**self.odometry))
        if self.scale not in get_args(Scale):
            raise UsageError(f"scale: expected {' or '.join(get_args(Scale))}, got {self.scale!r}")
        asked = [name for name in NEED_SCALE if getattr(self.weights, name) > 0]
        if self.scale == "none" and asked:
            raise UsageError(
                f"{self.name}: {' and '.join(asked)} need the length of the translation, which images do not show; "
                f"set {' '.join(f'weights.{name}=0' for name in asked)}, or scale=given for the recording's own"
            )

    def likelihood_map(self, frame: MethodInput, flow: NDArray[np.float32]) -> LikelihoodMap:
        """Likelihood map by ego-motion from images; without scale the deviations that need one are not known."""
        found = super().likelihood_map(frame, flow)
        hidden = NEED_SCALE if self.scale == "none" else ()
        return replace(found, deviations={name: d for name, d in found.deviations.items() if name not in hidden})

    def motion(self, frame: MethodInput) -> RigidTransform | None:
        """Motion of the camera as its images show it; without scale its length is 1, or 0 where it is stationary."""
        tracks = self.tracker((frame.images[-1], frame.images[-2]), valid=frame.valid)
        followed = tracks.followed[1]
        current, _ = frame.camera.unproject(tracks.pixels[0, followed])
        previous, _ = frame.camera.unproject(tracks.pixels[1, followed])
        found = self.odometry(previous, current)
        if found is None:
            return None
        length_m = 1.0
        if self.scale == "given":
            length_m = float(np.linalg.norm(frame.current_from_previous[-1].translation_m))
        return RigidTransform(found.rotation, length_m * found.direction if found.moves else np.zeros(3))
