"""A method on one pair of images, three times: as recorded, with exact ego-motion, with exact flow as well.

The scene is simulated again from the scenario that rendered the recording. Any `FlowMethod` can be asked: as in the
benchmark (R), with the exact ego-motion and calibration in place of the recorded ones (M), and with the exact flow as
well (E).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bench.audit.sources import AuditSource
from bench.cameras import ray_grid
from bench.errors import DataError
from bench.harness.stages import StageClock
from bench.methods import FlowMethod, MethodInput, Segmentation, ask_method
from bench.methods.cells import flow_rays
from bench.recordings import MountedCamera
from bench.synthesis.exact_flow import ExactFlow, ExactFlowCaster
from bench.synthesis.scene import build_scene

Cells = NDArray[np.bool_]
ANTI_PARALLEL = "anti_parallel"
LARGEST_DISAGREEMENT = 0.02  # of the cells that show an object, over a recording


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evidence:
    """Results of the three runs for each cell of the flow, at its centre, all (rows, columns) bool.

    Attributes:
        by_recorded: R fires.
        by_exact_flow: E fires.
        by_exact_motion: M fires.
        seen: both images could see the cell's content, by the exact flow.
        defined: the constraints are defined.
        below_horizon: both rays of the exact flow point below the horizon.
        anti_parallel: E's largest contribution is the anti-parallel one.
        visible: the previous image shows the same point.
        moving: the cell shows a moving object.
    """

    by_recorded: Cells
    by_exact_flow: Cells
    by_exact_motion: Cells
    seen: Cells
    defined: Cells
    below_horizon: Cells
    anti_parallel: Cells
    visible: Cells
    moving: Cells


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThreeRuns:
    """The answers, and what they say of each cell.

    Attributes:
        recorded: as in the benchmark.
        exact_motion: with exact ego-motion and calibration.
        exact_flow: with exact flow as well.
        evidence: what they say of each cell; `moving` is every object that is evaluated or ignored.
        cell_size_px: side of a cell.
        shown: (rows, columns) bool, cells whose centre is in V.
        instance_ids: (rows, columns), what the cells' centres show.
        flow_error_px: (rows, columns) float64, of the estimated flow; NaN where the point was not visible before.
    """

    recorded: Segmentation
    exact_motion: Segmentation
    exact_flow: Segmentation
    evidence: Evidence
    cell_size_px: int
    shown: Cells
    instance_ids: NDArray[np.integer]
    flow_error_px: NDArray[np.float64]


class ExactRunner:
    """Asks a method on the images of one camera, with what is exactly known of them.

    Args:
        source: of a recording that is in the scenario.
        camera: with its true calibration.
        valid: (H, W) bool, the region V.
        method: to be explained.
        clock: adds up the time of each stage.
    """

    def __init__(
        self,
        source: AuditSource,
        camera: MountedCamera,
        *,
        valid: NDArray[np.bool_],
        method: FlowMethod,
        clock: StageClock,
    ) -> None:
        assert source.scene is not None, "the recording can be simulated"
        scenario, spec = source.scene
        self._camera, self._name, self._method, self._clock = camera, spec.name, method, clock
        self._cell_size_px = method.flow_cell_px(valid.shape[1])
        self._cells = ray_grid(camera.model, self._cell_size_px)
        self._shown = self._cells.at_centres(valid)
        self._caster = ExactFlowCaster(
            build_scene(scenario, spec), camera, valid=valid, cell_size_px=self._cell_size_px
        )
        self._object_cells, self._differing_cells = 0, 0

    def run(self, given: MethodInput, ids: NDArray[np.uint16], *, moving: Sequence[int]) -> ThreeRuns:
        """Ask the method three times.

        Args:
            given: its input as recorded.
            ids: (H, W) uint16, the true instance ids of the current image, which the scene has to show again.
            moving: instance ids of the objects that move.
        """
        with self._clock.stage("exact flow"):
            previous_ns, current_ns = given.timestamps_ns[-2:]
            flow = self._caster.flow(current_ns=current_ns, previous_ns=previous_ns)
            self._compare(flow, ids)
            exact = replace(
                given,
                camera=self._camera.model,
                road=self._caster.road(current_ns),
                current_from_previous=tuple(
                    self._caster.motion(current_ns=later_ns, previous_ns=earlier_ns)
                    for earlier_ns, later_ns in pairwise(given.timestamps_ns)
                ),
            )
        with self._clock.stage("method"):
            return self._three_runs(given, exact, flow, moving=moving)

    def check(self) -> None:
        """Refuse a scene that is not the one that was rendered.

        Raises:
            DataError: objects are not where the truth images show them.
        """
        if self._differing_cells > LARGEST_DISAGREEMENT * self._object_cells:
            share = self._differing_cells / self._object_cells
            raise DataError(
                self._name,
                expected="a scenario that describes the scene as it was rendered",
                got=f"one that shows other objects in {100 * share:.0f} % of their cells",
                hint="render the data set again",
            )

    def _three_runs(
        self, given: MethodInput, exact: MethodInput, flow: ExactFlow, *, moving: Sequence[int]
    ) -> ThreeRuns:
        method, cells, true = self._method, self._cells, flow.flow.astype(np.float32)
        recorded, exact_motion = ask_method(method, given), ask_method(method, exact)
        exact_flow = method.segment_flow(exact, true)
        error_px = np.linalg.norm(method.mean_flow(given) - flow.flow, axis=-1)

        height, width = given.valid.shape
        _, seen = flow_rays(exact, cells, true)
        defined = ~cells.at_centres(exact_flow.undefined_at(width, height))
        anti_parallel = np.zeros(seen.shape, dtype=bool)
        if exact_flow.cause is not None and ANTI_PARALLEL in exact_flow.causes:
            cause = replace(exact_flow, mask=exact_flow.cause == exact_flow.causes.index(ANTI_PARALLEL))
            anti_parallel = cells.at_centres(cause.mask_at(width, height))
        return ThreeRuns(
            recorded=recorded,
            exact_motion=exact_motion,
            exact_flow=exact_flow,
            evidence=Evidence(
                by_recorded=cells.at_centres(recorded.mask_at(width, height)),
                by_exact_flow=cells.at_centres(exact_flow.mask_at(width, height)),
                by_exact_motion=cells.at_centres(exact_motion.mask_at(width, height)),
                seen=seen if method.blind_at_epipole else seen & defined,
                defined=defined,
                below_horizon=self._below_horizon(exact, flow),
                anti_parallel=anti_parallel,
                visible=flow.visible,
                moving=np.isin(flow.instance_ids, moving),
            ),
            cell_size_px=self._cell_size_px,
            shown=self._shown,
            instance_ids=flow.instance_ids,
            flow_error_px=np.where(flow.visible, error_px, np.nan),
        )

    def _compare(self, flow: ExactFlow, ids: NDArray[np.uint16]) -> None:
        steps = (0,) if self._cell_size_px % 2 else (0, 1)  # an even cell's centre lies between four pixels
        padded, (height, width) = np.pad(ids, ((0, 1), (0, 1)), mode="edge"), ids.shape
        about = [self._cells.at_centres(padded[v : v + height, u : u + width]) for v in steps for u in steps]
        objects = self._shown & ((about[0] > 0) | (flow.instance_ids > 0))
        differing = objects & np.all([rendered != flow.instance_ids for rendered in about], axis=0)
        self._object_cells += int(np.count_nonzero(objects))
        self._differing_cells += int(np.count_nonzero(differing))

    def _below_horizon(self, exact: MethodInput, flow: ExactFlow) -> Cells:
        """The rays to both places of the point go below the horizon."""
        rays, _ = exact.camera.unproject((self._cells.pixels + flow.flow).reshape(-1, 2))
        rotated = exact.current_from_previous[-1].rotate(rays).reshape(self._cells.rays_camera.shape)
        with np.errstate(invalid="ignore"):
            return (rotated @ exact.road.down > 0) & (self._cells.rays_camera @ exact.road.down > 0)
