"""Does the lidar reference rank methods as the truth does: tables, and each row's scores by one over the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.atomic import write_text
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.sums import ALL_MOVING
from bench.records.reference import Category
from bench.reporting import figures, formats
from bench.reporting.audit import decimal, sections
from bench.reporting.document import Code, Column, Heading, Paragraph, Picture, Table, to_markdown
from benchmarks.ranking.agreement import Estimate, Ranking, command, tau_text
from benchmarks.ranking.predictions import ALL_PREDICTIONS, OBJECTS, OUTLINES
from benchmarks.ranking.sums import EXACT, FALSE_POSITIVES, REFERENCES

LEAST_TAU = 0.95
LARGEST_DIFFERENCE, LARGEST_REAL_DIFFERENCE = 0.03, 0.01  # of IoU, mean over categories
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


def wins(ranking: Ranking, reference: str) -> Iterator[tuple[str, str]]:
    """Rows of object-frames, and masks that are wrong by construction and score more there than the exact ones."""
    for name, scores in ranking.scores.xs(reference, level="reference").drop(FALSE_POSITIVES).iterrows():
        for prediction in ranking.predictions:
            if ranking.exact is not None and prediction.error and scores[prediction.name] > scores[ranking.exact]:
                yield str(name), prediction.name


def misses(ranking: Ranking, reference: str) -> Iterator[str]:
    """List the aims that a reference misses, in words. The order counts in rows with at least six recordings."""
    for name, found in ranking.agreement.xs(reference, level="reference").iterrows():
        if ranking.rows.loc[name, "recordings"] >= FEWEST_RECORDINGS and found["tau"].value < LEAST_TAU:
            yield f"tau {found['tau'].value:.2f} in {str(name).replace('_', ' ')}"
    aims = {"difference": LARGEST_DIFFERENCE, "difference_real": LARGEST_REAL_DIFFERENCE}
    for (column, most), who in zip(aims.items(), ("all predictions", "real methods"), strict=True):
        difference = ranking.of_motion(reference, column)
        if difference > most:
            yield f"mean difference {100 * difference:.1f} over {who}"


def overview_table(ranking: Ranking) -> Table:
    """One line per lidar reference."""
    rows = []
    for reference in LIDAR:
        differences = [100 * ranking.of_motion(reference, column) for column in ("difference", "difference_real")]
        taus = [found.value for found in ranking.agreement.xs(reference, level="reference")["tau"]]
        won = "; ".join(f"{name} in {row_label(row).lower()}" for row, name in wins(ranking, reference)) or "none"
        rows.append([NAMES[reference], *differences, *taus, won, "; ".join(misses(ranking, reference)) or "none"])
    points = [Column(heading, "{:.1f}".format) for heading in ("IoU points, all", "real methods")]
    of_rows = [Column(f"tau {row_label(name).lower()}", decimal) for name in ranking.rows.index]
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


def _agreements(ranking: Ranking, make: Callable[[str, Any], Iterable[object]]) -> list[list[object]]:
    """A line of a table for each row and lidar reference, behind the names of both."""
    return [
        [row_label(name), NAMES[reference], *make(name, found)]
        for (name, reference), found in ranking.agreement.iterrows()
    ]


def kind_table(ranking: Ranking) -> Table:
    """Agreement by kind of error, one line per row and lidar reference; then means over the kinds of motion."""
    of_kinds = [f"{value}_{kind}" for kind in ranking.kinds for value in ("tau", "points")]
    rows = _agreements(ranking, lambda _, found: found[[*of_kinds, "tau_between"]])
    rows += [
        ["Mean of kinds", NAMES[name], *(ranking.of_motion(name, column) for column in of_kinds), None]
        for name in LIDAR
    ]
    numbers = [Column(heading, form) for kind in ranking.kinds for heading, form in
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


def _names(ranking: Ranking, kind: str) -> str:
    names = [one.name.removeprefix("truth:") for one in ranking.predictions if one.error == kind]
    return ", ".join(names) or "none"


def agreement_table(ranking: Ranking) -> Table:
    """Order and IoU, one line per row and lidar reference, with intervals."""
    numbers = [Column("Tau", tau_text), Column("All", _points), Column("Real methods", _points)]
    return Table(
        title="Order, and differences of IoU in points",
        columns=["Type", "Reference", "Recordings", "Frames", *numbers],
        rows=_agreements(
            ranking, lambda name, found: [*_cases(ranking, name), *found[["tau", "difference", "difference_real"]]]
        ),
        note="Mean absolute differences from the scores against exact masks, over all predictions, and over the real "
        "methods, that is those that are not made of the exact masks; of false positives: of their area. In brackets "
        f"95 % intervals from draws of whole recordings; rows of fewer than {FEWEST_RECORDINGS} recordings have none.",
        words=2,
    )


def ceiling_table(ranking: Ranking) -> Table:
    """Scores of the exact masks, and the unknown share of the objects; one line per row."""
    exact = ranking.exact
    return Table(
        title="Ceiling: IoU of the exact masks, in percent",
        columns=["Type", "Recordings", "Frames", *_in_percent([NAMES[name] for name in LIDAR] + ["Unknown share"])],
        rows=[
            [row_label(name), *_cases(ranking, name),
             *(ranking.scores.loc[(name, lidar), exact] if exact else None for lidar in LIDAR), unknown]
            for name, unknown in ranking.rows["unknown_share"].items()
            if name != FALSE_POSITIVES
        ],
        note="Unknown share: mean share of an object-frame's possible pixels in which surface-v1 counts nothing.",
    )  # fmt: skip


def fit_table(ranking: Ranking) -> Table:
    """Correctness of the regions of surface-v1, one line per slice."""
    shares = {"core_outside": "Core outside mask", "left_out": "Mask left out", "unknown_share": "Unknown share"}
    of_slice = {"object_class": "Class", "range_m": "Range m", "ego_speed_mps": "Ego m/s", "object_frames": "Frames"}
    return Table(
        title="Core, band and exact mask of surface-v1, in percent",
        columns={**of_slice, **dict(zip(shares, _in_percent(shares.values()), strict=True))},
        rows=ranking.fits,
        note="Core outside mask: of the cores' pixels. Mask left out: of the exact masks, in neither core nor "
        "band. Unknown share: mean over the object-frames.",
        words=3,
    )


def score_table(ranking: Ranking, name: str) -> Table:
    """Every prediction's score in one row, the best by the exact masks first."""
    scores = ranking.scores.loc[name].T.sort_values(EXACT, ascending=False, kind="stable")
    what = "area of false positives" if name == FALSE_POSITIVES else "IoU"
    recordings, cases = ranking.rows.loc[name, ["recordings", "cases"]].astype(int)
    return Table(
        title=f"{row_label(name)}: {what}, in percent",
        columns=["Prediction", *_in_percent(NAMES.values())],
        rows=scores[[*REFERENCES]].reset_index(),
        note=f"{cases} frames of {recordings} recordings.",
    )


