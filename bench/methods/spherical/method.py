"""The paper's segmentation, from two images to a mask of the current one."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from bench.cameras import RayGrid, ray_grid
from bench.errors import UsageError
from bench.flow import cell_mean, dense_flow
from bench.methods.contract import MethodInput, Segmentation
from bench.methods.spherical.likelihood import (
    CONSTRAINTS,
    PAPER_WEIGHTS,
    Weights,
    largest_contribution,
    motion_likelihood,
)
from bench.methods.spherical.static_camera import static_camera_deviation
from bench.methods.spherical.two_view import PAPER, Deviations, Variants, deviations

STATIC_CAUSE = "static_camera"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Measurement:
    """What the cells of an image show before anything is weighed; exactly one of `moving` and `standing` is there.

    Attributes:
        flow: (rows, columns, 2) float32, px, to the previous image.
        seen: (rows, columns) bool; both images could see the cell's content.
        defined: (rows, columns) bool; the deviations say something.
        moving: deviations for a camera that moves.
        standing: (rows, columns) float64, deviation for a camera that stands.
    """

    flow: NDArray[np.float32]
    seen: NDArray[np.bool_]
    defined: NDArray[np.bool_]
    moving: Deviations | None = None
    standing: NDArray[np.float64] | None = None


@dataclass(frozen=True, kw_only=True)
class SphericalMethod:
    """Flow on cells, deviations on the sphere, weighted mean, threshold.

    Attributes:
        flow: name of the dense flow, see `bench.flow.DENSE_FLOWS`.
        flow_parameters: what the flow takes.
        cell_size_px: side of the cells on which the flow is averaged.
        weights: of the constraints.
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

    Source:
        Mariotti and Eising, section III; constants of section III-H and IV.
    """

    name: ClassVar[str] = "spherical"
    history: ClassVar[int] = 1
    colour: ClassVar[bool] = False

    flow: str = "farneback"
    flow_parameters: dict[str, object] = field(default_factory=dict)
    cell_size_px: int = 5
    weights: Weights = PAPER_WEIGHTS
    lambda_height: float = 0.001
    lambda_anti_parallel: float = 0.001
    threshold: float = 6e-4
    static_threshold: float = 6e-4
    static_below_m: float = 0.05 / 15
    lambda_static_m: float = 0.02
    min_epipole_sine: float = 0.01
    variants: Variants = PAPER
    root_sum: bool = False

    def __post_init__(self) -> None:
        if isinstance(self.weights, dict):
            object.__setattr__(self, "weights", Weights(**self.weights))
        if isinstance(self.variants, dict):
            object.__setattr__(self, "variants", Variants(**self.variants))
        if self.cell_size_px < 1 or min(self.threshold, self.static_threshold) <= 0:
            raise UsageError("spherical: wanted cell_size_px >= 1 and thresholds > 0")
        dense_flow(self.flow, **self.flow_parameters)

    def settings(self) -> dict[str, object]:
        """Every parameter that decides the result."""
        return asdict(self)

    def segment(self, frame: MethodInput) -> Segmentation:
        """Segment the last image of the pair; see `bench.methods.contract`."""
        return self.judge(self.measure(frame, self.mean_flow(frame)))

    def mean_flow(self, frame: MethodInput) -> NDArray[np.float32]:
        """Flow from the current to the previous image, (rows, columns, 2) float32, px, mean over each cell."""
        compute = dense_flow(self.flow, **self.flow_parameters)
        return cell_mean(compute(frame.images[-1], frame.images[-2]), self.cell_size_px)

    def measure(self, frame: MethodInput, flow: NDArray[np.float32]) -> Measurement:
        """Deviations of each cell from a static world; neither weights nor thresholds have a part in them.

        Args:
            frame: its images are not looked at.
            flow: from `mean_flow`.
        """
        cells = ray_grid(frame.camera, self.cell_size_px)
        rays_previous, seen = self._rays_previous(frame, cells, flow)
        motion = frame.current_from_previous[-1]
        if np.linalg.norm(motion.translation_m) < self.static_below_m:
            standing, defined = static_camera_deviation(
                rays_previous,
                cells.rays_camera,
                current_from_previous=motion,
                road=frame.road,
                lambda_static_m=self.lambda_static_m,
            )
            return Measurement(flow=flow, seen=seen, defined=defined, standing=standing)
        moving = deviations(
            rays_previous,
            cells.rays_camera,
            current_from_previous=motion,
            road=frame.road,
            lambda_height=self.lambda_height,
            lambda_anti_parallel=self.lambda_anti_parallel,
            min_epipole_sine=self.min_epipole_sine,
            variants=self.variants,
        )
        return Measurement(flow=flow, seen=seen, defined=moving.defined, moving=moving)

    def judge(self, measured: Measurement) -> Segmentation:
        """Weigh the deviations and apply the threshold."""
        if measured.moving is None:
            assert measured.standing is not None, "a camera moves or stands"
            return self._segmentation(
                measured,
                measured.standing,
                threshold=self.static_threshold,
                causes=(STATIC_CAUSE,),
                cause=np.zeros(measured.seen.shape, dtype=np.uint8),
                parts={},
            )
        return self._segmentation(
            measured,
            motion_likelihood(measured.moving, self.weights, root_sum=self.root_sum),
            threshold=self.threshold,
            causes=CONSTRAINTS,
            cause=largest_contribution(measured.moving, self.weights),
            parts=_deviation_parts(measured.moving),
        )

    def _rays_previous(
        self, frame: MethodInput, cells: RayGrid, flow: NDArray[np.float32]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Where each cell's content was in the previous image; and whether both images could see it."""
        pixels = (cells.pixels + flow).reshape(-1, 2)
        rays, valid = frame.camera.unproject(pixels)
        seen = (valid & frame.camera.contains(pixels)).reshape(cells.valid.shape)
        seen &= cells.valid & _at_centres(frame.valid, cells)
        return rays.reshape(cells.rays_camera.shape), seen

    def _segmentation(
        self,
        measured: Measurement,
        likelihood: NDArray[np.float64],
        *,
        threshold: float,
        causes: tuple[str, ...],
        cause: NDArray[np.uint8],
        parts: dict[str, NDArray[np.float32]],
    ) -> Segmentation:
        return Segmentation(
            cell_size_px=self.cell_size_px,
            mask=(likelihood > threshold) & measured.seen,
            likelihood=np.where(measured.seen, likelihood, 0.0).astype(np.float32),
            undefined=~(measured.defined & measured.seen),
            causes=causes,
            cause=cause,
            parts=_flow_parts(measured.flow) | parts,
        )


def _at_centres(image: NDArray[np.bool_], cells: RayGrid) -> NDArray[np.bool_]:
    height, width = image.shape
    rows = np.minimum(cells.pixels[:, 0, 1].astype(np.intp), height - 1)
    columns = np.minimum(cells.pixels[0, :, 0].astype(np.intp), width - 1)
    return image[np.ix_(rows, columns)]


def _flow_parts(flow: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
    return {"flow_u": flow[..., 0], "flow_v": flow[..., 1]}


def _deviation_parts(measured: Deviations) -> dict[str, NDArray[np.float32]]:
    return {name: getattr(measured, name).astype(np.float32) for name in CONSTRAINTS}
