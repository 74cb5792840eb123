"""The cells of an image by cause: missed ones per object, false ones per image."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bench.cameras import ray_grid
from bench.harness.audit.causes import Evidence, FalseCause, MissCause, false_causes, miss_causes
from bench.harness.audit.staged import ExactPair, at_centres
from bench.methods import MethodInput, Segmentation
from bench.methods.spherical.likelihood import CONSTRAINTS
from bench.methods.spherical.method import SphericalMethod
from bench.reference import ReferenceFrame, Status

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
    method: SphericalMethod, given: MethodInput, exact: ExactPair, *, moving_ids: NDArray[np.int64]
) -> ThreeRuns:
    """Run the method on recorded and exact input; the flow is estimated once.

    Args:
        method: to be explained.
        given: its input as recorded.
        exact: what is exactly known.
        moving_ids: instance ids of the objects that move.
    """
    estimated, true = method.mean_flow(given), exact.flow.flow.astype(np.float32)
    recorded = method.judge(method.measure(given, estimated))
    exact_motion = method.judge(method.measure(exact.given, estimated))
    measured = method.measure(exact.given, true)
    exact_flow = method.judge(measured)
    cause = exact_flow.cause
    assert cause is not None, "the method names its causes"
    anti_parallel = exact_flow.causes == CONSTRAINTS
    error_px = np.linalg.norm(estimated - exact.flow.flow, axis=-1)
    return ThreeRuns(
        recorded=recorded,
        exact_motion=exact_motion,
        exact_flow=exact_flow,
        evidence=Evidence(
            by_exact_flow=exact_flow.mask,
            by_exact_motion=exact_motion.mask,
            seen=measured.seen,
            defined=measured.defined,
            below_horizon=exact.below_horizon,
            anti_parallel=(cause == CONSTRAINTS.index("anti_parallel")) & anti_parallel,
            visible=exact.flow.visible,
            moving=np.isin(exact.flow.instance_ids, moving_ids),
        ),
        flow_error_px=np.where(exact.flow.visible, error_px, np.nan),
    )


def miss_rows(
    runs: ThreeRuns, exact: ExactPair, reference: ReferenceFrame, instance_of: Mapping[str, int]
) -> list[Row]:
    """Rows of `MISSES_SCHEMA` of an image; objects that fill no cell's centre have none."""
    causes, shown = miss_causes(runs.evidence), _shown(reference, exact, runs)
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
            | {"cells": _count(cells), "hit": _count(cells & runs.recorded.mask)}
            | {"hit_by_error": _count(cells & runs.recorded.mask & ~runs.exact_flow.mask)}
            | _counted(causes[cells & ~runs.recorded.mask], [cause.value for cause in MissCause])
        )
    return rows


def false_row(runs: ThreeRuns, exact: ExactPair, reference: ReferenceFrame) -> Row:
    """The row of `FALSE_ALARMS_SCHEMA` of an image."""
    causes = false_causes(runs.evidence, cell_size_px=runs.recorded.cell_size_px)
    static = _shown(reference, exact, runs) & ~runs.evidence.moving
    flagged = static & runs.recorded.mask
    return (
        _image(reference)
        | {"flow_error_px": _median(runs.flow_error_px[static])}
        | {"cells": _count(static), "flagged": _count(flagged)}
        | _counted(causes[flagged], [cause.value for cause in FalseCause])
    )


def _shown(reference: ReferenceFrame, exact: ExactPair, runs: ThreeRuns) -> NDArray[np.bool_]:
    cells = ray_grid(exact.given.camera, runs.recorded.cell_size_px)
    return np.asarray(at_centres(reference.valid, cells), dtype=bool)


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
