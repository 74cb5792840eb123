"""The paper's segmentation, from two images to a mask of the current one."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from bench.cameras import RayGrid, ray_grid
from bench.flow import cell_mean, dense_flow
from bench.geometry import RigidTransform
from bench.methods.cells import flow_parts, flow_rays, seen_at_centres
from bench.methods.contract import Arrays, MethodInput, Segmentation
from bench.methods.spherical.likelihood import CONSTRAINTS, largest_contribution, motion_likelihood
from bench.methods.spherical.settings import STATIC_CAUSE, SphericalSettings
from bench.methods.spherical.two_view import Deviations


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Weighed:
    """What the cells of an image come to; only the threshold is missing.

    Attributes:
        likelihood: (rows, columns) float64.
        cause: (rows, columns) uint8, the constraint of the largest contribution.
        seen: (rows, columns) bool; both images could see the cell's content.
        undefined: (rows, columns) bool; nothing can be said.
        standing: () bool; the camera stands.
    """

    likelihood: NDArray[np.float64]
    cause: NDArray[np.uint8]
    seen: NDArray[np.bool_]
    undefined: NDArray[np.bool_]
    standing: NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class SphericalMethod(SphericalSettings):
    """The paper's method: dense flow on cells, deviations on the sphere, weighted mean, threshold.

    Attributes:
        flow: name of the dense flow, see `bench.flow.DENSE_FLOWS`; it is averaged on the cells.
        flow_parameters: what the flow takes.

    Source:
        Mariotti and Eising, section III; constants of section III-H and IV.
    """

    name: ClassVar[str] = "spherical"
    history: ClassVar[int] = 1

    flow: str = "farneback"
    flow_parameters: dict[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        dense_flow(self.flow, **self.flow_parameters)

    def segment(self, frame: MethodInput) -> Segmentation:
        """Segment the last image of the pair; see `bench.methods.contract`. Flow and likelihood are worth keeping."""
        measured: list[Measurement] = []

        def weigh() -> Arrays:
            settings = self.flow, self.flow_parameters, self.cell_size_px
            flow = frame.cached_step("flow", settings, lambda: {"flow": self.mean_flow(frame)}, of="images")["flow"]
            measured.append(self.measure(frame, flow))
            weighed = self.weigh(measured[0])
            return {field.name: np.asarray(getattr(weighed, field.name)) for field in fields(weighed)}

        found = frame.cached_step("likelihood", (self.name, self._all_but_thresholds), weigh, of="input")
        return self._decide(Weighed(**found), self._parts(measured[0]) if measured else {})

    @cached_property
    def _all_but_thresholds(self) -> dict[str, object]:
        """Settings that decide the likelihood."""
        thresholds = ("threshold", "static_threshold")
        return {name: value for name, value in self.settings().items() if name not in thresholds}

    def mean_flow(self, frame: MethodInput) -> NDArray[np.float32]:
        """Flow from the current to the previous image, (rows, columns, 2) float32, px, mean over each cell."""
        compute = dense_flow(self.flow, **self.flow_parameters)
        return cell_mean(compute(frame.images[-1], frame.images[-2]), self.cell_size_px)

    def motion(self, frame: MethodInput) -> RigidTransform | None:
        """Motion of the camera, current_from_previous; None where it is not known and so nothing can be said."""
        return frame.current_from_previous[-1]

    def measure(self, frame: MethodInput, flow: NDArray[np.float32]) -> Measurement:
        """Deviations of each cell from a static world; neither weights nor thresholds have a part in them.

        Args:
            frame: its images are not looked at, unless the motion is found in them.
            flow: from `mean_flow`.
        """
        cells = ray_grid(frame.camera, self.cell_size_px)
        motion = self.motion(frame)
        if motion is None:
            nowhere = np.zeros(cells.valid.shape, dtype=bool)
            return Measurement(flow=flow, seen=nowhere, defined=nowhere, standing=np.zeros(nowhere.shape))
        rays_previous, seen = self._rays_previous(frame, cells, flow)
        found = self.compare(rays_previous, cells.rays_camera, motion=motion, road=frame.road)
        return Measurement(flow=flow, seen=seen, defined=found.defined, moving=found.moving, standing=found.standing)

    def judge(self, measured: Measurement) -> Segmentation:
        """Weigh the deviations and apply the threshold."""
        return self._decide(self.weigh(measured), self._parts(measured))

    def weigh(self, measured: Measurement) -> Weighed:
        """Weigh the deviations; thresholds have no part in it."""
        if measured.moving is None:
            assert measured.standing is not None, "a camera moves or stands"
            likelihood, cause = measured.standing, np.zeros(measured.seen.shape, dtype=np.uint8)
        else:
            likelihood = motion_likelihood(measured.moving, self.weights, root_sum=self.root_sum)
            cause = largest_contribution(measured.moving, self.weights)
        return Weighed(
            likelihood=likelihood,
            cause=cause,
            seen=measured.seen,
            undefined=~(measured.defined & measured.seen),
            standing=np.asarray(measured.moving is None),
        )

    def _decide(self, weighed: Weighed, parts: dict[str, NDArray[np.float32]]) -> Segmentation:
        threshold = self.static_threshold if weighed.standing else self.threshold
        return Segmentation(
            cell_size_px=self.cell_size_px,
            mask=(weighed.likelihood > threshold) & weighed.seen,
            likelihood=np.where(weighed.seen, weighed.likelihood, 0.0).astype(np.float32),
            undefined=weighed.undefined,
            causes=(STATIC_CAUSE,) if weighed.standing else CONSTRAINTS,
            cause=weighed.cause,
            parts=parts,
        )

    def _parts(self, measured: Measurement) -> dict[str, NDArray[np.float32]]:
        """What of a measurement is there to look at."""
        deviations = {} if measured.moving is None else _deviation_parts(measured.moving)
        return flow_parts(measured.flow) | deviations

    def _rays_previous(
        self, frame: MethodInput, cells: RayGrid, flow: NDArray[np.float32]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Where each cell's content was in the previous image; and whether both images could see it."""
        rays, seen = flow_rays(frame.camera, cells, flow)
        return rays, seen & seen_at_centres(frame.valid, cells)


def _deviation_parts(measured: Deviations) -> dict[str, NDArray[np.float32]]:
    return {name: getattr(measured, name).astype(np.float32) for name in CONSTRAINTS}
