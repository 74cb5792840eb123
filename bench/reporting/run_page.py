"""The page of a run: what a reader should know first, all metrics and charts, the worst cases, every object-frame.

`write_page` reads what a run has stored and makes the blocks of its sections. Only pictures go back to the data set;
without the data the page is complete but for them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from urllib.parse import quote

from bench.atomic import write_output
from bench.evaluation import find_metric, published
from bench.evaluation.definitions import IMAGE_FRAMES
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.rows import EVALUATED
from bench.evaluation.summary import ObjectMetrics, Summary, not_annotated
from bench.evaluation.sums import CLASS_AND_SPEED, recording_values
from bench.harness.stages import Progress
from bench.harness.stored import StoredRun, read_run
from bench.plain_text import counted
from bench.reporting.document import (
    Block,
    Cell,
    Choice,
    Code,
    Column,
    Filters,
    Group,
    Items,
    Paragraph,
    Picture,
    Table,
    to_page,
)
from bench.reporting.figures import Chart, draw_charts, figure_uri
from bench.reporting.formats import LABELS, bar_cell, chance_of, headline_metrics, image_name, metric_cell, percent
from bench.reporting.frame import draw_frames, scored_layers
from bench.reporting.frame_pictures import draw_images, example_frames
from bench.reporting.run_tables import (
    is_rendered,
    left_out_note,
    legend,
    rows_with_cases,
    table_rows,
    text_tables,
    threshold_free_line,
)
from bench.reporting.worst_cases import (
    FILTERS,
    IMAGE_NOTE,
    OBJECT_NOTE,
    Card,
    gallery,
    object_table,
    view_command,
    worst_cases,
)

LISTED_RECORDINGS = 200
WORST = 3  # of each kind
EXAMPLES = 2  # pictures that a reader sees first
LEAST_OBJECT_FRAMES = 10  # of fewer nothing is said
COLOURS = "Green is found, blue missed, orange wrongly marked."
_HALF = "detection_rate_50"


# The sections at the top: headlines, kinds of motion, other breakdowns.


def tiles(metrics: Summary) -> Table:
    """The headline metrics as cards, with what bounds them."""
    row, shown = metrics.all_moving, dict[str, Cell]()
    for name, metric in headline_metrics(metrics).items():
        label, cell = find_metric(name).label, replace(metric_cell(metric), style="strong")
        if find_metric(name).over == IMAGE_FRAMES:
            about = f"of the image wrongly marked; over {metric.cases} images"
            shown[label] = replace(cell, below=(*cell.below, about))
        elif row.object_frames < LEAST_OBJECT_FRAMES:
            few = f"{row.object_frames} object-frames, fewer than {LEAST_OBJECT_FRAMES}"
            shown[label] = Cell("n/a", (few,), "strong")
        else:
            about = "; ".join(filter(None, (_bound_note(name, row), f"over {row.object_frames} object-frames")))
            shown[label] = replace(cell, below=(*cell.below, about))
    return Table(columns=list(shown), rows=[list(shown.values())], words=0, look="tiles")


def _bound_note(name: str, row: ObjectMetrics) -> str:
    """Return what bounds a metric of a row: the chance level of a detection rate, the ceiling of IoU; "" for none."""
    other = chance_of(name) if name.startswith("detection_rate") else f"ceiling_{name}"
    if other not in row.metric_names() or name == "tpr_all" or math.isnan(row.metric(other).value):
        return ""
    return f"{other.partition('_')[0]} {percent(row.metric(other).value)}"


def against_chance(row: ObjectMetrics) -> Cell:
    """Compare the rate of object-frames of which half is found, or any pixel by a protocol without that level.

    It is "bad" where the rate is not shown to be above chance; to be above it is the least and no praise.
    """
    half = _HALF if _HALF in row.metric_names() else "detection_rate"
    rate, chance = row.metric(half), row.metric(chance_of(half)).value
    if row.object_frames < LEAST_OBJECT_FRAMES:
        return Cell("cannot tell", (f"fewer than {LEAST_OBJECT_FRAMES} object-frames",))
    if math.isnan(chance):
        return Cell("cannot tell", ("no chance level",))
    if rate.ci95 is None:
        return Cell("cannot tell", (f"{FEWEST_RECORDINGS} recordings are needed",))
    if rate.ci95[0] > chance:
        return Cell("above")
    return Cell("not shown to be above", style="bad")


def lowest_of(rows: Mapping[str, ObjectMetrics]) -> str | None:
    """The row with the lowest IoU; None where no interval of another lies wholly above its own."""
    known = {
        name: (row.iou.value, *row.iou.ci95)
        for name, row in rows.items()
        if row.object_frames >= LEAST_OBJECT_FRAMES and row.iou.ci95
    }
    lowest = min(known, key=lambda name: known[name][0], default=None)
    if lowest is None or all(low <= known[lowest][2] for _, low, _ in known.values()):
        return None
    return lowest


BREAKDOWN_METRICS = ("iou", "tpr_all", "detection_rate_50", "detection_rate", "unknown_share")
KINDS = "By kind of motion, the lowest IoU first"
BREAKDOWNS = {  # caption and heading of the first column, by name
    "object_class": ("By class", "class"),
    "range_m": ("By range", "nearest point (m)"),
    "speed_mps": ("By the object's own speed", "speed (m/s)"),
    CLASS_AND_SPEED: ("By class and the object's own speed", "class, speed (m/s)"),
    "ego_speed_mps": ("By speed of the ego vehicle", "speed (m/s)"),
    "camera": ("By camera", "camera"),
    "points": ("By lidar points on the object", "points"),
}


def kinds_of_motion(metrics: Summary) -> dict[str, ObjectMetrics]:
    """The kinds of motion that have object-frames, by their labels, the lowest IoU first."""
    rows = {LABELS[name]: row for name, row in metrics.categories.items() if row.object_frames}
    return dict(sorted(rows.items(), key=lambda item: item[1].iou.value))


def breakdowns(metrics: Summary) -> list[Table]:
    """One table for every way to sort the object-frames; slices without any are left out."""
    tables = []
    for name, rows in metrics.breakdowns.items():
        if with_cases := {slice_name: row for slice_name, row in rows.items() if row.object_frames}:
            tables.append(breakdown_table(*BREAKDOWNS[name], with_cases))
    return tables


def breakdown_table(caption: str, heading: str, rows: Mapping[str, ObjectMetrics]) -> Table:
    """One way to sort the object-frames; the lowest row is marked where it is clearly lower.

    Args:
        caption: of the table.
        heading: of its first column.
        rows: by name, those without cases included; what all of them have is shown.
    """
    names = [name for name in BREAKDOWN_METRICS if all(name in row.metric_names() for row in rows.values())]
    lowest = lowest_of(rows)
    return Table(
        title=caption,
        columns=[heading, *(find_metric(name).label for name in names), "against chance", "object-frames", "objects",
                 "recordings"],
        rows=[
            [key]
            + [bar_cell(row.metric(n), _bound_note(n, row), lowest=n == "iou" and key == lowest) for n in names]
            + [against_chance(row), row.object_frames, row.tracks, row.recordings]
            for key, row in rows.items()
        ],
    )  # fmt: skip


def remarks(metrics: Summary) -> Iterator[Paragraph]:
    """What a reader should know first: where IoU is clearly lower than elsewhere, and what could not be scored."""
    kinds = kinds_of_motion(metrics)
    if not kinds:
        why = not_annotated(metrics) or "No object-frame was evaluated: there is nothing to say of moving objects."
        yield Paragraph(why, "warn")
    split = {KINDS: kinds} | {caption: metrics.breakdowns.get(name, {}) for name, (caption, _) in BREAKDOWNS.items()}
    lowest = {caption.partition(",")[0]: (rows, lowest_of(rows)) for caption, rows in split.items()}
    named = [f"{by[3:]}: {name} with {percent(rows[name].iou.value)}" for by, (rows, name) in lowest.items() if name]
    if named:
        yield Paragraph(f"IoU is clearly lower than elsewhere, by {'; by '.join(named)}.", "bad")
    images = metrics.images
    if left := images.failed + images.skipped:
        yield Paragraph(f"{left} of {images.images} images could not be scored; the last section says why.", "bad")


def _examples(run: StoredRun) -> Iterator[Block]:
    """The images in which the largest objects of some kinds of motion are."""
    largest = list(example_frames(run.objects).items())[:EXAMPLES]
    titles = {key: f"{LABELS[kind]}, the largest object: {image_name(*key)}" for kind, key in largest}
    uris, problems = draw_images(
        [run],
        titles,
        lambda key, frames, _: figure_uri(draw_frames([scored_layers(frames[0])], name=image_name(*key))),
    )
    yield from map(_missing, problems)
    yield Group(look="pairs", blocks=[Picture(uris[key], title, title) for key, title in titles.items() if key in uris])
    yield Paragraph(f"{COLOURS} These are the largest objects; what was found least is among the worst cases.", "dim")


def _missing(problem: str) -> Paragraph:
    return Paragraph(f"Pictures are missing: {problem}", "warn")


def _glance(run: StoredRun, *, pictures: bool) -> Iterator[Block]:
    metrics, failures = run.metrics, run.summary.failures
    yield Paragraph("What a reader should know first; every sentence is computed from the values below.")
    yield tiles(metrics)
    yield from remarks(metrics)
    if failures:
        text = f"{len(failures)} failures while scoring: all values are of the rest, the last section lists them."
        yield Paragraph(text, "bad")
    if pictures:
        yield from _examples(run)
    kinds = kinds_of_motion(metrics)
    if kinds:
        yield breakdown_table(KINDS, "kind", kinds)
        yield Paragraph(
            "Bars: long is good; the line across is the 95 % interval. “Lowest” marks the smallest IoU of a table "
            "where its interval lies wholly below that of another row. Against chance: the share of object-frames of "
            "which half is found, compared with the same objects on the mask of another image.",
            "dim",
        )
    words = {find_metric(name).label: find_metric(name).meaning for name in headline_metrics(metrics)}
    words["Object-frame"] = "One moving object in one image. The same object in ten images makes ten."
    yield Group(look="folded", title="The words used here", blocks=[_about_table(words)])


def _results(run: StoredRun) -> list[Block]:
    """Ours, beside the paper's where that says something, and all metrics with their intervals behind a line."""
    beside = is_rendered(run.manifest.dataset.card)
    rows = table_rows(run.metrics, beside_paper=beside)
    behind = ", with the paper's value and the difference behind ours" if beside else ""
    first, *others = (replace(table, note="") for table in text_tables(rows_with_cases(rows)) if len(table.rows))
    left_out = [Paragraph(note, "dim") for note in (left_out_note(rows), legend(rows)) if note]
    folded = Group(look="folded", title="All metrics with their intervals", blocks=others)
    return [Paragraph(f"Each row is a kind of motion{behind}."), first, folded, *left_out]


