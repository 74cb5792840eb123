"""Does the lidar reference rank methods as the truth does: tables, and each row's scores by one over the other."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.audit.predictions import ALL_PREDICTIONS, OBJECTS, OUTLINES
from bench.audit.ranking import (
    KINDS,
    LARGEST_DIFFERENCE,
    LARGEST_REAL_DIFFERENCE,
    LEAST_TAU,
    RANKING,
    Agreement,
    Estimate,
    KindAgreement,
    RankedRow,
    RankingSummary,
    read_ranking,
)
from bench.audit.ranking_sums import EXACT, FALSE_POSITIVES, REFERENCES
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.sums import ALL_MOVING
from bench.reference import Category
from bench.reporting import canvas, document, formats
from bench.reporting.audit_tables import decimal, sections
from bench.reporting.document import Block, Code, Heading, Paragraph, Picture, Table

NAMES = dict(
    zip(
        REFERENCES,
        ("convex hull (paper-v1)", "concave hull", "surface patches", "surface-v1", "exact masks"),
        strict=True,
    )
)
LIDAR = REFERENCES[:-1]
MARKERS = dict(zip(LIDAR, ("o", "s", "^", "D"), strict=True))
COLOURS = dict(zip(LIDAR, (canvas.ORANGE, canvas.SKY_BLUE, canvas.GREEN, canvas.VERMILION), strict=True))
ERRORS = {OUTLINES: "outline errors", OBJECTS: "errors of whole objects or parts"}
FILLS = {OUTLINES: "none", OBJECTS: "left"}  # of the markers; real methods are filled
OTHERS = {"tpr": "TPR", "detection_rate_50": "Detection at 50 %"}


def row_label(name: str) -> str:
    """Return the name of a row in tables and pictures."""
    others = {ALL_MOVING: "All moving", FALSE_POSITIVES: "False positives"}
    return others.get(name) or formats.LABELS[Category(name)]


def overview_table(ranking: RankingSummary) -> Table:
    """One line per lidar reference."""
    rows = []
    for reference in LIDAR:
        differences = [100 * ranking.mean_difference(reference, real=real) for real in (False, True)]
        taus = [decimal(row.agreement[reference].tau.value) for row in ranking.rows]
        checks = [check for row in ranking.rows for check in row.checks if check.reference == reference]
        wins = f"{sum(not check.holds for check in checks)} of {len(checks)}"
        aims = "; ".join(ranking.misses(reference)) or "none"
        rows.append((NAMES[reference], *(f"{value:.1f}" for value in differences), *taus, wins, aims))
    taus = [f"tau {row_label(row.name).lower()}" for row in ranking.rows]
    return Table(
        title="Agreement with the exact masks",
        columns=("Reference", "IoU points, all", "real methods", *taus, "Wrong masks win", "Aims missed"),
        rows=rows,
        note="Points: mean absolute difference of IoU from the score against exact masks, over the predictions and the "
        "kinds of motion. Tau: Kendall's tau-b of the two orders of the predictions, by IoU, of false positives by "
        f"their area. The aims: tau of at least {LEAST_TAU} in every row with at least {FEWEST_RECORDINGS} recordings, "
        f"at most {100 * LARGEST_DIFFERENCE:g} points over all predictions and {100 * LARGEST_REAL_DIFFERENCE:g} over "
        "real methods. Wrong masks: how often one that is made of the exact masks scores more than these.",
    )


def kind_table(ranking: RankingSummary) -> Table:
    """Agreement by kind of error, one line per row and lidar reference; then means over the kinds of motion."""
    rows = [
        (
            *(row_label(row.name), NAMES[reference]),
            *_kind_cells([found.by_kind.get(kind) for kind in KINDS]),
            decimal(found.tau_between),
        )
        for row in ranking.rows
        for reference, found in row.agreement.items()
    ]
    rows += [
        ("Mean of kinds", NAMES[name], *_kind_cells([ranking.mean_of_motion(name, kind) for kind in KINDS]), "")
        for name in LIDAR
    ]
    headings = [heading for kind in KINDS for heading in (f"Tau {kind}", f"{kind.capitalize()}, points")]
    return Table(
        title="Masks that are wrong in known ways, by kind of error",
        columns=("Type", "Reference", *headings, "Tau between"),
        rows=rows,
        note="Outlines: " + _names(ranking, OUTLINES) + ". Objects, or parts of them, lack or are added: "
        + _names(ranking, OBJECTS) + ". Tau: of these masks and the exact one; between: of the pairs of two masks with "
        "errors of different kinds. Points: mean of IoU by the lidar reference less IoU by exact masks; positive where "
        "the errors cost too little. In the row of false positives: their area.",
        words=2,
    )  # fmt: skip


def _kind_cells(found: Sequence[KindAgreement | None]) -> list[str]:
    return [
        cell
        for one in found
        for cell in (("", "") if one is None else (decimal(one.tau), _signed_points(one.signed_difference)))
    ]


def _signed_points(difference: float) -> str:
    return "n/a" if math.isnan(difference) else f"{100 * difference:+.1f}"


def _names(ranking: RankingSummary, kind: str) -> str:
    names = [name.removeprefix("truth:") for name in ranking.predictions if ranking.errors.get(name) == kind]
    return ", ".join(names) or "none"


def agreement_table(ranking: RankingSummary) -> Table:
    """Order and IoU, one line per row and lidar reference, with intervals."""
    rows = [
        (
            *(row_label(row.name), NAMES[reference], _recordings(row), str(row.cases), _tau(found.tau)),
            *(_points(part[metric]) for part in _both(found)),
        )
        for row in ranking.rows
        for reference, found in row.agreement.items()
        for metric in list(found.difference)[:1]
    ]
    return Table(
        title="Order, and differences of IoU in points",
        columns=("Type", "Reference", "Recordings", "Frames", "Tau", "All", "Real methods"),
        rows=rows,
        note="Mean absolute differences from the scores against exact masks, over all predictions, and over the real "
        "methods, that is those that are not made of the exact masks; of false positives: of their area. In brackets "
        f"95 % intervals from draws of whole recordings; rows of fewer than {FEWEST_RECORDINGS} recordings have none.",
        words=2,
    )


def difference_table(ranking: RankingSummary) -> Table:
    """The other metrics, one line per row and lidar reference."""
    rows = [
        (
            *(row_label(row.name), NAMES[reference]),
            *(formats.hundredths(part[metric].value) for metric in OTHERS for part in _both(found)),
        )
        for row in ranking.rows
        if row.name != FALSE_POSITIVES
        for reference, found in row.agreement.items()
    ]
    metrics = [heading for name in OTHERS.values() for heading in (name, f"{name}, real methods")]
    return Table(
        title="Differences of the other metrics, in points",
        columns=("Type", "Reference", *metrics),
        rows=rows,
        note="As above. TPR: over detected object-frames.",
        words=2,
    )


def _both(found: Agreement) -> tuple[dict[str, Estimate], dict[str, Estimate]]:
    return found.difference, found.difference_real


def ceiling_table(ranking: RankingSummary) -> Table:
    """Scores of the exact masks, and the unknown share of the objects; one line per row."""
    rows = []
    for row in ranking.rows:
        if row.name == FALSE_POSITIVES:
            continue
        iou = row.scores["iou"]
        cells = [formats.hundredths(iou[name][ranking.ceiling]) if ranking.ceiling else "" for name in LIDAR]
        rows.append(
            (row_label(row.name), _recordings(row), str(row.cases), *cells, formats.hundredths(row.unknown_share))
        )
    return Table(
        title="Ceiling: IoU of the exact masks, in percent",
        columns=("Type", "Recordings", "Frames", *(NAMES[name] for name in LIDAR), "Unknown share"),
        rows=rows,
        note="Unknown share: mean share of an object-frame's possible pixels in which surface-v1 counts nothing.",
    )


def fit_table(ranking: RankingSummary) -> Table:
    """Correctness of the regions of surface-v1, one line per slice."""
    rows = [
        (fit.object_class, fit.range_m, fit.ego_speed_mps, str(fit.object_frames),
         *(formats.hundredths(share) for share in (fit.core_outside, fit.left_out, fit.unknown_share)))
        for fit in ranking.fits
    ]  # fmt: skip
    return Table(
        title="Core, band and exact mask of surface-v1, in percent",
        columns=("Class", "Range m", "Ego m/s", "Frames", "Core outside mask", "Mask left out", "Unknown share"),
        rows=rows,
        note="Core outside mask: of the cores' pixels. Mask left out: of the exact masks, in neither core nor "
        "band. Unknown share: mean over the object-frames.",
        words=3,
    )


def check_table(ranking: RankingSummary) -> Table:
    """Masks that are wrong by construction and beat the exact one somewhere, one line per row and mask."""
    rows: dict[tuple[str, str], dict[str, str]] = {}
    for row in ranking.rows:
        for check in row.checks:
            iou = f"{formats.hundredths(check.iou)} : {formats.hundredths(check.exact_iou)}"
            cells = rows.setdefault((row_label(row.name), check.prediction), {})
            cells[check.reference] = iou if check.holds else f"WINS {iou}"
    won = {key: cells for key, cells in rows.items() if any("WINS" in cell for cell in cells.values())}
    return Table(
        title="Wrong masks that beat the exact one",
        columns=("Type", "Mask", *NAMES.values()),
        rows=[(*key, *(cells[reference] for reference in NAMES)) for key, cells in won.items()],
        note=f"IoU of the mask : IoU of the exact mask, in percent. {len(rows) - len(won)} of {len(rows)} masks and "
        "rows are left out, in which the exact mask scores at least as much by every reference.",
        words=2,
    )


def score_table(row: RankedRow) -> Table:
    """Every prediction's score in one row, the best by the exact masks first."""
    metric = "false_positive_share" if row.name == FALSE_POSITIVES else "iou"
    scores = row.scores[metric]
    order = sorted(scores[EXACT], key=lambda name: _last_if_nan(scores[EXACT][name]))
    lines = [(name, *(formats.hundredths(scores[reference][name]) for reference in REFERENCES)) for name in order]
    what = "area of false positives" if row.name == FALSE_POSITIVES else "IoU"
    return Table(
        title=f"{row_label(row.name)}: {what}, in percent",
        columns=("Prediction", *NAMES.values()),
        rows=lines,
        note=f"{row.cases} frames of {row.recordings} recordings.",
    )