def _in_percent(headings: Iterable[str]) -> list[Column]:
    return [Column(heading, formats.hundredths) for heading in headings]


def _cases(ranking: Ranking, name: str) -> tuple[str, int]:
    """Recordings and frames of a row."""
    recordings, cases = ranking.rows.loc[name, ["recordings", "cases"]].astype(int)
    return f"{recordings}{'' if recordings >= FEWEST_RECORDINGS else ' (too few)'}", int(cases)


def _points(found: Estimate) -> str:
    return f"{formats.hundredths(found.value)} {formats.interval(found.ci95)}".rstrip()


def ranking_tables(ranking: Ranking) -> tuple[Table, ...]:
    """The tables that are printed."""
    tables = [overview_table(ranking), agreement_table(ranking), ceiling_table(ranking), fit_table(ranking)]
    return (*tables, kind_table(ranking)) if ranking.kinds else tuple(tables)


def _held(ranking: Ranking) -> list[str]:
    """The rows that have cases."""
    return [str(name) for name, cases in ranking.rows["cases"].items() if cases]


def report(ranking: Ranking) -> str:
    """All tables with their notes, below the picture, in Markdown."""
    names = tuple(prediction.name for prediction in ranking.predictions)
    methods = "all" if names == ALL_PREDICTIONS else ",".join(names)
    real = sum(prediction.real for prediction in ranking.predictions)
    of_rows = (score_table(ranking, name) for name in _held(ranking))
    return to_markdown(
        [
            Heading(f"Does the lidar reference of {ranking.stored.dataset} rank methods as the truth does?", 1),
            Paragraph(
                f"{len(names)} predictions, {real} of them real methods, against four lidar references and the exact "
                f"masks, over the same object-frames of {ranking.stored.images} images of {ranking.stored.recordings} "
                "recordings. Made by:"
            ),
            Code(f"{command(ranking.stored)} --methods {methods}"),
            Picture("ranking.png", "Scores against lidar references over scores against exact masks"),
            *sections((*ranking_tables(ranking), *of_rows)),
        ],
    )


