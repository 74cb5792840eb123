"""From rays to the likelihood of motion: weights, parameters and the weighted mean of the deviations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from bench.errors import UsageError
from bench.geometry import Bools, Floats, RigidTransform, RoadPlane
from bench.methods.spherical.constraints import (
    PAPER,
    Deviations,
    Variants,
    deviations,
    static_camera_deviation,
)
from bench.methods.two_views import rotated_halfway
from bench.records.segmentation import PAPER_THRESHOLD

CONSTRAINTS = ("epipolar", "positive_depth", "positive_height", "anti_parallel")
THREE_VIEW = "three_view"
STATIC_CAUSE = "static_camera"


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstraintWeights:
    """Weights mu of the deviations; the defaults are the paper's, whose divisor is always 2.4.

    Raises:
        UsageError: a negative weight, or none that is positive.
    """

    epipolar: float = 1.0
    positive_depth: float = 1.0
    positive_height: float = 0.2
    anti_parallel: float = 0.2
    three_view: float = 0.0

    def __post_init__(self) -> None:
        if min(self.as_tuple()) < 0 or self.total <= 0:
            raise UsageError(f"weights: expected numbers >= 0 with at least one positive, got {self.as_tuple()}")

    def as_tuple(self) -> tuple[float, float, float, float, float]:
        """In the paper's order: e, d, h, p, 3v."""
        return self.epipolar, self.positive_depth, self.positive_height, self.anti_parallel, self.three_view

    @property
    def total(self) -> float:
        """The divisor of the weighted mean."""
        return float(sum(self.as_tuple()))


PAPER_WEIGHTS = ConstraintWeights()
# Above this angle the paper's method sees motion by the epipolar or the positive depth constraint alone; 0.24 px at 165
# px per radian. What is compared with the paper's method at one angle takes it from here.
PAPER_ANGLE_RAD = PAPER_THRESHOLD * PAPER_WEIGHTS.total


def alone(constraint: str, weight: float = 1.0) -> tuple[ConstraintWeights, float]:
    """Weights of one constraint alone, and the threshold at which it marks what it marks alone in the paper's method.

    There a cell moves where `mu_i xi_i / 2.4 > 6e-4`. With a single weight of 1 the likelihood is xi_i itself, so the
    threshold becomes `6e-4 x 2.4 / mu_i`.

    Args:
        constraint: name of a field of `ConstraintWeights`.
        weight: mu_i, its weight among the others.
    """
    none = dict.fromkeys((f.name for f in fields(ConstraintWeights)), 0.0)
    return ConstraintWeights(**none | {constraint: 1.0}), PAPER_ANGLE_RAD / weight


def motion_likelihood(
    deviations: Deviations,
    weights: ConstraintWeights,
    *,
    three_view: Floats | None = None,
    root_sum: bool = False,
) -> Floats:
    """Weighted mean of the deviations.

    Args:
        deviations: of any shape.
        weights: mu of each constraint; the divisor is their whole sum, whichever constraints fire.
        three_view: xi_3v where tracks over three views exist; 0 is taken where it is NaN.
        root_sum: use hypot(mu_e xi_e, mu_d xi_d) instead of their sum, since both measure parts of one
            displacement; off in the paper.

    Returns:
        Motion likelihood xi, same shape, float64, 0 where not defined.

    Source:
        Mariotti and Eising, section III-H.
    """
    epipolar, depth = weights.epipolar * deviations.epipolar, weights.positive_depth * deviations.positive_depth
    likelihood = np.hypot(epipolar, depth) if root_sum else epipolar + depth
    likelihood += weights.positive_height * deviations.positive_height
    likelihood += weights.anti_parallel * deviations.anti_parallel
    if three_view is not None:
        likelihood += weights.three_view * np.nan_to_num(three_view, nan=0.0)
    likelihood /= weights.total
    return np.asarray(likelihood)


