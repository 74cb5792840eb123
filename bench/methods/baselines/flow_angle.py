"""Flow alone: what moves in the image, with and without the turn of the camera."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from bench.cameras import ray_grid
from bench.errors import UsageError
from bench.flow import cell_mean, dense_flow
from bench.geometry import angle_between
from bench.methods.cells import flow_parts, flow_rays, seen_at_centres
from bench.methods.contract import MethodInput, Segmentation
from bench.methods.spherical.likelihood import PAPER_ANGLE_RAD


@dataclass(frozen=True, kw_only=True)
class FlowMagnitude:
    """Marks what moves in the image: the angle between a cell's rays now and before.

    An angle and not a length in pixels, so that it means the same all over the lens. The flow and the cells are those
    of the paper's method, and so is the threshold: the angle at which that sees motion by its epipolar or its positive
    depth constraint alone. It has a part in neither ego-motion nor scene.

    Attributes:
        flow: name of the dense flow, see `bench.flow.DENSE_FLOWS`.
        flow_parameters: what the flow takes.
        cell_size_px: side of the cells on which the flow is averaged.
        threshold: angle above which a cell moves, rad between two images.

    Raises:
        UsageError: a number that is out of its domain.
    """

    name: ClassVar[str] = "flow-magnitude"
    history: ClassVar[int] = 1

    flow: str = "farneback"
    flow_parameters: dict[str, object] = field(default_factory=dict)
    cell_size_px: int = 5
    threshold: float = PAPER_ANGLE_RAD

    def __post_init__(self) -> None:
        if self.cell_size_px < 1 or self.threshold <= 0:
            raise UsageError(f"{self.name}: expected cell_size_px >= 1 and threshold > 0")
        dense_flow(self.flow, **self.flow_parameters)

    def settings(self) -> dict[str, object]:
        """Every parameter that decides the result."""
        return asdict(self)

    def turned(self, rays_previous: NDArray[np.float64], frame: MethodInput) -> NDArray[np.float64]:
        """Previous rays as they are compared with current ones; here as they are."""
        del frame
        return rays_previous

    def segment(self, frame: MethodInput) -> Segmentation:
        """Segment the last image of the pair; see `bench.methods.contract`."""
        compute = dense_flow(self.flow, **self.flow_parameters)
        flow = cell_mean(compute(frame.images[-1], frame.images[-2]), self.cell_size_px)
        cells = ray_grid(frame.camera, self.cell_size_px)
        rays_previous, seen = flow_rays(frame.camera, cells, flow)
        seen &= seen_at_centres(frame.valid, cells)
        angles_rad = np.where(seen, angle_between(self.turned(rays_previous, frame), cells.rays_camera), 0.0)
        return Segmentation(
            cell_size_px=self.cell_size_px,
            mask=angles_rad > self.threshold,
            likelihood=angles_rad.astype(np.float32),
            undefined=~seen,
            parts=flow_parts(flow),
        )


@dataclass(frozen=True, kw_only=True)
class RotationCompensatedFlow(FlowMagnitude):
    """Marks what moves in the image but for the camera's turn: the angle between p' and q = R p.

    Of the ego-motion only the rotation has a part in it. For a camera that only turns it is exact; for one that
    travels all that is near moves.
    """

    name: ClassVar[str] = "rotation-compensated-flow"

    def turned(self, rays_previous: NDArray[np.float64], frame: MethodInput) -> NDArray[np.float64]:
        """Previous rays, turned into the current frame."""
        return frame.current_from_previous[-1].rotate(rays_previous)
