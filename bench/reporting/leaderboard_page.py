"""A leaderboard for people and programs: terminal, page, Markdown, CSV, LaTeX, a chart of quality against cost."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from urllib.parse import quote

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from bench.atomic import refuse_foreign, write_output, write_text
from bench.errors import BenchError
from bench.evaluation.sums import ALL_MOVING
from bench.harness import FramePipeline, ProcessedFrame
from bench.harness.digests import short_digest
from bench.harness.stages import Progress
from bench.harness.stored import read_run
from bench.reporting import canvas, formats
from bench.reporting.canvas import write_picture
from bench.reporting.charts import Chart
from bench.reporting.compare import LEAST_COMMON
from bench.reporting.document import (
    Bar,
    Block,
    Cell,
    Choice,
    Code,
    Column,
    Filters,
    Group,
    Heads,
    Items,
    Paragraph,
    Picture,
    Report,
    Table,
    Tags,
    to_json,
    to_latex,
    to_page,
)
from bench.reporting.formats import annotations_field, metric_cell, metric_record
from bench.reporting.frame import AREA_COLOURS, detected_pixels, false_positive_text, pixel_classes
from bench.reporting.frame_pictures import ImageKey, draw_images, example_frames
from bench.reporting.leaderboard import (
    FALSE_POSITIVES,
    OF_ENTRY,
    OF_GROUP,
    OF_PIXELS,
    ORDERED_BY,
    RANKING_PROTOCOL,
    Entry,
    Kind,
    Leaderboard,
    as_content,
    best_methods,
    fields,
    known_ceiling,
    shown_metrics,
)
from bench.reporting.leaderboard import Group as Runs
from bench.reporting.run_tables import is_rendered

NOTE = (
    "Of the images that all runs of a table scored, in percent. Runs stand in one table if they have at least "
    f"{100 * LEAST_COMMON:.0f} % of their images in common and the same reference on these. {formats.INTERVALS} "
    "Ranked by IoU over all moving object-frames, an undetected one having 0. Best is a method only where `compare` "
    "shows it better than each of the others; else it is the first, and ranks below may be chance. Chance: detection "
    "at the same level on the mask of another frame. False positives: share of the image. The IoU of an object counts "
    "the false positives that touch it, so specks apart from it cost nothing; the IoU of pixels counts all of them, "
    "over all images."
)
ORACLE_NOTE = (
    f"No methods: the exact masks of rendered data are the ceiling, {formats.CEILING}; oracles are given what no "
    "method may know: the exact masks on cells, or the exact flow and ego-motion."
)
COST_NOTE = "Cost: median time of the method alone for an image, in one thread, in ms, where it was scored."
VERIFIED_NOTE = "Verified: `verify` counted the run again from its masks and the data, on this machine."
SHIPPED_NOTE = "Shipped: a row of the leaderboard that comes with the package; it is not compared in pairs."
NOTES = (NOTE, ORACLE_NOTE, COST_NOTE, VERIFIED_NOTE)
_SUFFIXES = {Kind.METHOD: "", Kind.ORACLE: " (oracle)", Kind.CEILING: " (ceiling)"}


def leaderboard_tables(board: Leaderboard) -> Iterator[Block]:
    """A table per group over all moving objects, readable at 100 columns; then how to read them."""
    for group in board.groups:
        columns = {
            name: _SHORT.get(name, heading)
            for name, heading in shown_metrics(group).items()
            if name not in ("iou_detected", OF_PIXELS)
        }
        yield Table(
            title=group_title(group),
            columns=["", "Run, method", Cell("Images,", ("recs",)), *columns.values(),
                     Cell("ms per", ("image",)), Cell("Date,", ("code",))],
            rows=[
                [_rank(group, entry), Cell(entry.run, (_method(entry),), "strong"),
                 Cell(str(entry.images), (str(group.rows[ALL_MOVING].recordings),)),
                 *(_lines(group, entry, name) for name in columns),
                 Cell("" if entry.cost_ms is None else f"{entry.cost_ms:.1f}"),
                 Cell(entry.date, (entry.code,))]
                for entry in group.entries
            ],
            words=2,
        )  # fmt: skip
    yield from (Paragraph(note, "dim") for note in _notes(board))


_SHORT = {
    "iou": Cell("IoU", ("all",)), "tpr_all": Cell("TPR", ("all",)), FALSE_POSITIVES: Cell("False", ("positives",)),
    "detection_rate_50": Cell("Detection", ("at 50 %",)),
}  # fmt: skip


def _notes(board: Leaderboard) -> list[str]:
    shipped = any(entry.shipped for group in board.groups for entry in group.entries)
    return [*NOTES, *([SHIPPED_NOTE] if shipped else [])]


def _rank(group: Runs, entry: Entry) -> Cell:
    """The rank, and below it whether the first is the best or another is not shown to be behind it."""
    if entry.rank is None or entry.shipped or not group.judged:
        return Cell(str(entry.rank or ""))
    if entry.rank == 1:
        return Cell("1", ("best" if group.best else "first",))
    return Cell(str(entry.rank), () if entry.behind else ("or 1",))


def _lines(group: Runs, entry: Entry, name: str) -> Cell:
    """Value, interval, and of an IoU the ceiling; a mask that covers everything exceeds that of a coverage."""
    metric, ceiling = entry.metrics[name], group.ceiling(ALL_MOVING, name)
    of = [f"of {formats.hundredths(ceiling)}"] if entry.kind is Kind.METHOD and "iou" in name else []
    below = formats.short_interval(metric), *([] if math.isnan(ceiling) else of)
    return Cell(formats.hundredths(metric.value), below)


def _method(entry: Entry) -> str:
    """Its name for readers, the kind of what is no method, and what is to be known of the run."""
    told = {f"{entry.failures} failures": entry.failures, "verified": entry.verified, "shipped": entry.shipped}
    return ", ".join([f"{entry.name}{_SUFFIXES[entry.kind]}", *(text for text, true in told.items() if true)])


def group_title(group: Runs) -> str:
    """Return the title of a group: what its runs have in common."""
    protocol = f"{group.protocol} ({short_digest(group.protocol_digest)})"
    every = group.rows[ALL_MOVING]
    unreviewed = f"; {group.unreviewed.rstrip('.')}" if group.unreviewed else ""
    return (
        f"{group.dataset}, {group.split or 'all recordings'}, {protocol}, "
        f"reference {short_digest(group.reference_digest)}: {group.images} images that all scored, "
        f"{every.object_frames} object-frames, {every.recordings} recordings{unreviewed}"
    )


def _group(group: Runs, pages: dict[str, str]) -> Group:
    """The tables of a group: every metric over all moving objects, IoU by kind of motion, the others behind a line."""
    kinds = [row for row in group.rows if row != ALL_MOVING]
    folded = Group(look="folded", title="All metrics of each kind of motion",
                   blocks=[_metric_table(group, row, {}) for row in kinds])  # fmt: skip
    tables: list[Block] = [
        _metric_table(group, ALL_MOVING, pages),
        _by_kind(group, kinds),
        *([folded] if kinds else []),
    ]
    tags = {"dataset": _dataset(group), "protocol": group.protocol}
    return Group(title=group_title(group), blocks=tables, tags=tags)


def _dataset(group: Runs) -> str:
    return f"{group.dataset}, {group.split}" if group.split else group.dataset


def _metric_table(group: Runs, row: str, pages: dict[str, str]) -> Table:
    """Every metric of a kind of motion, or of all; what is of whole images is the same for all kinds."""
    shown = shown_metrics(group)
    rows: list[list[object]] = [
        [_rank(group, entry), _named(entry, pages), *(_bar(group, entry, row, name) for name in shown), entry.cost_ms]
        for entry in group.entries
    ]
    columns: list[Heads] = ["Rank", "Method", *shown.values(), Column("ms per image", "{:.1f}".format)]
    ceiling = _ceiling_line(group, [(row, name) for name in shown], len(columns))
    tags: list[Tags] = [{} for _ in ceiling] + [{"method": entry.name} for entry in group.entries]
    return Table(title=formats.LABELS[row], columns=columns, rows=[*ceiling, *rows], words=2, tags=tags)


def _by_kind(group: Runs, kinds: Sequence[str]) -> Table:
    """IoU of each kind of motion."""
    headings = [*(formats.LABELS[name] for name in kinds), "False positives"]
    columns: list[Heads] = ["Rank", "IoU over all object-frames", *(Column(text, metric_cell) for text in headings)]
    keys = [*((name, ORDERED_BY) for name in kinds), (ALL_MOVING, FALSE_POSITIVES)]
    frames = [f"{group.rows[name].object_frames}, {group.rows[name].recordings}" for name in kinds]
    rows: list[list[object]] = [
        ["", "object-frames, recordings", *map(Cell, frames), None],
        *_ceiling_line(group, keys, len(columns)),
    ]
    tags: list[Tags] = [{} for _ in rows] + [{"method": entry.name} for entry in group.entries]
    rows += [[_rank(group, e), _named(e, {}), *(e.values[row][name] for row, name in keys)] for e in group.entries]
    return Table(title="By kind of motion", columns=columns, rows=rows, words=2, tags=tags)


def _named(entry: Entry, pages: dict[str, str]) -> Cell:
    return Cell(_method(entry), style="" if entry.kind is Kind.METHOD else "dim", link=pages.get(entry.run, ""))


def _bar(group: Runs, entry: Entry, row: str, name: str) -> Cell:
    """A metric with its bar, its interval across it, and a tick at its ceiling."""
    metric, cell = entry.values[row][name], metric_cell(entry.values[row][name])
    if math.isnan(metric.value) or name.startswith("chance"):
        return cell
    bar = Bar(share=metric.value, interval=metric.ci95, tick=known_ceiling(group, row, name))
    return replace(cell, bar=bar, style="strong")


def _ceiling_line(group: Runs, keys: Sequence[tuple[str, str]], columns: int) -> list[list[object]]:
    """Return the line of the exact masks, where no run of them stands in the table anyway."""
    values = [group.ceiling(row, name) for row, name in keys]
    if any(entry.kind is Kind.CEILING for entry in group.entries) or all(map(math.isnan, values)):
        return []
    cells = [None if math.isnan(value) else Cell(formats.percent(value)) for value in values]
    return [["", Cell("ceiling: the exact masks", style="dim"), *cells, *[None] * (columns - len(cells) - 2)]]


def _records(board: Leaderboard) -> Iterator[dict[str, object]]:
    """One line per run, row and metric, ratios in [0, 1]."""
    for group in board.groups:
        of_group = fields(group, OF_GROUP) | {"images_compared": group.images}
        for entry in group.entries:
            for row in group.rows:
                for name, metric in entry.values[row].items():
                    yield of_group | fields(entry, (*OF_ENTRY, "shipped")) | {
                        "row": row, "metric": name, **metric_record(metric),
                        "ceiling": known_ceiling(group, row, name), **annotations_field(group.unreviewed),
                    }  # fmt: skip


# The chart.

WIDTH_IN, HEIGHT_IN, COLUMNS = 6.2, 3.6, 2  # of a panel; panels in a row
_LEAST_MS = 1.0  # what takes less stands here with an arrow, or the axis would be one of trifles
_LABEL_PT, _LINE_LETTERS = 6.0, 34
_BESIDE_PT = 4  # from a dot to its number


@canvas.styled
def draw_quality_and_cost(groups: Sequence[Runs]) -> Figure:
    """Draw IoU over all moving object-frames against the time for an image, a panel for each data set.

    Args:
        groups: at least one, of the same protocol.
    """
    columns = min(len(groups), COLUMNS)
    rows = -(-len(groups) // columns)
    figure = canvas.new_figure(WIDTH_IN * columns, HEIGHT_IN * rows, layout="constrained")
    for number, group in enumerate(groups, start=1):
        _draw(figure.add_subplot(rows, columns, number, xscale="log"), group)
    return figure


def _draw(axes: Axes, group: Runs) -> None:
    timed = [entry for entry in group.methods if entry.cost_ms is not None]
    for entry in timed:
        metric, first = entry.metrics[ORDERED_BY], entry is group.methods[0]
        at_ms, value = _at(entry)
        if metric.ci95 is not None:
            axes.plot([at_ms] * 2, [100 * end for end in metric.ci95], color=canvas.GREY, linewidth=0.8, zorder=2)
        marker = "D" if first else "<" if _trifling(entry) else "o"
        colour = canvas.VERMILION if first else canvas.BLUE
        name = f"{entry.rank} {_label(entry)}"
        axes.plot([at_ms], [value], marker, markersize=6 if first else 4.5, color=colour, zorder=3, label=name)
        side = 1 if (entry.rank or 0) % 2 else -1  # numbers of neighbours stand on different sides
        axes.annotate(
            str(entry.rank),
            xy=(at_ms, value),
            xytext=(side * _BESIDE_PT, 0),
            textcoords="offset points",
            fontsize=_LABEL_PT,
            va="center",
            ha="left" if side > 0 else "right",
        )
    bounds = [(e.name, 100 * e.metrics[ORDERED_BY].value) for e in group.entries if e.kind is not Kind.METHOD]
    if not any(entry.kind is Kind.CEILING for entry in group.entries):
        bounds.append(("ceiling", 100 * group.ceiling(ALL_MOVING, ORDERED_BY)))
    bounds = [(label, value) for label, value in bounds if not math.isnan(value)]
    times = [_at(entry)[0] for entry in timed] or [_LEAST_MS]
    axes.set(xlim=(_LEAST_MS / 1.5, 1.5 * max(times)), ylim=(0, 100))
    for label, value in bounds:
        axes.axhline(value, color=canvas.BLACK, linewidth=0.7, linestyle="--", zorder=1)
        axes.text(_LEAST_MS / 1.4, value + 0.6, label, fontsize=_LABEL_PT, color="#303030", va="bottom")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1), frameon=False, fontsize=_LABEL_PT, handletextpad=0.3)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda ms, _: f"{ms:g}"))
    axes.set_xlabel("time of the method for an image, one thread (ms)")
    axes.set_ylabel("IoU over all moving object-frames (%)")
    axes.set_title(
        f"{group.dataset}, {group.protocol}: {group.images} images, {group.rows[ALL_MOVING].recordings} recordings",
        pad=4,
    )
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color=canvas.LIGHT_GREY, linewidth=0.4)
    axes.set_axisbelow(True)


def _at(entry: Entry) -> tuple[float, float]:
    assert entry.cost_ms is not None, "only methods with a cost are drawn"
    return max(entry.cost_ms, _LEAST_MS), 100 * entry.metrics[ORDERED_BY].value


def _trifling(entry: Entry) -> bool:
    return entry.cost_ms is not None and entry.cost_ms < _LEAST_MS


def _label(entry: Entry) -> str:
    """The method's name in lines of bounded length; only a word that is longer is broken."""
    name = entry.name + (f" (below {_LEAST_MS:g} ms)" if _trifling(entry) else "")
    return textwrap.fill(name, _LINE_LETTERS, break_on_hyphens=False)


