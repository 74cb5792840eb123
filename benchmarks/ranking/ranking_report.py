"""Does the lidar reference rank methods as the truth does: tables, and each row's scores by one over the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.atomic import write_text
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.sums import ALL_MOVING
from bench.reference import Category
from bench.reporting import figures, formats
from bench.reporting.audit import decimal, sections
from bench.reporting.document import Code, Column, Heading, Paragraph, Picture, Table, to_markdown
from benchmarks.ranking.agreement import (
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
    command,
    tau_text,
)
from benchmarks.ranking.predictions import ALL_PREDICTIONS, OBJECTS, OUTLINES
from benchmarks.ranking.sums import EXACT, FALSE_POSITIVES, REFERENCES

NAMES = dict(
    zip(
        REFERENCES,
        ("convex hull (paper-v1)", "concave hull", "surface patches", "surface-v1", "exact masks"),
        strict=True,
    )
)
LIDAR = REFERENCES[:-1]
MARKERS = dict(zip(LIDAR, ("o", "s", "^", "D"), strict=True))
COLOURS = dict(zip(LIDAR, (figures.ORANGE, figures.SKY_BLUE, figures.GREEN, figures.VERMILION), strict=True))
ERRORS = {OUTLINES: "outline errors", OBJECTS: "errors of whole objects or parts"}
FILLS = {OUTLINES: "none", OBJECTS: "left"}  # of the markers; real methods are filled


def row_label(name: str) -> str:
    """Return the name of a row in tables and pictures."""
    others = {ALL_MOVING: "All moving", FALSE_POSITIVES: "False positives"}
    return others.get(name) or formats.LABELS[Category(name)]


def overview_table(ranking: RankingSummary) -> Table:
    """One line per lidar reference."""
    rows = []
    for reference in LIDAR:
        differences = [100 * ranking.mean_difference(reference, real=real) for real in (False, True)]
        taus = [row.agreement[reference].tau.value for row in ranking.rows]
        won = "; ".join(f"{name} in {row_label(row).lower()}" for row, name in ranking.wins(reference)) or "none"
        rows.append([NAMES[reference], *differences, *taus, won, "; ".join(ranking.misses(reference)) or "none"])
    points = [Column(heading, "{:.1f}".format) for heading in ("IoU points, all", "real methods")]
    of_rows = [Column(f"tau {row_label(row.name).lower()}", decimal) for row in ranking.rows]
    return Table(
        title="Agreement with the exact masks",
        columns=["Reference", *points, *of_rows, "Wrong masks win", "Aims missed"],
        rows=rows,
        note="Points: mean absolute difference of IoU from the score against exact masks, over the predictions and the "
        "kinds of motion. Tau: Kendall's tau-b of the two orders of the predictions, by IoU, of false positives by "
        f"their area. The aims: tau of at least {LEAST_TAU} in every row with at least {FEWEST_RECORDINGS} recordings, "
        f"at most {100 * LARGEST_DIFFERENCE:g} points over all predictions and {100 * LARGEST_REAL_DIFFERENCE:g} over "
        "real methods. Wrong masks: those made of the exact masks that score more than these.",
    )


def _agreements(
    ranking: RankingSummary, make: Callable[[RankedRow, Agreement], Iterable[object]]
) -> list[list[object]]:
    """A line of a table for each row and lidar reference, behind the names of both."""
    return [
        [row_label(row.name), NAMES[reference], *make(row, found)]
        for row in ranking.rows
        for reference, found in row.agreement.items()
    ]


def kind_table(ranking: RankingSummary) -> Table:
    """Agreement by kind of error, one line per row and lidar reference; then means over the kinds of motion."""

    def cells(of_kinds: Iterable[KindAgreement | None]) -> list[float | None]:
        return [value for one in of_kinds for value in ((one.tau, one.signed_difference) if one else (None, None))]

    rows = _agreements(ranking, lambda _, found: [*cells(map(found.by_kind.get, KINDS)), found.tau_between])
    for name in LIDAR:
        rows.append(["Mean of kinds", NAMES[name], *cells(ranking.mean_of_motion(name, k) for k in KINDS), None])
    numbers = [Column(heading, form) for kind in KINDS for heading, form in
               ((f"Tau {kind}", decimal), (f"{kind.capitalize()}, points", formats.points))]  # fmt: skip
    return Table(
        title="Masks that are wrong in known ways, by kind of error",
        columns=["Type", "Reference", *numbers, Column("Tau between", decimal)],
        rows=rows,
        note="Outlines: " + _names(ranking, OUTLINES) + ". Objects, or parts of them, lack or are added: "
        + _names(ranking, OBJECTS) + ". Tau: of these masks and the exact one; between: of the pairs of two masks with "
        "errors of different kinds. Points: mean of IoU by the lidar reference less IoU by exact masks; positive where "
        "the errors cost too little. In the row of false positives: their area.",
        words=2,
    )  # fmt: skip


def _names(ranking: RankingSummary, kind: str) -> str:
    names = [name.removeprefix("truth:") for name in ranking.predictions if ranking.errors.get(name) == kind]
    return ", ".join(names) or "none"


def agreement_table(ranking: RankingSummary) -> Table:
    """Order and IoU, one line per row and lidar reference, with intervals."""

    def cells(row: RankedRow, found: Agreement) -> list[object]:
        return [_recordings(row), row.cases, found.tau, found.difference, found.difference_real]

    numbers = [Column("Tau", tau_text), Column("All", _points), Column("Real methods", _points)]
    return Table(
        title="Order, and differences of IoU in points",
        columns=["Type", "Reference", "Recordings", "Frames", *numbers],
        rows=_agreements(ranking, cells),
        note="Mean absolute differences from the scores against exact masks, over all predictions, and over the real "
        "methods, that is those that are not made of the exact masks; of false positives: of their area. In brackets "
        f"95 % intervals from draws of whole recordings; rows of fewer than {FEWEST_RECORDINGS} recordings have none.",
        words=2,
    )


def ceiling_table(ranking: RankingSummary) -> Table:
    """Scores of the exact masks, and the unknown share of the objects; one line per row."""
    exact = ranking.ceiling
    return Table(
        title="Ceiling: IoU of the exact masks, in percent",
        columns=["Type", "Recordings", "Frames", *_in_percent([NAMES[name] for name in LIDAR] + ["Unknown share"])],
        rows=[
            [row_label(row.name), _recordings(row), row.cases,
             *(row.scores[name][exact] if exact else None for name in LIDAR), row.unknown_share]
            for row in ranking.rows
            if row.name != FALSE_POSITIVES
        ],
        note="Unknown share: mean share of an object-frame's possible pixels in which surface-v1 counts nothing.",
    )  # fmt: skip


def fit_table(ranking: RankingSummary) -> Table:
    """Correctness of the regions of surface-v1, one line per slice."""
    shares = {"core_outside": "Core outside mask", "left_out": "Mask left out", "unknown_share": "Unknown share"}
    of_slice = {"object_class": "Class", "range_m": "Range m", "ego_speed_mps": "Ego m/s", "object_frames": "Frames"}
    return Table(
        title="Core, band and exact mask of surface-v1, in percent",
        columns={**of_slice, **dict(zip(shares, _in_percent(shares.values()), strict=True))},
        rows=pd.DataFrame([fit.model_dump() for fit in ranking.fits]),
        note="Core outside mask: of the cores' pixels. Mask left out: of the exact masks, in neither core nor "
        "band. Unknown share: mean over the object-frames.",
        words=3,
    )


def score_table(row: RankedRow) -> Table:
    """Every prediction's score in one row, the best by the exact masks first."""
    scores = pd.DataFrame(row.scores).sort_values(EXACT, ascending=False, kind="stable")
    what = "area of false positives" if row.name == FALSE_POSITIVES else "IoU"
    return Table(
        title=f"{row_label(row.name)}: {what}, in percent",
        columns=["Prediction", *_in_percent(NAMES.values())],
        rows=scores[[*REFERENCES]].reset_index(),
        note=f"{row.cases} frames of {row.recordings} recordings.",
    )