# The other sections.


def _recording_table(run: StoredRun, cards: Sequence[Card]) -> Table:
    """The recordings with the lowest IoU first, those without object-frames last; at most `LISTED_RECORDINGS`."""
    values, cases = recording_values(run.sums)
    table = values[["iou", "tpr_all", "false_positive_coverage"]].assign(
        object_frames=cases["iou"], images=cases["false_positive_coverage"]
    )
    table = table.reset_index().sort_values(["iou", "recording"], ignore_index=True)
    first = {card.key[0]: card.element for card in reversed(cards)}
    shares = [Column(heading, percent) for heading in ("IoU, all", "TPR, all", "wrongly marked")]
    counts = [Column(heading, "{:.0f}".format) for heading in ("object-frames", "images")]
    shown = f", {LISTED_RECORDINGS} of {len(table)}" if len(table) > LISTED_RECORDINGS else ""
    return Table(
        title=f"By recording, over all its object-frames, the lowest IoU first{shown}",
        columns=["recording", *shares, *counts, "to look at"],
        rows=[
            [Cell(name, link=f"#recording={quote(name)}"), *values,
             Cell("worst case", link=f"#{first[name]}") if name in first else None]
            for name, *values in table[:LISTED_RECORDINGS].itertuples(index=False)
        ],
    )  # fmt: skip


