"""Beams that a trustworthy reference needs: a table, and each share over the number of beams."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from bench.atomic import write_text
from bench.audit.run import ALL
from bench.evaluation.sums import ALL_MOVING
from bench.reporting import figures, formats
from bench.reporting.audit import sections
from bench.reporting.document import Code, Column, Heading, Heads, Paragraph, Picture, Table, to_markdown
from benchmarks.ranking.agreement import command, tau_text
from benchmarks.ranking.beams import Beams

CLASSES = {  # colour and marker
    ALL: (figures.BLACK, "o"),
    "pedestrian": (figures.ORANGE, "^"),
    "cyclist": (figures.GREEN, "s"),
    "vehicle": (figures.BLUE, "D"),
}
SHARES = {  # title of a panel -> column
    "Object-frames lost (%)": "lost_share",
    "Masks in the cores (%)": "in_core",
    "Cores outside the masks (%)": "core_outside",
    "Unknown share (%)": "unknown_share",
    "Ceiling, IoU (%)": "ceiling",
}
TAU = "Kendall's tau"


def row_label(object_class: str) -> str:
    """Return the name of a class in tables and pictures."""
    return formats.LABELS[ALL_MOVING] if object_class == ALL else object_class.capitalize()


COLUMNS: dict[str, Heads] = {
    "object_class": Column("Class", row_label),
    "beams": "Beams",
    "recordings": "Recordings",
    "object_frames": "Frames",
    "lost": "Lost",
    "in_core": Column("In core", formats.hundredths),
    "left_out": Column("Left out", formats.hundredths),
    "core_outside": Column("Core outside", formats.hundredths),
    "unknown_share": Column("Unknown", formats.hundredths),
    "ceiling": Column("Ceiling", formats.hundredths),
}


def beams_table(found: Beams) -> Table:
    """One line per class and number of beams."""
    ranked = len(found.predictions) > 1
    return Table(
        title="The reference surface-v1 by fewer beams, in percent",
        columns=COLUMNS | {"tau": Column("Tau", tau_text)} if ranked else COLUMNS,
        rows=found.rows,
        note="The first line of a class is the whole sensor. Frames: object-frames that it and these beams evaluate; "
        "lost: that it evaluates alone; the other columns do not count what is lost. In core, left out: share of the "
        "exact masks' pixels in the cores, and in neither core nor band. Core outside: share of the cores' pixels "
        "outside the exact masks. Unknown: mean share of an object-frame's possible pixels in which nothing counts. "
        "Ceiling: mean IoU of the exact masks." + (TAU_NOTE if ranked else ""),
        words=2,
    )


TAU_NOTE = (
    " Tau: Kendall's tau-b of the orders of the predictions by IoU, by this reference and by the exact masks; 95 % "
    "intervals from draws of whole recordings."
)


def report(found: Beams) -> str:
    """The table with its note, below the picture, in Markdown."""
    methods = f" --methods {','.join(found.predictions)}" if len(found.predictions) > 1 else ""
    return to_markdown(
        [
            Heading(f"How many beams does a reference of {found.stored.dataset} need?", 1),
            Paragraph(
                f"Rings of the lidar are left out, evenly spaced, in {found.stored.images} images of "
                f"{found.stored.recordings} recordings; everything else is as recorded. Made by:"
            ),
            Code(f"{command(found.stored)} --beams {','.join(map(str, found.asked))}{methods}"),
            Picture("beams.png", "What the reference tells and loses, over the number of beams"),
            *sections([beams_table(found)]),
        ],
    )


_COLUMNS, _PANEL_IN = 3, 2.2
_LOW = 30.0  # percent: panels whose values are all below end there


@figures.styled
def draw_beams(found: Beams) -> Figure:
    """Draw what is lost, told and unknown, the ceiling, and tau where methods were ranked, over the beams."""
    titles = [*SHARES, TAU] if len(found.predictions) > 1 else [*SHARES]
    lines = -(-len(titles) // _COLUMNS)
    figure = figures.new_figure(_COLUMNS * _PANEL_IN, lines * _PANEL_IN + 0.6, layout="constrained")
    figure.suptitle(f"{found.stored.dataset}: the reference surface-v1 by fewer beams", x=0.01, ha="left", fontsize=8)
    panels = figure.subplots(lines, _COLUMNS).flat
    for axes, title in zip(panels, titles, strict=False):
        _draw_panel(axes, title, found)
    for axes in panels[len(titles) :]:
        axes.set_axis_off()
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(CLASSES), frameon=False)
    return figure


def _draw_panel(axes: Axes, title: str, found: Beams) -> None:
    low, top = 0.0, 1.0 if title == TAU else _LOW
    shares = found.rows.assign(lost_share=found.rows["lost"] / (found.rows["object_frames"] + found.rows["lost"]))
    values = shares["tau"].map(lambda tau: tau.value) if title == TAU else 100 * shares[SHARES[title]]
    for name, (colour, marker) in CLASSES.items():
        own = shares["object_class"] == name
        low = -1.0 if (values[own] < 0).any() else low
        top = 100.0 if (values[own] > _LOW).any() else top
        if own.any():
            axes.plot(shares["beams"][own], values[own], color=colour, marker=marker, markersize=3.5, linewidth=1.0,
                      label=row_label(name))  # fmt: skip
    beams = sorted(shares["beams"].unique())
    axes.set_xscale("log")
    axes.set_xticks(beams, [str(count) for count in beams])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set(xlabel="beams", ylim=(low - 0.02 * top, 1.03 * top))
    axes.set_title(title, pad=3)
    axes.grid(color=figures.LIGHT_GREY, linewidth=0.4)


def write_beams_files(folder: Path, found: Beams) -> tuple[Path, ...]:
    """Write `beams.md`, `beams.png` and `beams.svg`; their paths."""
    write_text(folder / "beams.md", report(found))
    return (folder / "beams.md", *figures.write_picture(folder / "beams", draw_beams(found), "png", "svg"))