def largest_contribution(
    deviations: Deviations, weights: ConstraintWeights, *, three_view: Floats | None = None
) -> NDArray[np.uint8]:
    """Index into `CONSTRAINTS`, then `three_view`, of the largest weighted deviation; the first of equals."""
    parts = [getattr(weights, name) * getattr(deviations, name) for name in CONSTRAINTS]
    if three_view is not None:
        parts.append(weights.three_view * three_view)
    best, cause = parts[0], np.zeros(parts[0].shape, dtype=np.uint8)
    for index, part in enumerate(parts[1:], start=1):
        np.copyto(cause, np.uint8(index), where=part > best)
        best = np.fmax(best, part)
    return cause


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LikelihoodMap:
    """Likelihood of motion, of points or of the cells of an image; only the threshold is missing.

    Attributes:
        likelihood: (...) float64; 0 where not defined.
        cause: (...) uint8, index into `causes` of the largest contribution.
        seen: (...) bool; both images see the content.
        defined: (...) bool; the deviations are defined.
        stationary: () bool; the camera is stationary.
        deviations: the deviations of a moving camera by name, (...) float64; empty where they are not known.
    """

    likelihood: Floats
    cause: NDArray[np.uint8]
    seen: Bools
    defined: Bools
    stationary: Bools
    deviations: Mapping[str, Floats] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class SphericalSettings:
    """Parameters of the constraints; the defaults are the paper's.

    Attributes:
        cell_size_px: side of the cells that are segmented.
        weights: of the constraints; a dictionary changes the method's own.
        lambda_height: threshold of positive height.
        lambda_anti_parallel: threshold of anti-parallel.
        threshold: likelihood above which a cell moves, at 15 frames per second.
        static_threshold: the same for a stationary camera. The paper gives one number for both; on this value, which is
            not divided by the sum of weights, it is 2.4 times more sensitive.
        static_below_m: translation between two images below which the camera counts as stationary; 0.05 m/s at 15
            frames per second.
        lambda_static_m: displacement on the road below which a stationary camera sees no motion.
        min_epipole_sine: alpha_min, size of the blind spot around the epipoles.
        variants: departures from the paper's constraints.
        root_sum: hypot of epipolar and positive depth instead of their sum.

    Raises:
        UsageError: a number that is out of its domain.

    Source:
        Mariotti and Eising, section III; constants of section III-H and IV.
    """

    cell_size_px: int = 5
    weights: ConstraintWeights = PAPER_WEIGHTS
    lambda_height: float = 0.001
    lambda_anti_parallel: float = 0.001
    threshold: float = PAPER_THRESHOLD
    static_threshold: float = PAPER_THRESHOLD
    static_below_m: float = 0.05 / 15
    lambda_static_m: float = 0.02
    min_epipole_sine: float = 0.01
    variants: Variants = PAPER
    root_sum: bool = False

    def __post_init__(self) -> None:
        if isinstance(self.weights, dict):
            object.__setattr__(self, "weights", replace(type(self).weights, **self.weights))
        if isinstance(self.variants, dict):
            object.__setattr__(self, "variants", Variants(**self.variants))
        if self.cell_size_px < 1 or min(self.threshold, self.static_threshold) <= 0:
            raise UsageError("spherical: expected cell_size_px >= 1 and thresholds > 0")

    def likelihood_of_rays(
        self,
        rays_previous: Floats,
        rays_current: Floats,
        *,
        seen: Bools,
        current_from_previous: RigidTransform,
        road: RoadPlane,
        three_view: Floats | None = None,
        extra_motion: Floats | None = None,
    ) -> LikelihoodMap:
        """Likelihood of motion by the constraints of a moving or of a stationary camera, as its motion asks for.

        Args:
            rays_previous: (..., 3) float64, unit rays p of the previous camera frame; NaN where not valid.
            rays_current: (..., 3) float64, unit rays p' of the current camera frame; NaN where not valid.
            seen: (...) bool; both images see the content.
            current_from_previous: motion of the camera.
            road: the road below the camera.
            three_view: (...) float64, xi_3v where tracks over three views exist.
            extra_motion: (...) float64, share of the motion by which more of it lies between two rows of a rolling
                shutter, see `bench.methods.two_views`; None where all rows are exposed at once.
        """
        path_share: Floats | float = 1.0
        if extra_motion is not None:
            rays_previous, rays_current = rotated_halfway(
                rays_previous, rays_current, current_from_previous=current_from_previous, extra_motion=extra_motion
            )
            path_share = 1.0 + extra_motion
        if np.linalg.norm(current_from_previous.translation_m) < self.static_below_m:
            deviation, defined = static_camera_deviation(
                rays_previous,
                rays_current,
                current_from_previous=current_from_previous,
                road=road,
                lambda_static_m=self.lambda_static_m,
            )
            cause = np.zeros(defined.shape, dtype=np.uint8)
            return LikelihoodMap(
                likelihood=deviation, cause=cause, seen=seen, defined=defined, stationary=np.asarray(True)
            )
        measured = deviations(
            rays_previous,
            rays_current,
            current_from_previous=current_from_previous,
            road=road,
            path_share=path_share,
            lambda_height=self.lambda_height,
            lambda_anti_parallel=self.lambda_anti_parallel,
            min_epipole_sine=self.min_epipole_sine,
            variants=self.variants,
        )
        by_name = {name: getattr(measured, name) for name in CONSTRAINTS}
        return LikelihoodMap(
            likelihood=motion_likelihood(measured, self.weights, three_view=three_view, root_sum=self.root_sum),
            cause=largest_contribution(measured, self.weights, three_view=three_view),
            seen=seen,
            defined=measured.defined,
            stationary=np.asarray(False),
            deviations=by_name if three_view is None else by_name | {THREE_VIEW: three_view},
        )

    def threshold_of(self, likelihoods: LikelihoodMap) -> float:
        """The likelihood above which a cell moves."""
        return self.static_threshold if likelihoods.stationary else self.threshold