def _cause_table(metrics: Summary) -> Table | None:
    """The causes of false marks, the largest first; None where the method names none."""
    causes = {name: cause for name, cause in metrics.false_positive_causes.items() if not math.isnan(cause.value)}
    ordered = sorted(causes.items(), key=lambda item: -item[1].value)
    rows = [[name.replace("_", " "), bar_cell(cause)] for name, cause in ordered]
    title = "Share of the falsely marked pixels"
    return Table(title=title, columns=["cause", "share"], rows=rows, look="narrow") if rows else None


def _about_table(rows: Mapping[str, str]) -> Table:
    return Table(columns=["", ""], rows=list(rows.items()), words=2, look="about")


def _ledger_tables(metrics: Summary) -> list[Table]:
    """The outcome of every annotated object-frame and of every image."""
    objects, images = metrics.objects, metrics.images
    of_objects = {"evaluated": objects.evaluated, "static": objects.static}
    of_objects |= {f"ignored: {reason.replace('_', ' ')}": number for reason, number in objects.ignored.items()}
    of_images = {"scored": images.evaluated, "skipped, without an image before": images.skipped}
    of_images |= {"failed": images.failed, "not annotated": images.not_annotated}
    ledgers = {
        "Annotated object-frames": of_objects | {"annotated, the sum": objects.annotated},
        "Images": of_images | {"all, the sum": images.images},
    }
    return [
        Table(title=title, columns=["outcome", "number"], rows=list(rows.items()), look="narrow")
        for title, rows in ledgers.items()
    ]


