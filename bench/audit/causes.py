"""Causes of missed and of flagged cells: a method on one pair of images, run three times.

The scene is simulated again from the scenario that rendered the recording. Any `FlowMethod` can be asked: as in the
benchmark (R), with the exact ego-motion and calibration in place of the recorded ones (M), and with the exact flow as
well (E). What E does not find, the constraints cannot see; what E finds and M does not, the flow has lost; what M finds
and R does not, the ego-motion has. Each cell has one cause, the first that applies, so that the shares add up to one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import pairwise

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from bench.audit.sources import AuditSource
from bench.cameras.model import ray_grid
from bench.evaluation.rows import IMAGE, IMAGE_COLUMNS, Row
from bench.methods import FlowMethod, MethodInput, Segmentation, ask_method
from bench.methods.two_views import flow_rays
from bench.recordings import MountedCamera
from bench.records.reference import ReferenceFrame, Status
from bench.synthesis.exact_flow import ExactFlow, ExactFlowCaster
from bench.synthesis.scene import build_scene

Cells = NDArray[np.bool_]
ANTI_PARALLEL = "anti_parallel"


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
    """

    def __init__(
        self, source: AuditSource, camera: MountedCamera, *, valid: NDArray[np.bool_], method: FlowMethod
    ) -> None:
        assert source.scene is not None, "the recording can be simulated"
        scenario, spec = source.scene
        self._camera, self._method = camera, method
        self._cell_size_px = method.flow_cell_px(valid.shape[1])
        self._cells = ray_grid(camera.model, self._cell_size_px)
        self._shown = self._cells.at_centres(valid)
        self._caster = ExactFlowCaster(
            build_scene(scenario, spec), camera, valid=valid, cell_size_px=self._cell_size_px
        )

    def run(self, given: MethodInput, *, moving: Sequence[int]) -> ThreeRuns:
        """Ask the method three times.

        Args:
            given: its input as recorded.
            moving: instance ids of the objects that move.
        """
        method, cells, exact = self._method, self._cells, self._with_exact_motion(given)
        flow = self._caster.flow(current_ns=given.timestamps_ns[-1], previous_ns=given.timestamps_ns[-2])
        true = flow.flow.astype(np.float32)
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

    def _with_exact_motion(self, given: MethodInput) -> MethodInput:
        """The input with the true calibration, road and ego-motion."""
        motions = (
            self._caster.motion(current_ns=later_ns, previous_ns=earlier_ns)
            for earlier_ns, later_ns in pairwise(given.timestamps_ns)
        )
        road = self._caster.road(given.timestamps_ns[-1])
        return replace(given, camera=self._camera.model, road=road, current_from_previous=tuple(motions))

    def _below_horizon(self, exact: MethodInput, flow: ExactFlow) -> Cells:
        """The rays to both places of the point go below the horizon."""
        rays, _ = exact.camera.unproject((self._cells.pixels + flow.flow).reshape(-1, 2))
        rotated = exact.current_from_previous[-1].rotate(rays).reshape(self._cells.rays_camera.shape)
        with np.errstate(invalid="ignore"):
            return (rotated @ exact.road.down > 0) & (self._cells.rays_camera @ exact.road.down > 0)


BESIDE_PX = 15  # a flow window's width: as far as an object's motion bleeds into its surroundings


class MissCause(StrEnum):
    """Reason that a cell of a moving object is not found."""

    NEAR_EPIPOLE = "near_epipole"  # blind: no deviation is defined there
    ENTERED = "entered"  # blind: what it shows was outside of the previous image
    ABOVE_HORIZON = "above_horizon"  # blind: in the epipolar plane, and above the horizon no height constraint holds
    BELOW_THRESHOLD = "below_threshold"  # blind: in the epipolar plane, or too slow, where every constraint holds
    UNCOVERED = "uncovered"  # flow: what it shows was hidden in the previous image
    FLOW = "flow"  # flow: it was in view and the flow is wrong
    EGO_MOTION = "ego_motion"  # ego-motion or calibration


class FalseCause(StrEnum):
    """Reason that a cell of the static world is flagged."""

    ANTI_PARALLEL = "anti_parallel"  # the paper's own: a static point between the road and the camera's height
    OTHER_CONSTRAINT = "other_constraint"  # another constraint fires by the exact flow
    UNCOVERED = "uncovered"  # flow: what it shows was hidden in the previous image
    BESIDE_OBJECT = "beside_object"  # flow: an object's motion bleeds out
    FLOW = "flow"  # flow, elsewhere
    EGO_MOTION = "ego_motion"  # ego-motion or calibration


