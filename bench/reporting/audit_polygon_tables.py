"""How well the reference polygons fit: by class and range, against the aim, with less motion compensation."""

from __future__ import annotations

from bench.harness.audit import ALL, Aim, AuditSummary, Compensation, PolygonFigures
from bench.reporting.audit_sheet import AuditTable, decimal
from bench.reporting.sheets import Sheet

COMPENSATIONS = {
    Compensation.NONE: "none, a snapshot",
    Compensation.EGO_MOTION: "ego-motion",
    Compensation.FULL: "ego and object",
}


def polygon_table(audit: AuditSummary) -> AuditTable:
    """Every kind side by side, by class and range."""
    found = {(p.object_class, p.range_m, p.kind): p for p in audit.polygons if p.compensation == Compensation.FULL}
    places = list(dict.fromkeys((name, range_m) for name, range_m, _ in found))
    rows = []
    for name, range_m in places:
        cells = [_polygon_cells(found.get((name, range_m, kind))) for kind in audit.polygon_kinds]
        frames = max(p.object_frames for (n, r, _), p in found.items() if (n, r) == (name, range_m))
        limit = next(p.solid.median for (n, r, _), p in found.items() if (n, r) == (name, range_m))
        rows.append((name, range_m, str(frames), *(cell for part in cells for cell in part), f"{100 * limit:.0f}"))
    headings = [f"{kind} {what}" for kind in audit.polygon_kinds for what in ("IoU %", "area %")]
    return AuditTable(
        sheet=Sheet(
            title="How well the reference polygons cover what the camera sees",
            headings=("Class", "Range m", "Frames", *headings, "Filled IoU %"),
            rows=tuple(rows),
        ),
        note="IoU of each polygon, within V and less the nearer polygons, with the exact mask of its object: median "
        "(quartiles). Area: how much too large (+) or too small (-), median. Filled: IoU of the exact mask with its "
        "own filled outline, median: a polygon without holes does hardly better, and one sees through a bicycle. The "
        "object-frames are those that the protocol evaluates.",
        labels=2,
    )


def aim_table(audit: AuditSummary) -> AuditTable:
    """Which classes reach the aim."""
    return AuditTable(
        sheet=Sheet(
            title="The aim for polygons that follow the outline",
            headings=("Kind", "Class", "Frames", "Median IoU", "Aim", "Verdict", "IoU, filled"),
            rows=tuple(
                (a.kind, f"{a.object_class} within {a.within_m:g} m", str(a.object_frames), decimal(a.median_iou),
                 f">= {a.expected:.2f}", _verdict(a), decimal(a.median_filled_iou)) for a in audit.aims
            ),
        ),
        note="With full motion compensation. The convex hull is the paper's bounding polygon and has no aim. Filled: "
        "with the masks' holes filled, as annotators draw them.",
        labels=2,
    )  # fmt: skip


def compensation_table(audit: AuditSummary) -> AuditTable:
    """Every kind and compensation, by class."""
    found = {(p.kind, p.compensation, p.object_class): p for p in audit.polygons if p.range_m == ALL}
    classes = list(dict.fromkeys(name for _, _, name in found))
    rows = []
    for kind in audit.polygon_kinds:
        for compensation, label in COMPENSATIONS.items():
            parts = [found.get((kind, compensation.value, name)) for name in classes]
            cells = [
                text
                for part in parts
                for text in (("", "") if part is None else (decimal(part.iou.median), decimal(part.boundary_px.median)))
            ]
            rows.append((kind, label, *cells))
    headings = [f"{name} {what}" for name in classes for what in ("IoU", "edge px")]
    return AuditTable(
        sheet=Sheet(
            title="What motion compensation is worth",
            headings=("Kind", "Compensation", *headings),
            rows=tuple(rows),
        ),
        note="Medians over all ranges; edge: mean distance between the two outlines. Compensation: which motion "
        "between a lidar point and the exposure is undone; the last is what the benchmark does.",
        labels=2,
    )


def _polygon_cells(figures: PolygonFigures | None) -> tuple[str, str]:
    if figures is None:
        return "", ""
    iou = figures.iou
    spread = f"{100 * iou.median:.0f} ({100 * iou.low:.0f}-{100 * iou.high:.0f})"
    return spread, f"{100 * figures.area_error.median:+.0f}"


def _verdict(aim: Aim) -> str:
    return "no cases" if aim.met is None else "met" if aim.met else "NOT MET"