def _object_section(run: StoredRun, cards: Sequence[Card]) -> Group:
    table, annotated = object_table(run, cards)
    few = "Every annotated object in every image."
    if len(table.rows) < annotated:
        few = (f"The run has {annotated:,} object-frames, more than a page can hold: here are the {len(table.rows):,} "
               "that were found least; its folder counts has all.")  # fmt: skip
    about = (
        f"{few} Press a heading to sort, type or choose to filter. An object leads to its picture; where the page "
        "holds none, this command draws it, with recording, camera and time of the row:"
    )
    choices = [Choice(tag, label, EVALUATED if tag == "outcome" else "") for tag, label in FILTERS.items()]
    blocks: list[Block] = [Paragraph(about), Code(view_command(run)), Filters(choices, "Search"), table]
    title = "All object-frames" if len(table.rows) == annotated else "Object-frames"
    return Group(look="section", name="frames", title=title, count=f"{len(table.rows):,} rows", blocks=blocks)


# The page.


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """Page that was written.

    Attributes:
        file: the page.
        problems: why pictures are missing, one line each.
    """

    file: Path
    problems: tuple[str, ...]


def write_page(
    folder: Path, *, out: Path | None = None, pictures: bool = True, progress: Progress | None = None
) -> Page:
    """Write the page of a run.

    Args:
        folder: of the run or of its results by a protocol.
        out: the file; `index.html` beside the results without it.
        pictures: process the worst images once more and show them.
        progress: called with the images done and their number.

    Raises:
        DataError: a stored result is missing or damaged. Missing data for pictures is no error; it is said.
    """
    run = read_run(folder)
    galleries, missing = worst_cases(run, most=WORST, pictures=pictures, progress=progress)
    title = f"{run.manifest.method.name} on {run.manifest.dataset.name}"
    blocks = [*_head(run), *_sections(run, galleries, missing, pictures=pictures)]
    file = out or run.folder / "index.html"
    write_output(file, to_page(title, blocks, folder=run.folder))
    return Page(file=file, problems=tuple(missing))


def _head(run: StoredRun) -> list[Block]:
    manifest, summary = run.manifest, run.summary
    data, method = manifest.dataset, manifest.method
    settings = ", ".join(f"{name} = {value}" for name, value in method.changed_settings().items())
    split = f", split {data.split}" if data.split else ""
    images = f"{summary.images.evaluated} images of {summary.false_positives.recordings} recordings"
    about = {
        "Data": f"{data.name} ({data.card}){split}: {images}. {summary.caveats}".rstrip(),
        "Method": f"{method.name} ({method.place}); {settings or 'all settings as by default'}.",
        "Protocol": f"{manifest.protocol.name}, version {manifest.protocol.version}",
        "Run": f"{run.label}, {summary.provenance.started_utc[:16]} UTC, fisheye-bench {manifest.code.version}",
    }
    if is_rendered(data.card):
        about["Paper"] = f"{published.SOURCE}. Its values stand beside as “paper”: same form, not the same data."
    intro = (
        f"How well the method “{method.name}” marks what moves in the camera images of a driving car, measured against "
        "outlines made from lidar."
    )
    return [Paragraph(intro), _about_table(about)]


