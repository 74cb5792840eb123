"""The constraints on sparse tracks, three views included; and on dense flow, with ego-motion found from tracks."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bench.cameras.model import RayGrid, ray_grid
from bench.egomotion.visual import VisualOdometry
from bench.errors import UsageError
from bench.flow.tracks import LucasKanadeTracker
from bench.geometry import Bools, Floats, RigidTransform
from bench.methods.contract import Method, MethodInput
from bench.methods.settings import Positive, set_groups
from bench.methods.spherical.constraints import three_view_deviation
from bench.methods.spherical.likelihood import (
    ALONE,
    PAPER_ANGLE_RAD,
    PAPER_WEIGHTS,
    THREE_VIEW,
    ConstraintWeights,
    LikelihoodMap,
    SphericalSettings,
)
from bench.methods.spherical.method import SphericalMethod
from bench.methods.two_views import extra_motion
from bench.records.segmentation import Segmentation

Value = TypeVar("Value", bound=np.generic)

# xi_3v is close to a second difference a - 2b + c of the angles of one point, with 6 times the variance of one angle;
# xi_e and xi_d are first differences, with 2 times. So by this weight tracking noise counts the same in both.
THREE_VIEW_WEIGHT = 3**-0.5
_WEIGHTS = ConstraintWeights(three_view=THREE_VIEW_WEIGHT)


@dataclass(frozen=True, kw_only=True)
class SparseSphericalMethod(SphericalSettings, Method):
    """The paper's constraints on Lucas-Kanade tracks instead of dense flow, with the three-view constraint.

    A track counts for the cells whose centre lies in the window in which it was matched; where windows overlap, the
    nearest track does (by the larger of the distances in u and v). Cells without a track are undefined, and so static.
    The three-view constraint counts where a track reaches back two images; elsewhere, and on an image with only one
    image before it, its deviation is 0.

    The paper gives three views the weight 0. The threshold is the one of the two-view constraints: the sum of
    weighted deviations counts from 6e-4 x 2.4 on, as in the paper's method.

    Attributes:
        tracker: finds and follows corners.

    Source:
        Mariotti and Eising, sections III-F and III-H.
    """

    name = "spherical-sparse"
    longest_history = 2

    weights: ConstraintWeights = _WEIGHTS
    threshold: Positive = PAPER_ANGLE_RAD / _WEIGHTS.total
    tracker: LucasKanadeTracker = field(default_factory=LucasKanadeTracker)

    def __post_init__(self) -> None:
        super().__post_init__()
        set_groups(self, tracker=LucasKanadeTracker())

    def segment(self, frame: MethodInput) -> Segmentation:
        """Segment the last image; see `bench.methods.contract`."""
        tracks = self.tracker(tuple(frame.images[-1 : -self.longest_history - 2 : -1]), valid=frame.valid)
        rays, known = frame.camera.unproject(tracks.pixels.reshape(-1, 2))  # of all tracks in all K images
        rays, known = rays.reshape(*tracks.followed.shape, 3), known.reshape(tracks.followed.shape) & tracks.followed
        cells = ray_grid(frame.camera, self.cell_size_px)
        usable = np.flatnonzero(known[0] & known[1])
        nearest, near = _nearest(tracks.pixels[0, usable], cells, reach_px=self.tracker.reach_px)
        near &= cells.at_centres(frame.valid)
        likelihoods = self.likelihood_of_rays(
            rays[1][usable],
            rays[0][usable],
            seen=np.ones(len(usable), dtype=bool),
            current_from_previous=frame.current_from_previous[-1],
            road=frame.road,
            three_view=self._three_view(frame, rays[:, usable]),
            extra_motion=extra_motion(frame, tracks.pixels[0, usable], tracks.pixels[1, usable]),
        )
        flow = (tracks.pixels[1, usable] - tracks.pixels[0, usable]).astype(np.float32)

        def on_cells(values: NDArray[Value]) -> NDArray[Value]:
            spread = np.zeros(nearest.shape + values.shape[1:], dtype=values.dtype)
            spread[near] = values[nearest[near]]
            return spread

        deviations = {name: on_cells(deviation) for name, deviation in likelihoods.deviations.items()}
        of_cells = {name: on_cells(getattr(likelihoods, name)) for name in ("likelihood", "cause", "seen", "defined")}
        return self.segmentation(replace(likelihoods, **of_cells, deviations=deviations), on_cells(flow))

    def _three_view(self, frame: MethodInput, rays: Floats) -> Floats:
        """xi_3v of each track; 0 where it is not defined."""
        motions = frame.current_from_previous[-2:]
        lengths_m = [float(np.linalg.norm(motion.translation_m)) for motion in motions]
        if len(rays) < 3 or len(motions) < 2 or min(lengths_m) < self.static_below_m:
            return np.zeros(rays.shape[1])
        deviation, _ = three_view_deviation(
            rays[2], rays[1], rays[0], second_from_first=motions[0], third_from_second=motions[1]
        )
        return deviation


@dataclass(frozen=True, kw_only=True)
class ThreeViewOnly(SparseSphericalMethod):
    """The three-view constraint alone, on Lucas-Kanade tracks; needs scale, sees changes of speed and crossing."""

    name = "three-view-only"
    weights: ConstraintWeights = ALONE[THREE_VIEW]
    threshold: Positive = PAPER_ANGLE_RAD / THREE_VIEW_WEIGHT


def _nearest(pixels: Floats, cells: RayGrid, *, reach_px: int) -> tuple[NDArray[np.intp], Bools]:
    """For every cell the nearest track, and whether its window covers the cell's centre; both (rows, columns)."""
    shape = cells.valid.shape
    if not len(pixels):
        return np.zeros(shape, dtype=np.intp), np.zeros(shape, dtype=bool)
    distance_px, nearest = cKDTree(pixels).query(
        cells.pixels.reshape(-1, 2), p=np.inf, distance_upper_bound=reach_px + 0.5
    )
    near = np.isfinite(distance_px).reshape(shape) & cells.valid
    return np.where(near, nearest.reshape(shape), 0), near


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
    threshold: Positive = math.nan
    scale: Scale = "none"
    tracker: LucasKanadeTracker = field(default_factory=LucasKanadeTracker)
    odometry: VisualOdometry = field(default_factory=VisualOdometry)

    def __post_init__(self) -> None:
        allowed = PAPER_WEIGHTS if self.scale == "given" else SCALE_FREE
        if self.weights is SCALE_FREE:
            object.__setattr__(self, "weights", allowed)
        if math.isnan(self.threshold):
            object.__setattr__(self, "threshold", PAPER_ANGLE_RAD / allowed.total)
        set_groups(self, weights=allowed, tracker=LucasKanadeTracker(), odometry=VisualOdometry())
        super().__post_init__()
        asked = [name for name in NEED_SCALE if getattr(self.weights, name) > 0]
        if self.scale == "none" and asked:
            raise UsageError(
                f"{self.name}: {' and '.join(asked)} need the length of the translation, which images do not show; "
                f"set {' '.join(f'weights.{name}=0' for name in asked)}, or scale=given for the recording's own"
            )

    def likelihood_map(self, frame: MethodInput, flow: NDArray[np.float32]) -> LikelihoodMap:
        """Likelihood map by ego-motion from images; without scale the deviations that need one are not known."""
        likelihoods = super().likelihood_map(frame, flow)
        hidden = NEED_SCALE if self.scale == "none" else ()
        return replace(
            likelihoods, deviations={name: d for name, d in likelihoods.deviations.items() if name not in hidden}
        )

    def motion(self, frame: MethodInput) -> RigidTransform | None:
        """Motion of the camera as its images show it; without scale its length is 1, or 0 where it is stationary."""
        tracks = self.tracker((frame.images[-1], frame.images[-2]), valid=frame.valid)
        followed = tracks.followed[1]
        current, _ = frame.camera.unproject(tracks.pixels[0, followed])
        previous, _ = frame.camera.unproject(tracks.pixels[1, followed])
        estimated = self.odometry(previous, current)
        if estimated is None:
            return None
        length_m = 1.0
        if self.scale == "given":
            length_m = float(np.linalg.norm(frame.current_from_previous[-1].translation_m))
        return RigidTransform(estimated.rotation, length_m * estimated.direction if estimated.moves else np.zeros(3))
