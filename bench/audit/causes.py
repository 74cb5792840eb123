"""Causes of missed and of flagged cells, found by the method with exact flow and exact motion.

Of the three runs R, M and E (`three_runs`): what E does not find, the constraints cannot see; what E finds and M does
not, the flow has lost; what M finds and R does not, the ego-motion has. Each cell has one cause, the first that
applies, so that the shares add up to one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from bench.audit.sources import AuditSource, instance_ids
from bench.audit.three_runs import Cells, Evidence, ExactRunner, ThreeRuns
from bench.errors import UsageError
from bench.evaluation import Protocol
from bench.evaluation.rows import IMAGE, Row
from bench.harness.exact import moving_instances
from bench.harness.frames import FramePipeline
from bench.harness.stages import StageClock
from bench.methods import FlowMethod, Method
from bench.recordings import read_truth
from bench.reference import ReferenceFrame, Status

EXPLAINED = "as 'spherical' and 'rigid-scene' do"
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


BLIND = (MissCause.NEAR_EPIPOLE, MissCause.ENTERED, MissCause.ABOVE_HORIZON, MissCause.BELOW_THRESHOLD)


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


_IMAGE = [("recording", pa.string()), ("camera", pa.string()), ("timestamp_ns", pa.int64())]
# One row per evaluated object-frame: cells of its exact mask; `hit` plus the causes is `cells`. Of `hit`,
# `hit_by_error` are those where the exact flow fires nothing: an error of flow or ego-motion has found them.
MISSES_SCHEMA = pa.schema(
    [
        *_IMAGE,
        *[(name, pa.string()) for name in ("track_id", "object_class", "category")],
        ("range_m", pa.float64()),
        ("flow_error_px", pa.float64()),
        *[(name, pa.int64()) for name in ("cells", "hit", "hit_by_error", *MissCause)],
    ]
)
# One row per image: cells of the static world in V; `flagged` is the sum of the causes.
FALSE_ALARMS_SCHEMA = pa.schema(
    [*_IMAGE, ("flow_error_px", pa.float64()), *[(name, pa.int64()) for name in ("cells", "flagged", *FalseCause)]]
)


def miss_rows(runs: ThreeRuns, reference: ReferenceFrame, instance_of: Mapping[str, int]) -> list[Row]:
    """Rows of `MISSES_SCHEMA` of an image; objects that fill no cell's centre have none."""
    causes, found = miss_causes(runs.evidence), runs.evidence.by_recorded
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
            | {"cells": np.count_nonzero(cells), "hit": np.count_nonzero(cells & found)}
            | {"hit_by_error": np.count_nonzero(cells & found & ~runs.evidence.by_exact_flow)}
            | _counted(causes[cells & ~found], MissCause)
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExplainedImage:
    """An image and its cells.

    Attributes:
        pixels: (H, W) grey uint8.
        cell_size_px: side of a cell.
        hit: (rows, columns) bool, cells of evaluated objects that are found.
        missed: by cause, (rows, columns) bool.
        flagged: by cause, (rows, columns) bool.
    """

    pixels: NDArray[np.uint8]
    cell_size_px: int
    hit: NDArray[np.bool_]
    missed: dict[MissCause, NDArray[np.bool_]]
    flagged: dict[FalseCause, NDArray[np.bool_]]


def explain_image(
    source: AuditSource, *, camera: str, timestamp_ns: int, method: Method, protocol: Protocol
) -> ExplainedImage:
    """Explain one image of a recording, as the audit did.

    Raises:
        DataError: something of the recording cannot be read.
        UsageError: the recording has no scene to simulate, or the method takes no flow from outside.
    """
    if not isinstance(method, FlowMethod):
        raise UsageError(f"explain: expected a method that takes flow from outside, {EXPLAINED}, got {method.name!r}")
    if source.exact is None or source.scene is None:
        raise UsageError(f"recording {source.recorded.name!r}: expected a scene that can be simulated, got none")
    recording, true_camera = source.recorded.open(), source.exact.open().cameras[camera]
    pipeline = FramePipeline(recording, camera, method=method, protocol=protocol)
    index = [image.timestamp_ns for image in pipeline.images].index(timestamp_ns)
    runner = ExactRunner(source, true_camera, valid=pipeline.references.valid, method=method, clock=StageClock())
    given, reference = pipeline.method_input(index), pipeline.reference(index)
    ids = read_truth(pipeline.images[index], pipeline.camera)
    runs = runner.run(given, ids, moving=moving_instances(recording, reference))
    instance_of, found = instance_ids(recording), runs.evidence.by_recorded
    evaluated = [instance_of[item.track_id] for item in reference.objects if item.status is Status.EVALUATED]
    own = runs.shown & np.isin(runs.instance_ids, evaluated)
    missed, false = own & ~found, runs.shown & ~runs.evidence.moving & found
    why_missed, why_false = miss_causes(runs.evidence), false_causes(runs.evidence, cell_size_px=runs.cell_size_px)
    return ExplainedImage(
        pixels=given.images[-1],
        cell_size_px=runs.cell_size_px,
        hit=own & found,
        missed={cause: missed & (why_missed == number) for number, cause in enumerate(MissCause)},
        flagged={cause: false & (why_false == number) for number, cause in enumerate(FalseCause)},
    )
