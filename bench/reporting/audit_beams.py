"""How many beams does a trustworthy reference need: a table, and each share over the number of beams."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from bench.audit import ALL
from bench.audit.beams import BEAMS, BeamsRow, BeamsSummary, read_beams
from bench.evaluation.sums import ALL_MOVING
from bench.reporting import canvas, document, formats
from bench.reporting.audit_tables import decimal, sections
from bench.reporting.document import Block, Code, Heading, Paragraph, Picture, Table

CLASSES = {  # colour and marker
    ALL: (canvas.BLACK, "o"),
    "pedestrian": (canvas.ORANGE, "^"),
    "cyclist": (canvas.GREEN, "s"),
    "vehicle": (canvas.BLUE, "D"),
}
SHARES: dict[str, Callable[[BeamsRow], float]] = {
    "Object-frames lost (%)": lambda row: row.lost_share,
    "Masks in the cores (%)": lambda row: row.in_core,
    "Cores outside the masks (%)": lambda row: row.core_outside,
    "Unknown share (%)": lambda row: row.unknown_share,
    "Ceiling, IoU (%)": lambda row: row.ceiling,
}
TAU = "Kendall's tau"


def row_label(row: BeamsRow) -> str:
    """Return the name of a class in tables and pictures."""
    return formats.LABELS[ALL_MOVING] if row.object_class == ALL else row.object_class.capitalize()


def beams_table(found: BeamsSummary) -> Table:
    """One line per class and number of beams."""
    ranked = len(found.predictions) > 1
    rows = [
        (row_label(row), str(row.beams), str(row.recordings), str(row.object_frames), str(row.lost),
         *map(formats.hundredths, (row.in_core, row.left_out, row.core_outside, row.unknown_share, row.ceiling)),
         *([] if row.tau is None else [_tau(row)]))
        for row in found.rows
    ]  # fmt: skip
    headings = ["In core", "Left out", "Core outside", "Unknown", "Ceiling", *(["Tau"] if ranked else [])]
    return Table(
        title="The reference surface-v1 by fewer beams, in percent",
        columns=("Class", "Beams", "Recordings", "Frames", "Lost", *headings),
        rows=rows,
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


def _tau(row: BeamsRow) -> str:
    assert row.tau is not None, "methods were ranked"
    return f"{decimal(row.tau.value)} {formats.interval(row.tau.ci95, unit=1.0, digits=2)}".rstrip()


def beams_tables(found: BeamsSummary) -> tuple[Table, ...]:
    """The tables that are printed."""
    return (beams_table(found),)


def report(found: BeamsSummary) -> Iterator[Block]:
    """The table with its note, and the picture."""
    yield Heading(f"How many beams does a reference of {found.dataset} need?", 1)
    yield Paragraph(
        f"Rings of the lidar are left out, evenly spaced, in {found.images} images of {found.recordings} recordings; "
        "everything else is as recorded. Made by:"
    )
    yield Code(_command(found))
    yield Picture("beams.png", "What the reference tells and loses, over the number of beams")
    yield from sections(beams_tables(found))


def _command(found: BeamsSummary) -> str:
    split = "" if found.split is None else f" --split {found.split}"
    methods = f" --methods {','.join(found.predictions)}" if len(found.predictions) > 1 else ""
    beams = ",".join(map(str, found.asked))
    return f"fisheye-bench audit {found.card} --recordings {found.recordings}{split} --beams {beams}{methods}"


def to_csv(found: BeamsSummary) -> str:
    """One line per class and number of beams, at full precision; empty where there is no number."""
    return document.to_csv(_csv_row(row) for row in found.rows)


def _csv_row(row: BeamsRow) -> dict[str, object]:
    tau, (low, high) = row.tau, (None, None) if row.tau is None or row.tau.ci95 is None else row.tau.ci95
    numbers = row.model_dump(exclude={"tau"})
    return numbers | {"tau": None if tau is None else tau.value, "tau_low": low, "tau_high": high}


_COLUMNS, _PANEL_IN = 3, 2.2
_LOW = 30.0  # percent: panels whose values are all below end there


@canvas.styled
def draw_beams(found: BeamsSummary) -> Figure:
    """Draw what is lost, told and unknown, the ceiling, and tau where methods were ranked, over the beams."""
    titles = [*SHARES, TAU] if len(found.predictions) > 1 else [*SHARES]
    lines = -(-len(titles) // _COLUMNS)
    figure = canvas.new_figure(_COLUMNS * _PANEL_IN, lines * _PANEL_IN + 0.6, layout="constrained")
    figure.suptitle(f"{found.dataset}: the reference surface-v1 by fewer beams", x=0.01, ha="left", fontsize=8)
    panels = figure.subplots(lines, _COLUMNS).flat
    for axes, title in zip(panels, titles, strict=False):
        _draw_panel(axes, title, found)
    for axes in panels[len(titles) :]:
        axes.set_axis_off()
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(CLASSES), frameon=False)
    return figure


def _draw_panel(axes: Axes, title: str, found: BeamsSummary) -> None:
    low, top = 0.0, 1.0 if title == TAU else _LOW
    for name, (colour, marker) in CLASSES.items():
        rows = [row for row in found.rows if row.object_class == name]
        values = [_value(row, title) for row in rows]
        low = -1.0 if any(value < 0 for value in values) else low
        top = 100.0 if any(value > _LOW for value in values) else top
        if rows:
            axes.plot([row.beams for row in rows], values, color=colour, marker=marker, markersize=3.5, linewidth=1.0,
                      label=row_label(rows[0]))  # fmt: skip
    beams = sorted({row.beams for row in found.rows})
    axes.set_xscale("log")
    axes.set_xticks(beams, [str(count) for count in beams])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set(xlabel="beams", ylim=(low - 0.02 * top, 1.03 * top))
    axes.set_title(title, pad=3)
    axes.grid(color=canvas.LIGHT_GREY, linewidth=0.4)


def _value(row: BeamsRow, title: str) -> float:
    if title != TAU:
        return 100 * SHARES[title](row)
    return float("nan") if row.tau is None else row.tau.value


def write_beams_files(folder: Path) -> tuple[Path, ...]:
    """Write `beams.md`, `beams.csv`, `beams.png` and `beams.svg` beside `beams.json`; all of their paths.

    Raises:
        DataError: the stored audit is missing or damaged.
    """
    found = read_beams(folder)
    texts = formats.write_texts(folder, {"beams.md": document.to_markdown(report(found)), "beams.csv": to_csv(found)})
    return (folder / BEAMS, *texts, *canvas.write_picture(folder / "beams", draw_beams(found)))