def _last_if_nan(score: float) -> float:
    return math.inf if math.isnan(score) else -score


def _recordings(row: RankedRow) -> str:
    return str(row.recordings) if row.recordings >= FEWEST_RECORDINGS else f"{row.recordings} (too few)"


def _tau(found: Estimate) -> str:
    return f"{decimal(found.value)} {formats.interval(found.ci95, unit=1.0, digits=2)}".rstrip()


def _points(found: Estimate) -> str:
    return f"{formats.hundredths(found.value)} {formats.interval(found.ci95)}".rstrip()


def ranking_tables(ranking: RankingSummary) -> tuple[Table, ...]:
    """The tables that are printed."""
    tables = [overview_table(ranking), agreement_table(ranking), ceiling_table(ranking), fit_table(ranking)]
    return (*tables, kind_table(ranking), check_table(ranking)) if ranking.errors else tuple(tables)


def report(ranking: RankingSummary) -> Iterator[Block]:
    """All tables with their notes."""
    yield Heading(f"Does the lidar reference of {ranking.dataset} rank methods as the truth does?", 1)
    yield Paragraph(
        f"{len(ranking.predictions)} predictions, {len(ranking.real)} of them real methods, against four lidar "
        f"references and the exact masks, over the same object-frames of {ranking.images} images of "
        f"{ranking.recordings} recordings. Made by:"
    )
    yield Code(_command(ranking))
    yield Picture("ranking.png", "Scores against lidar references over scores against exact masks")
    scores = (score_table(row) for row in ranking.rows if row.cases)
    yield from sections((*ranking_tables(ranking), difference_table(ranking), *scores))


