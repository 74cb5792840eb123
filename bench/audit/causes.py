"""Causes of missed and of flagged cells, found by the method with exact flow and exact motion.

Any `FlowMethod` can be asked. It is run three times on a pair of images: as in the benchmark (R), with the exact
ego-motion and calibration in place of the recorded ones (M), and with the exact flow as well (E). What E does not find,
the constraints cannot see; what E finds and M does not, the flow has lost; what M finds and R does not, the ego-motion
has. Each cell has one cause, the first that applies, so that the shares add up to one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from bench.audit.sources import AuditSource, ExactPair, SimulatedTruth, instance_ids
from bench.errors import UsageError
from bench.evaluation import Protocol
from bench.harness.exact import moving_instances
from bench.harness.frames import FramePipeline
from bench.methods import FlowMethod, Method, MethodInput, Segmentation, ask_method
from bench.methods.cells import flow_rays
from bench.recordings import read_truth
from bench.reference import ReferenceFrame, Status

Cells = NDArray[np.bool_]
Cause = TypeVar("Cause", bound=StrEnum)
ANTI_PARALLEL = "anti_parallel"
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


def miss_causes(evidence: Evidence) -> NDArray[np.int64]:
    """Index into `MissCause` of each cell, (rows, columns); it means something where R does not fire."""
    blind = ~evidence.by_exact_flow
    lost = ~evidence.by_exact_motion
    return _first(
        MissCause,
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
        FalseCause,
        {
            FalseCause.ANTI_PARALLEL: evidence.by_exact_flow & evidence.anti_parallel,
            FalseCause.OTHER_CONSTRAINT: evidence.by_exact_flow,
            FalseCause.UNCOVERED: evidence.by_exact_motion & ~evidence.visible,
            FalseCause.BESIDE_OBJECT: evidence.by_exact_motion & beside,
            FalseCause.FLOW: evidence.by_exact_motion,
        },
        otherwise=FalseCause.EGO_MOTION,
    )


def _first(kinds: type[Cause], where: Mapping[Cause, Cells], *, otherwise: Cause) -> NDArray[np.int64]:
    order = list(kinds)
    return np.select(list(where.values()), [order.index(kind) for kind in where], default=order.index(otherwise))


Row = dict[str, Any]

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThreeRuns:
    """The method on one pair of images, three times.

    Attributes:
        recorded: as in the benchmark.
        exact_motion: with exact ego-motion and calibration.
        exact_flow: with exact flow as well.
        evidence: what they say of each cell; `moving` is every object that is evaluated or ignored.
        flow_error_px: (rows, columns) float64, of the estimated flow; NaN where the point was not visible before.
    """

    recorded: Segmentation
    exact_motion: Segmentation
    exact_flow: Segmentation
    evidence: Evidence
    flow_error_px: NDArray[np.float64]


def run_three_times(
    method: FlowMethod, given: MethodInput, exact: ExactPair, *, moving_ids: NDArray[np.int64]
) -> ThreeRuns:
    """Run the method on recorded and exact input.

    Args:
        method: to be explained.
        given: its input as recorded.
        exact: what is exactly known.
        moving_ids: instance ids of the objects that move.
    """
    exact_given, cells, true = exact.given, exact.cells, exact.flow.flow.astype(np.float32)
    recorded, exact_motion = ask_method(method, given), ask_method(method, exact_given)
    exact_flow = method.segment_flow(exact_given, true)
    error_px = np.linalg.norm(method.mean_flow(given) - exact.flow.flow, axis=-1)

    height, width = given.valid.shape
    _, seen = flow_rays(exact_given, cells, true)
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
            below_horizon=exact.below_horizon,
            anti_parallel=anti_parallel,
            visible=exact.flow.visible,
            moving=np.isin(exact.flow.instance_ids, moving_ids),
        ),
        flow_error_px=np.where(exact.flow.visible, error_px, np.nan),
    )


def miss_rows(
    runs: ThreeRuns, exact: ExactPair, reference: ReferenceFrame, instance_of: Mapping[str, int]
) -> list[Row]:
    """Rows of `MISSES_SCHEMA` of an image; objects that fill no cell's centre have none."""
    causes, shown, found = miss_causes(runs.evidence), _shown(reference, exact), runs.evidence.by_recorded
    rows = []
    for item in reference.objects:
        cells = shown & (exact.flow.instance_ids == instance_of[item.track_id])
        if item.status is not Status.EVALUATED or not cells.any():
            continue
        assert item.category is not None, "what is evaluated has a category"
        rows.append(
            _image(reference)
            | {"track_id": item.track_id, "object_class": item.object_class, "category": item.category.value}
            | {"range_m": item.range_m, "flow_error_px": _median(runs.flow_error_px[cells])}
            | {"cells": _count(cells), "hit": _count(cells & found)}
            | {"hit_by_error": _count(cells & found & ~runs.evidence.by_exact_flow)}
            | _counted(causes[cells & ~found], [cause.value for cause in MissCause])
        )
    return rows


