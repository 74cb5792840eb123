"""Results of an audit, and its files.

```
<audit>/audit.json                 the metrics
<audit>/polygons.parquet           one row per object-frame, kind of polygon and compensation
<audit>/scores.parquet             one row per object-frame and scoring, integer counts
<audit>/misses.parquet             one row per object-frame: cells of its exact mask by cause
<audit>/false_alarms.parquet       one row per image: static cells by cause
```
"""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from bench.atomic import replacing
from bench.audit.recording import RecordingAudit
from bench.audit.sources import Part, StoredAudit
from bench.errors import DataError
from bench.evaluation import FalsePositiveMetrics, ObjectMetrics
from bench.evaluation.summary import ProtocolOfRun, Ratio
from bench.harness.method_of_run import MethodOfRun
from bench.recordings.checked_json import read_checked, write_checked

ALL = "all"
AUDIT, POLYGONS, MISSES = "audit.json", "polygons.parquet", "misses.parquet"


class Quartiles(Part):
    """The quarter, half and three quarters of the values lie below; NaN, null in JSON, without values."""

    low: Ratio
    median: Ratio
    high: Ratio


class PolygonFigures(Part):
    """Fit of the polygons of one slice; the measures are those of `RegionFit`.

    Attributes:
        kind: of polygon.
        compensation: of the motion between lidar and camera.
        object_class: or "all".
        range_m: bin, or "all".
        speed_mps: bin of the object's own speed, or "all".
        object_frames: how many.
    """

    kind: str
    compensation: str
    object_class: str
    range_m: str
    speed_mps: str
    object_frames: int
    iou: Quartiles
    area_error: Quartiles
    missing: Quartiles
    surplus: Quartiles
    boundary_px: Quartiles
    centroid_px: Quartiles
    filled_iou: Quartiles
    solid: Quartiles


class Aim(Part):
    """Target that a kind of polygon has to meet for a class.

    Attributes:
        kind: of polygon, with full compensation.
        object_class: of the objects, within `within_m`.
        within_m: range.
        object_frames: how many.
        median_iou: of them; NaN, null in JSON, without any.
        median_filled_iou: the same with masks whose holes are filled.
        expected: least median.
        met: whether it is; None without object-frames.
    """

    kind: str
    object_class: str
    within_m: float
    object_frames: int
    median_iou: Ratio
    median_filled_iou: Ratio
    expected: float
    met: bool | None


class Scores(Part):
    """The evaluation's metrics of one `Scoring`; `speeds` by bin of the object's own speed."""

    categories: dict[str, ObjectMetrics]
    speeds: dict[str, ObjectMetrics]
    all_moving: ObjectMetrics
    false_positives: FalsePositiveMetrics


class MissFigures(Part):
    """Cells of one kind of motion, on the exact masks.

    Attributes:
        category: or "all".
        object_frames: evaluated ones that fill a cell.
        cells: of them; equal to `hit + sum(causes.values())`.
        hit: found.
        hit_by_error: of `hit`, where the exact flow fires nothing: found through an error of flow or ego-motion.
        causes: cells that are missed, by `MissCause`.
        flow_error_px: median flow error on each object-frame's visible cells, px.
    """

    category: str
    object_frames: int
    cells: int
    hit: int
    hit_by_error: int
    causes: dict[str, int]
    flow_error_px: Quartiles

    @property
    def missed(self) -> int:
        """Cells that are not found."""
        return self.cells - self.hit


class FalseAlarmFigures(Part):
    """Cells of the static world.

    Attributes:
        images: that were looked at.
        cells: in V, on nothing that moves.
        flagged: of them; equal to `sum(causes.values())`.
        causes: by `FalseCause`.
        flow_error_px: median flow error on each image's visible static cells, px.
    """

    images: int
    cells: int
    flagged: int
    causes: dict[str, int]
    flow_error_px: Quartiles


class AuditSummary(StoredAudit):
    """`audit.json`.

    Attributes:
        method: whose detections are scored.
        protocol: that says which object-frames count.
        polygon_kinds: the protocol's own first.
        polygons: by kind, compensation, class and range.
        aims: for the kinds that are meant to follow the outline.
        not_seen: evaluated object-frames of which the camera sees no pixel; they are in none of the metrics.
        scores: by `Scoring`.
        misses: by kind of motion, then "all"; empty without exact flow.
        false_alarms: None without exact flow.
        left_out: why there is no exact flow; empty where there is.
    """

    method: MethodOfRun
    protocol: ProtocolOfRun
    polygon_kinds: tuple[str, ...]
    polygons: tuple[PolygonFigures, ...]
    aims: tuple[Aim, ...]
    not_seen: int
    scores: dict[str, Scores]
    misses: tuple[MissFigures, ...]
    false_alarms: FalseAlarmFigures | None
    left_out: str


def write_audit(folder: Path, summary: AuditSummary, audit: RecordingAudit) -> None:
    """Write every file of an audit, the metrics last."""
    tables = {
        POLYGONS: audit.polygons,
        "scores.parquet": _with_scoring(audit),
        MISSES: audit.misses,
        "false_alarms.parquet": audit.false_alarms,
    }
    for name, table in tables.items():
        with replacing(folder / name) as temporary:
            pq.write_table(table, temporary, compression="zstd")
    write_checked(folder / AUDIT, summary)


def read_audit(folder: Path) -> AuditSummary:
    """Read `audit.json`.

    Raises:
        DataError: missing, or not an audit of a known version; names the field.
    """
    return read_checked(AuditSummary, folder / AUDIT, expected="the metrics of an audit")


def read_polygons(folder: Path) -> pa.Table:
    """Read the rows of `POLYGONS_SCHEMA`.

    Raises:
        DataError: missing or damaged.
    """
    return _read_table(folder / POLYGONS)


def read_misses(folder: Path) -> pa.Table:
    """Read the rows of `MISSES_SCHEMA`.

    Raises:
        DataError: missing or damaged.
    """
    return _read_table(folder / MISSES)


def _read_table(file: Path) -> pa.Table:
    try:
        return pq.read_table(file)
    except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
        got = " ".join(str(error).split())[:200]
        raise DataError(file, expected="a table of an audit", got=got) from error


def _with_scoring(audit: RecordingAudit) -> pa.Table:
    return pa.concat_tables(
        objects.add_column(0, "scoring", pa.array([name] * len(objects), pa.string()))
        for name, (objects, _) in audit.scores.items()
    )