def _in_percent(headings: Iterable[str]) -> list[Column]:
    return [Column(heading, formats.hundredths) for heading in headings]


def _recordings(row: RankedRow) -> str:
    return str(row.recordings) if row.recordings >= FEWEST_RECORDINGS else f"{row.recordings} (too few)"


def _points(found: Estimate) -> str:
    return f"{formats.hundredths(found.value)} {formats.interval(found.ci95)}".rstrip()


def ranking_tables(ranking: RankingSummary) -> tuple[Table, ...]:
    """The tables that are printed."""
    tables = [overview_table(ranking), agreement_table(ranking), ceiling_table(ranking), fit_table(ranking)]
    return (*tables, kind_table(ranking)) if ranking.errors else tuple(tables)


def report(ranking: RankingSummary) -> str:
    """All tables with their notes, below the picture, in Markdown."""
    methods = "all" if ranking.predictions == ALL_PREDICTIONS else ",".join(ranking.predictions)
    of_rows = (score_table(row) for row in ranking.rows if row.cases)
    return to_markdown(
        [
            Heading(f"Does the lidar reference of {ranking.dataset} rank methods as the truth does?", 1),
            Paragraph(
                f"{len(ranking.predictions)} predictions, {len(ranking.real)} of them real methods, against four lidar "
                f"references and the exact masks, over the same object-frames of {ranking.images} images of "
                f"{ranking.recordings} recordings. Made by:"
            ),
            Code(f"{command(ranking)} --methods {methods}"),
            Picture("ranking.png", "Scores against lidar references over scores against exact masks"),
            *sections((*ranking_tables(ranking), *of_rows)),
        ],
    )