def false_row(runs: ThreeRuns, exact: ExactPair, reference: ReferenceFrame) -> Row:
    """The row of `FALSE_ALARMS_SCHEMA` of an image."""
    causes = false_causes(runs.evidence, cell_size_px=exact.cells.cell_size_px)
    static = _shown(reference, exact) & ~runs.evidence.moving
    flagged = static & runs.evidence.by_recorded
    return (
        _image(reference)
        | {"flow_error_px": _median(runs.flow_error_px[static])}
        | {"cells": _count(static), "flagged": _count(flagged)}
        | _counted(causes[flagged], [cause.value for cause in FalseCause])
    )


def _shown(reference: ReferenceFrame, exact: ExactPair) -> NDArray[np.bool_]:
    return exact.cells.at_centres(reference.valid)


def _image(reference: ReferenceFrame) -> Row:
    return {
        "recording": reference.recording,
        "camera": reference.camera,
        "timestamp_ns": reference.timestamp_ns,
    }


def _count(cells: NDArray[np.bool_]) -> int:
    return int(np.count_nonzero(cells))


def _counted(causes: NDArray[np.int64], names: list[str]) -> Row:
    return dict(zip(names, np.bincount(causes, minlength=len(names)).tolist(), strict=True))


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
    if source.exact is None or source.scenario is None or source.spec is None:
        raise UsageError(f"recording {source.recorded.name!r}: expected a scene that can be simulated, got none")
    recording, exact_recording = source.recorded.open(), source.exact.open()
    pipeline = FramePipeline(recording, camera, method=method, protocol=protocol)
    index = [image.timestamp_ns for image in pipeline.images].index(timestamp_ns)
    valid = pipeline.references.valid
    simulated = SimulatedTruth(source, exact_recording.cameras[camera], valid=valid, method=method)
    cell_size_px = simulated.cells.cell_size_px
    given = pipeline.method_input(index)
    exact = simulated.look(given, read_truth(pipeline.images[index], pipeline.camera))
    instance_of = instance_ids({track.track_id: track.instance_id for track in recording.tracks})
    reference = pipeline.references.build(pipeline.images[index])
    moving = moving_instances(recording, reference)
    evaluated = [instance_of[o.track_id] for o in reference.objects if o.status is Status.EVALUATED]
    runs = run_three_times(method, given, exact, moving_ids=np.array(moving, dtype=np.int64))
    shown = simulated.cells.at_centres(valid)
    own = shown & np.isin(exact.flow.instance_ids, evaluated)
    found = runs.evidence.by_recorded
    missed, false = own & ~found, shown & ~runs.evidence.moving & found
    why_missed, why_false = miss_causes(runs.evidence), false_causes(runs.evidence, cell_size_px=cell_size_px)
    return ExplainedImage(
        pixels=given.images[-1],
        cell_size_px=cell_size_px,
        hit=own & found,
        missed={cause: missed & (why_missed == number) for number, cause in enumerate(MissCause)},
        flagged={cause: false & (why_false == number) for number, cause in enumerate(FalseCause)},
    )
