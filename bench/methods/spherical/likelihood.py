"""From rays to the likelihood of motion: weights, parameters and the weighted mean of the deviations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple, dataclass, fields
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from bench.errors import UsageError
from bench.geometry import Bools, Floats, RigidTransform, RoadPlane
from bench.methods.settings import Positive, set_groups
from bench.methods.spherical.constraints import PAPER, Deviations, Variants, deviations, static_camera_deviation
from bench.methods.two_views import flow_parts, rotated_halfway
from bench.records.segmentation import PAPER_THRESHOLD, Segmentation

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
        if min(astuple(self)) < 0 or self.total <= 0:
            raise UsageError(f"weights: expected numbers >= 0 with at least one positive, got {astuple(self)}")

    @property
    def total(self) -> float:
        """The divisor of the weighted mean."""
        return float(sum(astuple(self)))


PAPER_WEIGHTS = ConstraintWeights()
# Above this angle the paper's method sees motion by the epipolar or the positive depth constraint alone; 0.24 px at 165
# px per radian. What is compared with the paper's method at one angle takes it from here.
PAPER_ANGLE_RAD = PAPER_THRESHOLD * PAPER_WEIGHTS.total


# Weights of one constraint alone: the likelihood is its deviation. Among the others a cell moves by it where
# `mu_i xi_i / 2.4 > 6e-4`, so alone it marks the same with the threshold `PAPER_ANGLE_RAD / mu_i`.
_NONE = dict.fromkeys((field.name for field in fields(ConstraintWeights)), 0.0)
ALONE = {name: ConstraintWeights(**_NONE | {name: 1.0}) for name in _NONE}


def motion_likelihood(
    deviations: Deviations,
    weights: ConstraintWeights,
    *,
    three_view: Floats | None = None,
    root_sum: bool = False,
) -> tuple[Floats, NDArray[np.uint8]]:
    """Weighted mean of the deviations.

    Args:
        deviations: of any shape.
        weights: mu of each constraint; the divisor is their whole sum, whichever constraints fire.
        three_view: xi_3v where tracks over three views exist; 0 is taken where it is NaN.
        root_sum: use hypot(mu_e xi_e, mu_d xi_d) instead of their sum, since both measure parts of one
            displacement; off in the paper.

    Returns:
        likelihood: xi, same shape, float64, 0 where not defined.
        cause: index into `CONSTRAINTS`, then `three_view`, of the largest weighted deviation; the first of equals.

    Source:
        Mariotti and Eising, section III-H.
    """
    contributions = [getattr(weights, name) * getattr(deviations, name) for name in CONSTRAINTS]
    if three_view is not None:
        contributions.append(weights.three_view * np.nan_to_num(three_view))
    epipolar, depth, *others = contributions
    likelihood = np.hypot(epipolar, depth) if root_sum else epipolar + depth
    for contribution in others:
        likelihood += contribution
    return likelihood / weights.total, np.argmax(contributions, axis=0).astype(np.uint8)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LikelihoodMap:
    """Likelihood of motion, of points or of the cells of an image; only the threshold is missing.

    Attributes:
        likelihood: (...) float64; 0 where not defined.
        cause: (...) uint8, index into `causes` of the largest contribution.
        seen: (...) bool; both images see the content.
        defined: (...) bool; the deviations are defined.
        deviations: the known deviations of a moving camera by name, (...) float64; empty for a stationary one.
    """

    likelihood: Floats
    cause: NDArray[np.uint8]
    seen: Bools
    defined: Bools
    deviations: Mapping[str, Floats]

    @property
    def stationary(self) -> bool:
        """The camera is stationary."""
        return not self.deviations


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

    Source:
        Mariotti and Eising, section III; constants of section III-H and IV.
    """

    cell_size_px: Annotated[int, Field(ge=1)] = 5
    weights: ConstraintWeights = PAPER_WEIGHTS
    lambda_height: float = 0.001
    lambda_anti_parallel: float = 0.001
    threshold: Positive = PAPER_THRESHOLD
    static_threshold: Positive = PAPER_THRESHOLD
    static_below_m: Positive = 0.05 / 15
    lambda_static_m: float = 0.02
    min_epipole_sine: float = 0.01
    variants: Variants = PAPER
    root_sum: bool = False

    def __post_init__(self) -> None:
        set_groups(self, weights=type(self).weights, variants=PAPER)

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
            return LikelihoodMap(likelihood=deviation, cause=cause, seen=seen, defined=defined, deviations={})
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
        by_name, defined = {name: getattr(measured, name) for name in CONSTRAINTS}, measured.defined
        if three_view is not None:
            by_name[THREE_VIEW] = three_view
            defined = defined | (three_view > 0)  # three views may tell where two have no epipolar plane
        likelihood, cause = motion_likelihood(measured, self.weights, three_view=three_view, root_sum=self.root_sum)
        return LikelihoodMap(likelihood=likelihood, cause=cause, seen=seen, defined=defined, deviations=by_name)

    def segmentation(self, likelihoods: LikelihoodMap, flow: NDArray[np.float32]) -> Segmentation:
        """Apply the threshold.

        Args:
            likelihoods: of the cells of an image, (rows, columns).
            flow: (rows, columns, 2) float32, px, from the current to the previous image; to look at.
        """
        deviations = {name: deviation.astype(np.float32) for name, deviation in likelihoods.deviations.items()}
        threshold = self.static_threshold if likelihoods.stationary else self.threshold
        causes = CONSTRAINTS if THREE_VIEW not in deviations else (*CONSTRAINTS, THREE_VIEW)
        return Segmentation(
            cell_size_px=self.cell_size_px,
            mask=(likelihoods.likelihood > threshold) & likelihoods.seen,
            likelihood=np.where(likelihoods.seen, likelihoods.likelihood, 0.0).astype(np.float32),
            undefined=~(likelihoods.defined & likelihoods.seen),
            causes=(STATIC_CAUSE,) if likelihoods.stationary else causes,
            cause=likelihoods.cause,
            parts=flow_parts(flow) | deviations,
            threshold=threshold,
        )
