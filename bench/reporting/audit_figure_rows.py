"""Every number of an audit as a row."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from bench.harness.audit import AuditSummary, PolygonFigures, Quartiles


def figure_rows(audit: AuditSummary) -> Iterator[dict[str, object]]:
    """Every number of the audit as one row: table, slice, figure, value; ratios in [0, 1], NaN where there is none."""
    for p in audit.polygons:
        where = {"kind": p.kind, "compensation": p.compensation, "slice": p.object_class, "range_m": p.range_m}
        for name, part in _quartile_fields(p).items():
            for quartile in ("low", "median", "high"):
                yield {"table": "polygons", **where, "figure": f"{name}.{quartile}", "cases": p.object_frames,
                       "value": getattr(part, quartile)}  # fmt: skip
    for scoring, scores in audit.scores.items():
        for category, row in scores.categories.items():
            for name in row.figure_names():
                figure = row.figure(name)
                yield {"table": "scores", "kind": scoring, "slice": category, "figure": name, "cases": figure.cases,
                       "value": figure.value}  # fmt: skip
        coverage = scores.false_positives.coverage
        yield {"table": "scores", "kind": scoring, "slice": "false_positives", "figure": "coverage",
               "cases": coverage.cases, "value": coverage.value}  # fmt: skip
    for miss in audit.misses:
        counts = {"cells": miss.cells, "hit": miss.hit, "hit_by_error": miss.hit_by_error, **miss.causes}
        for name, count in counts.items():
            yield {"table": "misses", "slice": miss.category, "figure": name, "cases": miss.cells, "value": count}
    if audit.false_alarms is not None:
        counts = {"cells": audit.false_alarms.cells, "flagged": audit.false_alarms.flagged, **audit.false_alarms.causes}
        for name, count in counts.items():
            yield {"table": "false_alarms", "figure": name, "cases": audit.false_alarms.cells, "value": count}


def _quartile_fields(figures: PolygonFigures) -> Mapping[str, Quartiles]:
    names = [name for name, field in type(figures).model_fields.items() if field.annotation is Quartiles]
    return {name: getattr(figures, name) for name in names}