def _command(ranking: RankingSummary) -> str:
    methods = "all" if ranking.predictions == ALL_PREDICTIONS else ",".join(ranking.predictions)
    split = "" if ranking.split is None else f" --split {ranking.split}"
    return f"fisheye-bench audit {ranking.card} --recordings {ranking.recordings}{split} --methods {methods}"


def to_csv(ranking: RankingSummary) -> str:
    """One line per number, at full precision; empty where there is none."""
    columns = ["table", "row", "reference", "prediction", "metric", "recordings", "cases", "value", "low", "high"]
    return document.to_csv(_csv_rows(ranking), columns)


def _csv_rows(ranking: RankingSummary) -> Iterator[dict[str, object]]:
    for row in ranking.rows:
        of_row: dict[str, object] = {"row": row.name, "recordings": row.recordings, "cases": row.cases}
        yield of_row | {"table": "unknown_share", "value": row.unknown_share}
        for metric, by_reference in row.scores.items():
            for reference, scores in by_reference.items():
                for name, score in scores.items():
                    yield of_row | {"table": "scores", "reference": reference, "prediction": name, "metric": metric,
                                    "value": score}  # fmt: skip
        for reference, found in row.agreement.items():
            numbers = {("tau", ""): found.tau}
            numbers |= {("difference", metric): number for metric, number in found.difference.items()}
            numbers |= {("difference_real", metric): number for metric, number in found.difference_real.items()}
            for kind, of_kind in found.by_kind.items():
                for table, ratio in (("tau", of_kind.tau), ("signed_difference", of_kind.signed_difference)):
                    yield of_row | {"table": table, "reference": reference, "metric": kind, "value": ratio}
            yield of_row | {"table": "tau", "reference": reference, "metric": "between", "value": found.tau_between}
            for (table, metric), number in numbers.items():
                low, high = number.ci95 or (None, None)
                yield of_row | {"table": table, "reference": reference, "metric": metric, "value": number.value,
                                "low": low, "high": high}  # fmt: skip