_PANEL_IN, _COLUMNS = 2.6, 4


@figures.styled
def draw_ranking(ranking: Ranking) -> Figure:
    """Draw every prediction's score against lidar references over its score against the exact masks, a panel a row."""
    rows = _held(ranking)
    lines = -(-(len(rows) + 1) // _COLUMNS)  # one place for the legend
    figure = figures.new_figure(_COLUMNS * _PANEL_IN, lines * (_PANEL_IN + 0.2) + 0.3, layout="constrained")
    title = f"{ranking.stored.dataset}: scores against the lidar reference over scores against exact masks"
    figure.suptitle(title, x=0.01, ha="left", fontsize=10)
    panels = figure.subplots(lines, _COLUMNS).flat
    for axes, name in zip(panels, rows, strict=False):
        _draw_row(axes, name, ranking)
    legend, *unused = panels[len(rows) :]
    for axes in (legend, *unused):
        axes.set_axis_off()
    legend.legend(
        *panels[0].get_legend_handles_labels(), loc="upper left", frameon=False,
        title="filled: real methods\nhollow: exact, or " + ERRORS[OUTLINES]
        + "\nhalf: " + ERRORS[OBJECTS], alignment="left", fontsize=8, title_fontsize=8,
    )  # fmt: skip
    return figure


def _draw_row(axes: Axes, name: str, ranking: Ranking) -> None:
    limits = (-3.0, 103.0)
    axes.plot(limits, limits, color=figures.GREY, linewidth=0.8, zorder=1)
    fills = pd.Series({p.name: "full" if p.real else FILLS[p.error or OUTLINES] for p in ranking.predictions})
    scores = 100 * ranking.scores.loc[name]
    for reference in LIDAR:
        for fill in ("full", "none", "left"):
            of_fill = scores[fills.index[fills == fill]]
            axes.plot(
                of_fill.loc[EXACT], of_fill.loc[reference], MARKERS[reference], color=COLOURS[reference],
                markersize=3.6, markeredgewidth=0.9, zorder=3, fillstyle=fill, markerfacecoloralt="white",
                label=NAMES[reference] if fill == "full" else "_",
            )  # fmt: skip
    unit = "image area (%)" if name == FALSE_POSITIVES else "IoU (%)"
    axes.set(aspect="equal", xlim=limits, ylim=limits, xlabel=f"{unit}, exact masks", ylabel=f"{unit}, lidar reference")
    axes.xaxis.labelpad = axes.yaxis.labelpad = 1.5
    recordings, cases = ranking.rows.loc[name, ["recordings", "cases"]].astype(int)
    axes.set_title(f"{row_label(name)}\n{recordings} recordings, {cases} frames", pad=3)
    axes.grid(color=figures.LIGHT_GREY, linewidth=0.4)


def write_ranking_files(folder: Path, ranking: Ranking) -> tuple[Path, ...]:
    """Write `ranking.md`, `ranking.png` and `ranking.svg`; their paths."""
    write_text(folder / "ranking.md", report(ranking))
    return (folder / "ranking.md", *figures.write_picture(folder / "ranking", draw_ranking(ranking), "png", "svg"))
