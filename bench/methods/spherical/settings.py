"""What decides the result of the spherical methods, and the step that they share: rays in, deviations out."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.errors import UsageError
from bench.geometry import RigidTransform, RoadPlane
from bench.methods.spherical.likelihood import PAPER_THRESHOLD, PAPER_WEIGHTS, Weights
from bench.methods.spherical.static_camera import static_camera_deviation
from bench.methods.spherical.two_view import PAPER, Deviations, Variants, deviations

STATIC_CAUSE = "static_camera"


@dataclass(frozen=True, kw_only=True)
class SphericalSettings:
    """Parameters of the constraints; the defaults are the paper's.

    Attributes:
        cell_size_px: side of the cells that are judged.
        weights: of the constraints; a dictionary changes the method's own.
        lambda_height: threshold of positive height.
        lambda_anti_parallel: threshold of anti-parallel.
        threshold: likelihood above which a cell moves, at 15 frames per second.
        static_threshold: the same for a camera that stands still. The paper gives one figure for both; on this value,
            which is not divided by the sum of weights, it is 2.4 times more sensitive.
        static_below_m: translation between two images below which the camera counts as standing; 0.05 m/s at 15
            frames per second.
        lambda_static_m: displacement on the road below which a standing camera sees no motion.
        min_epipole_sine: alpha_min, size of the blind spot around the epipoles.
        variants: departures from the paper's constraints.
        root_sum: hypot of epipolar and positive depth instead of their sum.

    Raises:
        UsageError: a number that is out of its domain.

    Source:
        Mariotti and Eising, section III; constants of section III-H and IV.
    """

    cell_size_px: int = 5
    weights: Weights = PAPER_WEIGHTS
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

    def settings(self) -> dict[str, object]:
        """Every parameter that decides the result."""
        return asdict(self)

    def compare(
        self,
        rays_previous: NDArray[np.float64],
        rays_current: NDArray[np.float64],
        *,
        motion: RigidTransform,
        road: RoadPlane,
    ) -> RayMeasurement:
        """Deviations of rays from a static world, by the branch that the camera's motion asks for.

        Args:
            rays_previous: (..., 3) float64, unit rays p of the previous camera frame; NaN where not valid.
            rays_current: (..., 3) float64, unit rays p' of the current camera frame; NaN where not valid.
            motion: current_from_previous.
            road: the road below the camera.
        """
        if np.linalg.norm(motion.translation_m) < self.static_below_m:
            standing, defined = static_camera_deviation(
                rays_previous,
                rays_current,
                current_from_previous=motion,
                road=road,
                lambda_static_m=self.lambda_static_m,
            )
            return RayMeasurement(defined=defined, standing=standing)
        moving = deviations(
            rays_previous,
            rays_current,
            current_from_previous=motion,
            road=road,
            lambda_height=self.lambda_height,
            lambda_anti_parallel=self.lambda_anti_parallel,
            min_epipole_sine=self.min_epipole_sine,
            variants=self.variants,
        )
        return RayMeasurement(defined=moving.defined, moving=moving)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RayMeasurement:
    """Deviations before anything is weighed; exactly one of `moving` and `standing` is there.

    Attributes:
        defined: (...) bool; the deviations say something.
        moving: for a camera that moves.
        standing: (...) float64, for a camera that stands.
    """

    defined: NDArray[np.bool_]
    moving: Deviations | None = None
    standing: NDArray[np.float64] | None = None