# The same images as every run of a group was scored on them. An image is stored once, behind a strip; what a run made
# of it is a layer of flat colours, one pixel in two, which takes a kilobyte.

WIDTH_PX, LAYER_PX = 480, 320
QUALITY, STRENGTH = 72, 170  # of JPEG; of the colours, of 255


def _strips(group: Runs, progress: Progress | None) -> tuple[list[Group], list[str]]:
    """Draw one image of each kind of motion: that in which an object of it fills most pixels, whoever finds it.

    Returns:
        strips: the image with the areas of each run that could be drawn, in the order of the table.
        problems: why others could not, one line each.
    """
    images: dict[ImageKey, str] = {}
    photographs: dict[ImageKey, str] = {}
    layers: dict[ImageKey, list[Picture]] = {}
    problems: dict[str, None] = {}

    def draw(key: ImageKey, frames: Sequence[ProcessedFrame], _: FramePipeline) -> tuple[str, str]:
        if key not in photographs:
            photographs[key] = canvas.jpeg_uri(_photograph(frames[0].pixels), quality=QUALITY)
        return _layer(frames[0]), false_positive_text(frames[0])

    own = [entry for entry in group.entries if not entry.shipped]
    for number, entry in enumerate(own, start=1):
        try:
            run = read_run(entry.folder, label=entry.run)
            images = images or {key: formats.LABELS[kind] for kind, key in example_frames(run.objects).items()}
            drawn, failed = draw_images([run], images, draw)
        except BenchError as error:
            drawn, failed = {}, [str(error)]
        problems |= dict.fromkeys(f"{entry.run}: {problem}" for problem in failed)
        for key, (layer, note) in drawn.items():
            text = f"{entry.name}{_SUFFIXES[entry.kind]}: {note}"
            layers.setdefault(key, []).append(Picture(layer, text, text, tags={"method": entry.name}))
        if progress is not None:
            progress(number, len(own))
    strips = [
        Group(look="strip", title=f"{kind}: {formats.image_name(*key)}", blocks=layers[key], backdrop=photographs[key])
        for key, kind in images.items() if key in layers
    ]  # fmt: skip
    return strips, list(problems)