def _sections(
    run: StoredRun, galleries: Mapping[str, Sequence[Card]], missing: Sequence[str], *, pictures: bool
) -> Iterator[Group]:
    """The sections of the page, each of which opens with a sentence."""
    section = partial(Group, look="section")
    metrics, summary, made = run.metrics, run.summary, run.summary.provenance
    cards = [card for of_gallery in galleries.values() for card in of_gallery]
    charts = draw_charts(run)
    yield section(name="glance", title="At a glance", blocks=[*_glance(run, pictures=pictures and not missing)])
    yield section(name="results", title="Results by kind of motion", blocks=_results(run))
    tables = breakdowns(metrics)
    yield section(name="splits", title="Broken down", count=f"{len(tables)} tables", blocks=[
        Paragraph("The same object-frames sorted in other ways, to see where the method fails. Bins are half-open: "
                  "[2, 4) holds 2 but not 4."), *tables])  # fmt: skip
    by_recording = _recording_table(run, cards)
    yield section(name="recordings", title="By recording", count=f"{len(by_recording.rows)} recordings", blocks=[
        Paragraph("Where to look first: a name shows its object-frames in the table below, “worst case” its picture."),
        by_recording])  # fmt: skip
    yield section(name="around", title="Around the ego vehicle", blocks=[
        Paragraph("The ground seen from above, the ego vehicle in the middle driving upwards: yellow cells mark places "
                  "where objects were found, dark ones where they were missed; hatched cells hold too few to say."),
        charts["around"][0].drawing()])  # fmt: skip
    over_all = "" if summary.threshold_free is None else threshold_free_line(summary.threshold_free)
    yield _chart_section("threshold", "Other thresholds", charts["threshold"],
        "The run holds no likelihoods: its method gives masks only.",
        "What other thresholds of the motion likelihood would give: more found on the way up, more wrongly marked "
        f"on the way right. The dot is the run as it was scored. {over_all}".rstrip())  # fmt: skip
    if causes := _cause_table(metrics):
        yield section(name="causes", title="Causes of the false marks", count=f"{len(causes.rows)} causes", blocks=[
            Paragraph("Every falsely marked pixel is counted for the part of the method that contributes most to "
                      "the likelihood there."), causes])  # fmt: skip
    why = "the data set was not available" if pictures else "the page was made without pictures"
    yield section(name="worst", title="Worst cases", count=f"{len(cards)} cases", blocks=[
        Paragraph("The object-frames of each kind that were found least, one of each object, and the images with most "
                  f"false marks. {COLOURS} {OBJECT_NOTE} {IMAGE_NOTE}"),
        *map(_missing, missing),
        *(block for title, of_kind in galleries.items() for block in gallery(title, of_kind, missing=why)),
    ])  # fmt: skip
    yield _object_section(run, cards)
    yield section(name="origin", title="Origin of the values", blocks=[
        Paragraph(f"What made this run, started {made.started_utc}; the same code, settings and data give the same "
                  f"values. At most {made.peak_memory_mb:.0f} MB of memory."),
        Group(look="folded", title="manifest.json", blocks=[Code(run.manifest.model_dump_json(indent=1))]),
    ])  # fmt: skip
    messages = [f"{number} x {problem}" for problem, number in summary.images.problems.items()]
    yield section(name="ledger", title="What was left out, and why", count=f"{len(summary.failures)} failures", blocks=[
        Paragraph("Every annotated object in every image ends in exactly one of these lines; detections on ignored "
                  "objects count neither as right nor as wrong."),
        *_ledger_tables(metrics),
        *_folded("Messages of images that were not scored", messages),
        *_folded(f"{len(summary.failures)} failures", summary.failures)])  # fmt: skip


def _folded(title: str, lines: Sequence[str]) -> list[Group]:
    return [Group(look="folded", title=title, blocks=[Items(lines)])] if lines else []


def _chart_section(name: str, title: str, charts: Sequence[Chart], none: str, about: str) -> Group:
    shown: Block = Group(look="charts", blocks=[chart.drawing() for chart in charts])
    blocks = [Paragraph(about), shown if charts else Paragraph(none, "warn")]
    return Group(look="section", name=name, title=title, count=counted(len(charts), "chart"), blocks=blocks)