_PANEL_IN, _COLUMNS = 2.6, 4


@figures.styled
def draw_ranking(ranking: RankingSummary) -> Figure:
    """Draw every prediction's score against lidar references over its score against the exact masks, a panel a row."""
    rows = [row for row in ranking.rows if row.cases]
    lines = -(-(len(rows) + 1) // _COLUMNS)  # one place for the legend
    figure = figures.new_figure(_COLUMNS * _PANEL_IN, lines * (_PANEL_IN + 0.2) + 0.3, layout="constrained")
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
    limits = (-3.0, 103.0)
    axes.plot(limits, limits, color=figures.GREY, linewidth=0.8, zorder=1)
    for reference in LIDAR:
        names: dict[str, list[str]] = {"full": [], "none": [], "left": []}
        for name in ranking.predictions:
            names["full" if name in ranking.real else FILLS[ranking.errors.get(name, OUTLINES)]].append(name)
        for fill, of_fill in names.items():
            x, y = ([100 * row.scores[of][name] for name in of_fill] for of in (EXACT, reference))
            axes.plot(
                x, y, MARKERS[reference], color=COLOURS[reference], markersize=3.6, markeredgewidth=0.9, zorder=3,
                fillstyle=fill, markerfacecoloralt="white", label=NAMES[reference] if fill == "full" else "_",
            )  # fmt: skip
    unit = "image area (%)" if row.name == FALSE_POSITIVES else "IoU (%)"
    axes.set(aspect="equal", xlim=limits, ylim=limits, xlabel=f"{unit}, exact masks", ylabel=f"{unit}, lidar reference")
    axes.xaxis.labelpad = axes.yaxis.labelpad = 1.5
    axes.set_title(f"{row_label(row.name)}\n{row.recordings} recordings, {row.cases} frames", pad=3)
    axes.grid(color=figures.LIGHT_GREY, linewidth=0.4)


def write_ranking_files(folder: Path, ranking: RankingSummary) -> tuple[Path, ...]:
    """Write `ranking.md`, `ranking.png` and `ranking.svg` beside `ranking.json`; all of their paths."""
    write_text(folder / "ranking.md", report(ranking))
    pictures = figures.write_picture(folder / "ranking", draw_ranking(ranking))
    return (folder / RANKING, folder / "ranking.md", *pictures)