def miss_causes(evidence: Evidence) -> NDArray[np.int64]:
    """Index into `MissCause` of each cell, (rows, columns); it means something where R does not fire."""
    blind = ~evidence.by_exact_flow
    lost = ~evidence.by_exact_motion
    return _first(
        {
            MissCause.ENTERED: blind & ~evidence.seen,
            MissCause.NEAR_EPIPOLE: blind & ~evidence.defined,
            MissCause.ABOVE_HORIZON: blind & ~evidence.below_horizon,
            MissCause.BELOW_THRESHOLD: blind,
            MissCause.UNCOVERED: lost & ~evidence.visible,
            MissCause.FLOW: lost,
        },
        otherwise=MissCause.EGO_MOTION,
    )


def false_causes(evidence: Evidence, *, cell_size_px: int) -> NDArray[np.int64]:
    """Index into `FalseCause` of each cell, (rows, columns); it means something where R fires on the static world."""
    reach = -(-BESIDE_PX // cell_size_px)
    beside = binary_dilation(evidence.moving, structure=np.ones((3, 3), dtype=bool), iterations=reach)
    return _first(
        {
            FalseCause.ANTI_PARALLEL: evidence.by_exact_flow & evidence.anti_parallel,
            FalseCause.OTHER_CONSTRAINT: evidence.by_exact_flow,
            FalseCause.UNCOVERED: evidence.by_exact_motion & ~evidence.visible,
            FalseCause.BESIDE_OBJECT: evidence.by_exact_motion & beside,
            FalseCause.FLOW: evidence.by_exact_motion,
        },
        otherwise=FalseCause.EGO_MOTION,
    )


def _first(where: Mapping[StrEnum, Cells], *, otherwise: StrEnum) -> NDArray[np.int64]:
    order = list(type(otherwise))
    return np.select(list(where.values()), [order.index(kind) for kind in where], default=order.index(otherwise))


# One row per evaluated object-frame: cells of its exact mask; `hit` plus the causes is `cells`. Of `hit`,
# `hit_by_error` are those where the exact flow fires nothing: an error of flow or ego-motion has found them.
MISSES_SCHEMA = pa.schema(
    [
        *IMAGE_COLUMNS,
        *[(name, pa.string()) for name in ("track_id", "object_class", "category")],
        ("range_m", pa.float64()),
        ("flow_error_px", pa.float64()),
        *[(name, pa.int64()) for name in ("cells", "hit", "hit_by_error", *MissCause)],
    ]
)
# One row per image: cells of the static world in V; `flagged` is the sum of the causes.
FALSE_ALARMS_SCHEMA = pa.schema(
    [
        *IMAGE_COLUMNS,
        ("flow_error_px", pa.float64()),
        *[(name, pa.int64()) for name in ("cells", "flagged", *FalseCause)],
    ]
)


def miss_rows(runs: ThreeRuns, reference: ReferenceFrame, instance_of: Mapping[str, int]) -> list[Row]:
    """Rows of `MISSES_SCHEMA` of an image; objects that fill no cell's centre have none."""
    causes, marked = miss_causes(runs.evidence), runs.evidence.by_recorded
    rows = []
    for item in reference.objects:
        cells = runs.shown & (runs.instance_ids == instance_of[item.track_id])
        if item.status is not Status.EVALUATED or not cells.any():
            continue
        assert item.category is not None, "what is evaluated has a category"
        rows.append(
            {name: getattr(reference, name) for name in IMAGE}
            | {"track_id": item.track_id, "object_class": item.object_class, "category": item.category.value}
            | {"range_m": item.range_m, "flow_error_px": _median(runs.flow_error_px[cells])}
            | {"cells": np.count_nonzero(cells), "hit": np.count_nonzero(cells & marked)}
            | {"hit_by_error": np.count_nonzero(cells & marked & ~runs.evidence.by_exact_flow)}
            | _counted(causes[cells & ~marked], MissCause)
        )
    return rows


def false_row(runs: ThreeRuns, reference: ReferenceFrame) -> Row:
    """The row of `FALSE_ALARMS_SCHEMA` of an image."""
    causes = false_causes(runs.evidence, cell_size_px=runs.cell_size_px)
    static = runs.shown & ~runs.evidence.moving
    flagged = static & runs.evidence.by_recorded
    return (
        {name: getattr(reference, name) for name in IMAGE}
        | {"flow_error_px": _median(runs.flow_error_px[static])}
        | {"cells": np.count_nonzero(static), "flagged": np.count_nonzero(flagged)}
        | _counted(causes[flagged], FalseCause)
    )


def _counted(causes: NDArray[np.int64], kinds: type[StrEnum]) -> Row:
    return dict(zip(kinds, np.bincount(causes, minlength=len(kinds)).tolist(), strict=True))


def _median(values: NDArray[np.float64]) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")