def _photograph(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    grey = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    height = round(grey.shape[0] * WIDTH_PX / grey.shape[1])
    return np.asarray(cv2.resize(grey, (WIDTH_PX, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _layer(frame: ProcessedFrame) -> str:
    classes = pixel_classes(frame.reference, detected=detected_pixels(frame))
    step = max(1, round(classes.shape[1] / LAYER_PX))
    classes = classes[step // 2 :: step, step // 2 :: step]
    layer = np.zeros((*classes.shape, 4), dtype=np.uint8)
    for kind, colour in AREA_COLOURS.items():
        layer[classes == kind] = (*canvas.rgb(colour)[::-1], STRENGTH)
    return canvas.layer_uri(layer)


# The files.

CHART = "quality-and-cost"
TITLE = "Leaderboard: which method finds what moves"
ABOUT = (
    "Methods that mark what moves in the images of a driving car's fisheye camera, on the same images. Ranked by "
    f"{RANKING_PROTOCOL}, which ranks methods as exact masks would if they make similar errors; other protocols are "
    "carried along."
)
ENTER = (
    "A method is a class in a Python file, or a folder of masks. This scores it on the same images and puts it beside "
    "the others; send the folder of its run as a zip file with a link to its code:"
)
ENTER_COMMAND = """fisheye-bench leaderboard reports/runs --score demo --methods my_method:MyMethod --out board
fisheye-bench evaluate demo --predictions my_masks/ --protocol surface-v1
fisheye-bench verify reports/runs/demo/my_method-MyMethod"""


def write_leaderboard(
    board: Leaderboard, out: Path, *, pictures: bool = True, progress: Progress | None = None
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Write `index.html`, `leaderboard.md`, `.csv`, `.json`, `.tex` and the chart, each file whole or not at all.

    Args:
        board: the runs.
        out: folder, is made.
        pictures: show the same images as every run of rendered data was scored on them; needs the data sets.
        progress: called with the runs drawn and their number, for each group anew.

    Returns:
        files: the page first.
        problems: why pictures are missing, one line each.
    """
    judged = [group for group in board.groups if group.judged]
    charted = [group for group in judged if any(entry.cost_ms is not None for entry in group.methods)]
    strips, problems = dict[str, list[Group]](), list[str]()
    for group in judged if pictures else ():
        # A page may be passed on; images of recorded data sets may not.
        if _dataset(group) not in strips and is_rendered(group.card):
            strips[_dataset(group)], missing = _strips(group, progress)
            problems += missing
    chart = Picture(
        f"{CHART}.png",
        f"IoU of each method under {RANKING_PROTOCOL} against its time for an image",
        f"The time of a method against its IoU under {RANKING_PROTOCOL}; the diamond is the first method, dashed lines "
        "are what bounds all of them. The page beside this file, index.html, also shows methods on images.",
    )
    faults = Items([f"{run}: {fault}" for run, fault in board.damaged])
    damaged = Group(look="section", name="damaged", title="Runs that cannot be read", blocks=[faults])
    unread = [damaged] if board.damaged else []
    notes = [Paragraph(" ".join(_notes(board)))]
    sections = [Group(look="section", title=group_title(g), blocks=_group(g, {}).blocks[:2]) for g in board.groups]
    content, page, paper = out / "leaderboard.json", out / "index.html", out / "leaderboard.tex"
    text = to_json(as_content(board))
    refuse_foreign(content, text)
    report = Report(
        title="Leaderboard",
        blocks=[*notes, *([chart] if charted else []), *sections, _methods(board), *unread],
        numbers=_records(board),
    )
    write_output(page, to_page(TITLE, [*_page(board, out, charted, strips), *unread], folder=out))
    files = (page, *report.write(out, "leaderboard"), content, paper)
    write_text(content, text)
    write_text(paper, "\n".join(map(_latex, judged or board.groups)))
    if charted:
        files += write_picture(out / CHART, draw_quality_and_cost(charted))
    return files, tuple(problems)


def _latex(group: Runs) -> str:
    """The methods of a group by its metrics, as a float."""
    shown = shown_metrics(group)
    table = Table(
        columns=["Method", *(Column(label, metric_cell) for label in shown.values()), Column("ms", "{:.1f}".format)],
        rows=[[_method(entry), *map(entry.metrics.get, shown), entry.cost_ms] for entry in group.entries],
    )
    return to_latex(table, label=f"{group.dataset}-{group.protocol}", caption=f"{group_title(group)}.")


def _methods(board: Leaderboard) -> Group:
    """What each method does, where its code is, and the runs that the tables show."""
    entries = [entry for group in board.groups if group.judged or len(board.groups) == 1 for entry in group.entries]
    rows = [[e.name, e.method, e.about, e.code_file, e.run, e.images, e.date, e.code] for e in entries]
    columns = ["Method", "Called", "What it does", "Code", "Run", "Images", "Scored", "by"]
    table = Table(columns=columns, rows=rows, words=len(columns), tags=[{"method": e.name} for e in entries])
    return Group(look="section", name="methods", title="The methods", blocks=[table])


def _page(board: Leaderboard, out: Path, charted: Sequence[Runs], strips: dict[str, list[Group]]) -> Iterator[Block]:
    yield Paragraph(ABOUT)
    for best in best_methods(board):
        others = best["not_behind"]
        assert isinstance(others, list)
        doubt = f" Not shown to be behind it: {', '.join(others)}." if others else ""
        yield Paragraph(
            f"{str(best['rank']).capitalize()} of {best['of']} on {best['dataset']}: {best['method']}, "
            f"{best['score']}. Scored {best['date']} with {best['code']}.{doubt}",
            "good" if best["rank"] == "best" else "dim",
        )
    first = board.groups[0] if board.groups else None
    choices = [
        Choice("dataset", "Data set", "" if first is None else _dataset(first)),
        Choice("protocol", "Protocol", "" if first is None else first.protocol),
        Choice("method", "Method"),
        Choice("method", "and method"),
    ]
    tables = [_group(group, _pages(group, out)) for group in board.groups]
    how = "Bars: the value, across it its 95 % interval, the tick the ceiling. A linked name leads to its page."
    yield Group(look="section", name="table", title="All runs",
                blocks=[Filters(choices), *tables, Paragraph(how, "dim")])  # fmt: skip
    if charted:
        charts = [
            Group(blocks=[Chart(
                name=f"{CHART}-{number}",
                figure=draw_quality_and_cost([group]),
                label=f"Time of each method for an image against its IoU on {group.dataset}",
            ).drawing()], tags={"dataset": _dataset(group)})
            for number, group in enumerate(charted, start=1)
        ]  # fmt: skip
        about = "Up is better, left is cheaper. The diamond is the first method; dashed lines bound all of them."
        yield Group(look="section", name="cost", title="Quality against cost", blocks=[Paragraph(about), *charts])
    if any(strips.values()):
        about = (
            "Of each kind of motion the image in which an object of it fills most pixels, whoever finds it. Green is "
            "found, blue missed, orange wrongly marked, yellow an unknown band, grey not scored. The filters above "
            "choose two methods."
        )
        shown = [Group(blocks=of_data, tags={"dataset": name}) for name, of_data in strips.items()]
        yield Group(look="section", name="pictures", title="Methods on the same images",
                    blocks=[Paragraph(about), *shown])  # fmt: skip
    yield _methods(board)
    yield Group(look="section", name="enter", title="How to enter", blocks=[Paragraph(ENTER), Code(ENTER_COMMAND)])
    yield Group(look="section", name="how", title="How to read it",
                blocks=[Paragraph(note, "dim") for note in _notes(board)])  # fmt: skip


def _pages(group: Runs, out: Path) -> dict[str, str]:
    """Addresses of the pages of runs inside `out`; others do not travel with the leaderboard and are no links."""
    pages = {entry.run: (entry.folder / "index.html").resolve() for entry in group.entries if not entry.shipped}
    inside = {run: page for run, page in pages.items() if page.is_relative_to(out.resolve()) and page.is_file()}
    return {run: quote(page.relative_to(out.resolve()).as_posix()) for run, page in inside.items()}