_PANEL_IN, _COLUMNS = 2.6, 4


@canvas.styled
def draw_ranking(ranking: RankingSummary) -> Figure:
    """Draw every prediction's score against lidar references over its score against the exact masks, a panel a row."""
    rows = [row for row in ranking.rows if row.cases]
    lines = -(-(len(rows) + 1) // _COLUMNS)  # one place for the legend
    figure = canvas.new_figure(_COLUMNS * _PANEL_IN, lines * (_PANEL_IN + 0.2) + 0.3, layout="constrained")
    title = f"{ranking.dataset}: scores against the lidar reference over scores against exact masks"
    figure.suptitle(title, x=0.01, ha="left", fontsize=10)
    panels = figure.subplots(lines, _COLUMNS).flat
    for axes, row in zip(panels, rows, strict=False):
        _draw_row(axes, row, ranking)
    legend, *unused = panels[len(rows) :]
    for axes in (legend, *unused):
        axes.set_axis_off()
    legend.legend(
        *panels[0].get_legend_handles_labels(), loc="upper left", frameon=False,
        title="filled: real methods\nhollow: exact, or " + ERRORS[OUTLINES]
        + "\nhalf: " + ERRORS[OBJECTS], alignment="left", fontsize=8, title_fontsize=8,
    )  # fmt: skip
    return figure


def _draw_row(axes: Axes, row: RankedRow, ranking: RankingSummary) -> None:
    areas = row.name == FALSE_POSITIVES
    scores = row.scores["false_positive_share" if areas else "iou"]
    limits = (-3.0, 103.0)
    axes.plot(limits, limits, color=canvas.GREY, linewidth=0.8, zorder=1)
    for reference in LIDAR:
        names: dict[str, list[str]] = {"full": [], "none": [], "left": []}
        for name in ranking.predictions:
            names["full" if name in ranking.real else FILLS[ranking.errors.get(name, OUTLINES)]].append(name)
        for fill, of_fill in names.items():
            x, y = ([100 * scores[of][name] for name in of_fill] for of in (EXACT, reference))
            axes.plot(
                x, y, MARKERS[reference], color=COLOURS[reference], markersize=3.6, markeredgewidth=0.9, zorder=3,
                fillstyle=fill, markerfacecoloralt="white", label=NAMES[reference] if fill == "full" else "_",
            )  # fmt: skip
    unit = "image area (%)" if areas else "IoU (%)"
    axes.set(aspect="equal", xlim=limits, ylim=limits, xlabel=f"{unit}, exact masks", ylabel=f"{unit}, lidar reference")
    axes.xaxis.labelpad = axes.yaxis.labelpad = 1.5
    axes.set_title(f"{row_label(row.name)}\n{row.recordings} recordings, {row.cases} frames", pad=3)
    axes.grid(color=canvas.LIGHT_GREY, linewidth=0.4)


def write_ranking_files(folder: Path) -> tuple[Path, ...]:
    """Write `ranking.md`, `ranking.csv`, `ranking.png` and `ranking.svg` beside `ranking.json`; all of their paths.

    Raises:
        DataError: the stored ranking is missing or damaged.
    """
    ranking = read_ranking(folder)
    texts = formats.write_texts(
        folder, {"ranking.md": document.to_markdown(report(ranking)), "ranking.csv": to_csv(ranking)}
    )
    return (folder / RANKING, *texts, *canvas.write_picture(folder / "ranking", draw_ranking(ranking)))
