"""The page of a run: what a reader should know first, all metrics and charts, the worst cases, every object-frame.

`write_page` reads what a run has stored and makes the blocks of its sections. Only pictures go back to the data set;
without the data the page is complete but for them.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pandas as pd
from matplotlib.figure import Figure

from bench.atomic import write_output
from bench.evaluation import published
from bench.evaluation.definitions import IMAGE_FRAMES, coverage, false_share, find_metric, intersection_over_union
from bench.evaluation.protocol import known_protocols
from bench.evaluation.rows import EVALUATED, IMAGE, OBJECT, pick, sort_rows
from bench.evaluation.summary import ObjectMetrics, Summary, not_annotated
from bench.evaluation.sums import CLASS_AND_SPEED, recording_values
from bench.execution import Progress
from bench.harness.frames import ProcessedFrame
from bench.harness.stored import StoredRun, read_run
from bench.plain_text import counted
from bench.records.reference import Category
from bench.reporting import figures, formats
from bench.reporting.document import (
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
    Table,
    section,
    to_page,
)
from bench.reporting.frame import draw_frames, draw_panels, scored_layers
from bench.reporting.frame_pictures import LARGEST, ImageKey, draw_images, example_frames
from bench.reporting.run_tables import (
    is_beside_paper,
    left_out_note,
    legend,
    results_table,
    table_rows,
    threshold_free_line,
)

WORST = 3  # of each kind
EXAMPLES = 2  # pictures that a reader sees first
AROUND = "Detection rate around the ego vehicle seen from above, by class and direction of motion"
THRESHOLDS = "Pixels found against image wrongly marked"
COLOURS = "Green is found, blue missed, orange wrongly marked."


# What to know first, and the breakdowns.


def tiles(metrics: Summary, *, large_px: int) -> Table:
    """The headline metrics as cards, with what bounds them.

    Args:
        metrics: of the run.
        large_px: pixels that a large false component exceeds.
    """
    row, false = metrics.all_moving, metrics.false_positives
    shown = {}
    for name, metric in (formats.headline_metrics(metrics) | {formats.LARGE_FALSE: false.frame_rate}).items():
        if name == formats.LARGE_FALSE:
            about = f"of the images have a false patch of more than {large_px} px"
        elif find_metric(name).over == IMAGE_FRAMES:
            about = f"of the image wrongly marked; over {counted(metric.cases, 'image')}"
        else:
            over = f"over {counted(row.object_frames, 'object-frame')}"
            about = "; ".join(filter(None, (_bound_note(name, row), over)))
        cell = formats.metric_cell(metric)
        shown[find_metric(name).label] = replace(cell, below=(*cell.below, about), style="strong")
    return Table(columns=list(shown), rows=[list(shown.values())], words=0, look="tiles")


def _bound_note(name: str, row: ObjectMetrics) -> str:
    """Return what bounds a metric of a row: the chance level of a detection rate, the ceiling of IoU; "" for none."""
    other = formats.chance_of(name) if name.startswith("detection_rate") else f"ceiling_{name}"
    if other not in row.metric_names() or name == "tpr_all" or math.isnan(row.metric(other).value):
        return ""
    return f"{other.partition('_')[0]} {formats.percent(row.metric(other).value)}"


BREAKDOWN_METRICS = ("iou", "tpr_all", "detection_rate_50", "detection_rate", "unknown_share")
BREAKDOWNS = {  # caption and heading of the first column, by name
    "object_class": ("By class", "class"),
    "range_m": ("By range", "nearest point (m)"),
    "speed_mps": ("By the object's own speed", "speed (m/s)"),
    CLASS_AND_SPEED: ("By class and the object's own speed", "class, speed (m/s)"),
    "ego_speed_mps": ("By speed of the ego vehicle", "speed (m/s)"),
    "camera": ("By camera", "camera"),
    "points": ("By lidar points on the object", "points"),
}


def breakdown_tables(metrics: Summary) -> list[Table]:
    """Each way to sort the object-frames, of those slices that have any; what all of these have is shown."""
    tables = []
    for breakdown, every in metrics.breakdowns.items():
        rows = {key: row for key, row in every.items() if row.object_frames}
        names = [name for name in BREAKDOWN_METRICS if all(name in row.metric_names() for row in rows.values())]
        title, heading = BREAKDOWNS[breakdown]
        columns = [heading, *(find_metric(name).label for name in names), "object-frames", "objects", "recordings"]
        cells = [
            [key]
            + [formats.bar_cell(row.metric(name), _bound_note(name, row)) for name in names]
            + [row.object_frames, row.tracks, row.recordings]
            for key, row in rows.items()
        ]
        tables += [Table(title=title, columns=columns, rows=cells)] if rows else []
    return tables


def remarks(metrics: Summary, failures: Sequence[str] = ()) -> Iterator[Paragraph]:
    """What a reader should know first: what could not be scored."""
    if not metrics.all_moving.object_frames:
        why = not_annotated(metrics) or "No object-frame was evaluated: there is nothing to say of moving objects."
        yield Paragraph(why, "warn")
    images, few = metrics.images, counted(len(failures), "failure")
    if (left := images.failed + images.skipped) or failures:
        told = f"{left} of {counted(images.images, 'image')} could not be scored, with {few}"
        yield Paragraph(f"{told}: all values are of the rest; the last section says why.", "bad")


# The worst cases.

Row = Mapping[str, Any]  # of a stored table, with `coverage`


def worst_objects(objects: Iterable[pd.DataFrame], *, most: int) -> list[Row]:
    """Of each category the object-frames with the lowest coverage, one of each track, of equals the largest.

    Args:
        objects: the evaluated rows of each recording.
        most: of a category.

    Returns:
        Rows of `OBJECTS_SCHEMA` plus `coverage`.
    """

    def first(rows: pd.DataFrame) -> pd.DataFrame:
        ranked = rows.sort_values(["coverage", "region_px"], ascending=[True, False], kind="stable")
        return ranked.drop_duplicates(["category", *IMAGE[:2], "track_id"]).groupby("category").head(most)

    return _rows(pick((sort_rows(rows, OBJECT).assign(coverage=coverage) for rows in objects), first))


def worst_frames(frames: Iterable[pd.DataFrame], *, most: int) -> list[Row]:
    """The images with the largest false-positive coverage, one of each recording and camera.

    Args:
        frames: the evaluated rows of each recording.
        most: of all.

    Returns:
        Rows of `FRAMES_SCHEMA` without the histograms, plus `coverage`, here of false positives.
    """

    def first(rows: pd.DataFrame) -> pd.DataFrame:
        ranked = rows[rows["fp_px"] > 0].sort_values("coverage", ascending=False, kind="stable")
        return ranked.drop_duplicates(IMAGE[:2]).head(most)

    return _rows(pick((sort_rows(rows, IMAGE).assign(coverage=false_share) for rows in frames), first))


def _rows(rows: pd.DataFrame) -> list[Row]:
    return [{str(name): value for name, value in row.items()} for row in rows.to_dict("records")]


def object_facts(row: Row) -> str:
    """What was measured of an evaluated object-frame, a row of `OBJECTS_SCHEMA` with `coverage`."""
    points = counted(int(row["points"]), "lidar point")
    return (
        f"{_percent(row['coverage'])} found; {row['range_m']:.1f} m away, {points}, "
        f"{row['region_px']:.0f} of its polygon's {row['polygon_px']:.0f} px count; "
        f"{row['speed_mps']:.1f} m/s, ego vehicle {row['ego_speed_mps']:.1f} m/s"
    )


def image_facts(row: Row) -> str:
    """What was measured of the false positives of an image, a row of `FRAMES_SCHEMA` with `coverage`."""
    causes = row["fp_by_cause"] if isinstance(row["fp_by_cause"], Mapping) else {}
    cause, pixels = max(causes.items(), key=lambda item: item[1], default=("", 0))
    most = f", most by {cause.replace('_', ' ')}, {_percent(pixels / max(row['fp_px'], 1))}" if cause else ""
    patches = counted(int(row["fp_components"]), "patch")
    return f"{_percent(row['coverage'])} wrongly marked in {patches}{most}; ego vehicle {row['ego_speed_mps']:.1f} m/s"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


Elements = Mapping[tuple[str, str, int, str], str]  # recording, camera, time and track -> id of the box on the page
Drawn = Mapping[ImageKey, Mapping[str, str]]  # addresses of the pictures of an image, as of `_pictures`


def _worst_boxes(worst: Sequence[Row], drawn: Drawn, *, pictures: bool) -> tuple[list[Group], Elements]:
    """Boxes of the worst object-frames and images.

    Returns:
        groups: of boxes, one for each category and one of the images, the worst first.
        elements: of those with pictures.
    """
    none = [Paragraph(f"No picture: {'the data set was not available' if pictures else 'none was asked for'}.", "warn")]
    boxes: dict[str, list[Group]] = {}
    elements = {}
    for row in worst:
        key, track = _image_key(row), row.get("track_id", "")
        kind = row["category"] if track else "false"
        of_kind = boxes.setdefault(formats.LABELS.get(kind, "Most false marks"), [])
        element = f"{kind}-{len(of_kind)}"
        title = f"{row['object_class']} “{track}”, {formats.image_name(*key)}" if track else formats.image_name(*key)
        facts = Paragraph(object_facts(row) if track else image_facts(row))
        shown = _shown(drawn[key], title) if key in drawn else none
        of_kind.append(Group(look="box", name=element, title=title, blocks=[facts, *shown]))
        if key in drawn:
            elements[(*key, track)] = element
    return [Group(look="boxes", title=title, blocks=of_kind) for title, of_kind in boxes.items()], elements


def _image_key(row: Row) -> ImageKey:
    return row["recording"], row["camera"], row["timestamp_ns"]


def _pictures(processed: ProcessedFrame, *, panels: bool) -> dict[str, str]:
    """Addresses of the "areas" and, where they are wanted, of the "panels" of an image."""
    areas = draw_frames([scored_layers(processed)], name=formats.frame_name(processed.reference))
    more = {"panels": draw_panels(processed)} if panels else {}
    return {name: figures.figure_uri(figure) for name, figure in {"areas": areas, **more}.items()}


def _shown(drawn: Mapping[str, str], title: str) -> Iterator[Block]:
    """The picture of a case, and what each step saw."""
    yield Picture(drawn["areas"], f"Camera image of {title}: green found, blue missed, orange wrong")
    panels = Picture(drawn["panels"], f"Flow, deviations, likelihood and segmentation of {title}")
    yield Group(look="folded", title="Panels: what each step saw", blocks=[panels])


# The table of object-frames.

LISTED = 2_000  # 1 MB of the page
FILTERS = {"kind": "Kind", "class": "Class", "outcome": "Outcome", "camera": "Camera", "recording": "Recording"}
_READ = (
    *OBJECT,
    *("object_class", "status", "reason", "category", "range_m", "ego_speed_mps", "points", "region_px"),
    *("tp", "fn", "fp"),
)


_COLUMNS: dict[str, Heads] = {
    "object": "object",
    **{name: name for name in ("recording", "camera", "class", "kind", "outcome")},
    "timestamp_ns": "time (ns)",
    "iou": Column("IoU %", formats.number(1, times=100)),
    "coverage": Column("TPR %", formats.number(1, times=100)),
    "fp": Column("false px", formats.number(0)),
    "region_px": Column("object px", formats.number(0)),
    "range_m": Column("range (m)", formats.number(1)),
    "ego_speed_mps": Column("ego (km/h)", formats.number(1, times=3.6)),
    "points": Column("points", formats.number(0)),
}


def object_table(run: StoredRun, elements: Elements, *, most: int = LISTED) -> tuple[Table, int]:
    """Every annotated object-frame as a row; and how many there are in all.

    Args:
        run: of the page.
        elements: to which rows lead.
        most: rows; the evaluated with the lowest coverage come first, of equals the largest, and then the others.
    """
    annotated = 0

    def parts() -> Iterator[pd.DataFrame]:
        nonlocal annotated
        for part in run.parts("objects", _READ):
            annotated += len(part)
            rows = sort_rows(part, OBJECT)
            scored = rows["status"] == EVALUATED
            measured = {"coverage": coverage(rows), "iou": intersection_over_union(rows)}
            measured |= {name: rows[name].astype(float) for name in ("fp", "region_px")}
            yield rows.assign(scored=scored, **{name: of.where(scored) for name, of in measured.items()})

    def first(rows: pd.DataFrame) -> pd.DataFrame:
        order = ["scored", "coverage", "region_px"]
        return rows.sort_values(order, ascending=[False, True, False], kind="stable", ignore_index=True).head(most)

    rows = pick(parts(), first)
    status, reason, kind = (rows[name].astype(object).fillna("") for name in ("status", "reason", "category"))
    keys = rows[OBJECT].itertuples(index=False, name=None)
    links = [Cell(key[3], link=f"#{elements[key]}" if key in elements else "") for key in keys]
    shown = rows.rename(columns={"object_class": "class"}).assign(
        object=pd.Series(links, rows.index, dtype=object),
        outcome=status.where(reason == "", status + ": " + reason.str.replace("_", " ")),
        kind=kind.str.replace("_", " "),
    )
    tags = [dict(zip(FILTERS, row, strict=True)) for row in shown[[*FILTERS]].astype(str).itertuples(index=False)]
    title = "Annotated object-frames; TPR (coverage) and IoU in percent"
    return Table(title=title, columns=_COLUMNS, rows=shown, words=6, tags=tags), annotated


def _object_section(run: StoredRun, elements: Elements) -> Group:
    table, annotated = object_table(run, elements)
    few = "Every annotated object in every image."
    if len(table.rows) < annotated:
        few = (f"The run has {annotated:,} object-frames, more than a page can hold: here are the {len(table.rows):,} "
               "that were found least; its folder counts has all.")  # fmt: skip
    about = (
        f"{few} Press a heading to sort, type or choose to filter. An object leads to its picture; where the page "
        "holds none, this command draws it, with recording, camera and time of the row:"
    )
    choices = [Choice(tag, label, EVALUATED if tag == "outcome" else "") for tag, label in FILTERS.items()]
    blocks: list[Block] = [Paragraph(about), Code(_view_command(run)), Filters(choices, "Search"), table]
    return section("frames", "Object-frames", blocks)


def _view_command(run: StoredRun) -> str:
    """The call of `view` that draws an image of the run, with its method, settings and protocol."""
    words = ["fisheye-bench", "view", run.manifest.dataset.card, *run.manifest.method.options()]
    known = run.protocol.name in known_protocols()
    words += ["--protocol", run.protocol.name if known else str(run.folder / "protocol.json")]
    return " ".join(map(shlex.quote, words)) + " --recording RECORDING --camera CAMERA --time-ns TIME"


# The other tables.


def _recording_table(run: StoredRun) -> Table:
    """The recordings with the lowest IoU first, those without object-frames last."""
    values, cases = recording_values(run.sums)
    table = values[["iou", "tpr_all", "false_positive_coverage"]].assign(
        object_frames=cases["iou"], images=cases["false_positive_coverage"]
    )
    table = table.reset_index().sort_values(["iou", "recording"], ignore_index=True)
    shares = [Column(heading, formats.percent) for heading in ("IoU, all", "TPR, all", "wrongly marked")]
    counts = [Column(heading, "{:.0f}".format) for heading in ("object-frames", "images")]
    return Table(
        title="By recording, over all its object-frames, the lowest IoU first",
        columns=["recording", *shares, *counts],
        rows=[
            [Cell(name, link=f"#recording={quote(name)}"), *values] for name, *values in table.itertuples(index=False)
        ],
    )


def _cause_table(metrics: Summary) -> Table | None:
    """The causes of false marks, the largest first; None where the method names none."""
    causes = {name: cause for name, cause in metrics.false_positive_causes.items() if not math.isnan(cause.value)}
    ordered = sorted(causes.items(), key=lambda item: -item[1].value)
    rows = [[name.replace("_", " "), formats.bar_cell(cause)] for name, cause in ordered]
    title = "Share of the falsely marked pixels"
    return Table(title=title, columns=["cause", "share"], rows=rows, look="narrow") if rows else None


def _about_table(rows: Mapping[str, str]) -> Table:
    return Table(columns=["", ""], rows=list(rows.items()), words=2, look="about")


def _ledger(metrics: Summary) -> Table:
    """The outcome of every annotated object-frame and of every image."""
    objects, images = metrics.objects, metrics.images
    of_objects = {"evaluated": objects.evaluated, "static": objects.static}
    of_objects |= {f"ignored: {reason.replace('_', ' ')}": number for reason, number in objects.ignored.items()}
    of_images = {"scored": images.evaluated, "skipped, without an image before": images.skipped}
    of_images |= {"failed": images.failed, "not annotated": images.not_annotated}
    outcomes = {"object-frames": of_objects | {"all": objects.annotated}, "images": of_images | {"all": images.images}}
    rows = [(what, outcome, number) for what, numbers in outcomes.items() for outcome, number in numbers.items()]
    return Table(columns=["of the annotated", "outcome", "number"], rows=rows, words=2, look="narrow")


# The page.


def write_page(
    folder: Path, *, out: Path | None = None, pictures: bool = True, progress: Progress | None = None
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Write the page of a run, and its charts as `figures/*.pdf` and `.png` beside the results.

    Args:
        folder: of the run or of its results by a protocol.
        out: the page; `index.html` beside the results without it.
        pictures: process the worst images once more and show them.
        progress: called with the images done and their number.

    Returns:
        files: the page first.
        problems: why pictures are missing, one line each.

    Raises:
        DataError: a stored result is missing or damaged. Missing data for pictures is no error; it is said.
    """
    run = read_run(folder)
    charts = figures.draw_charts(run)
    worst = worst_objects(run.evaluated("objects"), most=WORST) + worst_frames(run.evaluated("frames"), most=WORST)
    examples = dict([*example_frames(run.evaluated("objects", LARGEST)).items()][:EXAMPLES])
    of_worst = {_image_key(row) for row in worst}
    drawn, missing = draw_images(
        [run],
        {*of_worst, *examples.values()} if pictures else (),
        lambda key, frames, _: _pictures(frames[0], panels=key in of_worst),
        progress=progress,
    )
    boxes, elements = _worst_boxes(worst, drawn, pictures=pictures)
    sections = [
        section("glance", "At a glance", _glance(run, _examples(examples, drawn))),
        *_measured(run, charts),
        section("worst", "Worst cases", [
            Paragraph("The object-frames of each kind that were found least, one of each object, and the images with "
                      f"most false marks, the worst first. {COLOURS}"),
            *(Paragraph(f"Pictures are missing: {problem}", "warn") for problem in missing), *boxes]),
        _object_section(run, elements),
        *_origin(run),
    ]  # fmt: skip
    title, file = f"{run.manifest.method.name} on {run.manifest.dataset.name}", out or run.folder / "index.html"
    write_output(file, to_page(title, [*_head(run), *sections]))
    files = [file]
    for name, chart in charts.items():
        files += figures.write_picture(run.folder / "figures" / name, chart, "pdf", "png")
    return tuple(files), tuple(missing)


def _examples(examples: Mapping[Category, ImageKey], drawn: Drawn) -> list[Block]:
    """The images in which the largest objects of some kinds of motion are."""
    titles = {key: f"{formats.LABELS[kind]}, the largest object: {formats.image_name(*key)}"
              for kind, key in examples.items() if key in drawn}  # fmt: skip
    pictures = Group(look="pairs", blocks=[Picture(drawn[key]["areas"], title, title) for key, title in titles.items()])
    about = f"{COLOURS} These are the largest objects; what was found least is among the worst cases."
    return [pictures, Paragraph(about, "dim")] if titles else []


def _head(run: StoredRun) -> list[Block]:
    manifest, summary = run.manifest, run.summary
    data, method = manifest.dataset, manifest.method
    settings = ", ".join(f"{name} = {value}" for name, value in method.changed_settings().items())
    split = f", split {data.split}" if data.split else ""
    of = counted(summary.images.evaluated, "image"), counted(summary.false_positives.recordings, "recording")
    about = {
        "Data": f"{data.name} ({data.card}){split}: {' of '.join(of)}. {summary.caveats}".rstrip(),
        "Method": f"{method.name} ({method.place}); {settings or 'all settings as by default'}.",
        "Protocol": f"{manifest.protocol.name}, version {manifest.protocol.version}",
        "Run": f"{run.label}, {summary.provenance.started_utc[:16]} UTC, fisheye-bench {manifest.code.version}",
    }
    if is_beside_paper(manifest):
        about["Paper"] = f"{published.SOURCE}. Its values stand below ours as “paper”: same form, not the same data."
    intro = (
        f"How well the method “{method.name}” marks what moves in the camera images of a driving car, measured against "
        "outlines made from lidar."
    )
    return [Paragraph(intro), _about_table(about)]


def _glance(run: StoredRun, examples: Sequence[Block]) -> Iterator[Block]:
    metrics = run.metrics
    yield tiles(metrics, large_px=run.protocol.scoring.false_positive_component_px)
    yield from remarks(metrics, run.summary.failures)
    yield from examples
    words = {
        find_metric(name).label: find_metric(name).meaning
        for name in [*formats.headline_metrics(metrics), formats.LARGE_FALSE]
    }
    words["Object-frame"] = "One moving object in one image. The same object in ten images makes ten."
    words |= {"Core, unknown band": formats.CORE} if formats.found_level(run.protocol) else {}
    yield Group(look="folded", title="The words used here", blocks=[_about_table(words)])


def _results(run: StoredRun) -> list[Block]:
    """Ours, beside the paper's where that says something."""
    rows = table_rows(run.metrics, beside_paper=is_beside_paper(run.manifest))
    notes = [Paragraph(note, "dim") for note in (left_out_note(run.metrics), legend(rows)) if note]
    return [results_table(rows, title="In percent"), *notes]


def _measured(run: StoredRun, charts: Mapping[str, Figure]) -> Iterator[Group]:
    """The sections that need no picture of an image."""
    metrics, summary = run.metrics, run.summary
    yield section("results", "Results by kind of motion", _results(run))
    yield section("splits", "Broken down", [
        Paragraph("The same object-frames sorted in other ways, to see where the method fails. Bins are half-open: "
                  "[2, 4) holds 2 but not 4. The line across a bar is the 95 % interval. Of many rows one may be "
                  "lowest by chance."), *breakdown_tables(metrics)])  # fmt: skip
    by_recording = _recording_table(run)
    yield section("recordings", "By recording", [
        Paragraph("Where to look first: a name shows its object-frames in the table below."), by_recording,
    ])  # fmt: skip
    around: list[Block] = [
        Paragraph("The ground seen from above, the ego vehicle in the middle driving upwards: yellow cells mark places "
                  "where objects were found, dark ones where they were missed; hatched cells hold too few to say."),
        *([Paragraph(formats.CORE)] if formats.found_level(run.protocol) else []),
        figures.drawing("range_map", charts["range_map"], AROUND),
    ]  # fmt: skip
    yield section("around", "Around the ego vehicle", around)
    over_all = "" if summary.threshold_free is None else threshold_free_line(summary.threshold_free)
    if "threshold_sweep" in charts:
        yield section("threshold", "Other thresholds", [
            Paragraph("What other thresholds of the motion likelihood would give: more found on the way up, more "
                      f"wrongly marked on the way right. The dot is the run as it was scored. {over_all}".rstrip()),
            Group(look="charts", blocks=[
                figures.drawing("threshold_sweep", charts["threshold_sweep"], THRESHOLDS)])])  # fmt: skip
    if causes := _cause_table(metrics):
        yield section("causes", "Causes of the false marks", [
            Paragraph("Every falsely marked pixel is counted for the part of the method that contributes most to "
                      "the likelihood there."), causes])  # fmt: skip


def _origin(run: StoredRun) -> Iterator[Group]:
    """How the values came about, and what is not among them."""
    summary, made = run.summary, run.summary.provenance
    yield section("origin", "Origin of the values", [
        Paragraph(f"What made this run, started {made.started_utc}; the same code, settings and data give the same "
                  f"values. At most {made.peak_memory_mb:.0f} MB of memory."),
        Group(look="folded", title="manifest.json", blocks=[Code(run.manifest.model_dump_json(indent=1))]),
    ])  # fmt: skip
    messages = [f"{number} x {problem}" for problem, number in summary.images.problems.items()]
    yield section("ledger", "What was left out, and why", [
        Paragraph("Every annotated object in every image ends in exactly one of these lines; detections on ignored "
                  "objects count neither as right nor as wrong."),
        _ledger(run.metrics),
        *_folded("Messages of images that were not scored", messages),
        *_folded(counted(len(summary.failures), "failure"), summary.failures)])  # fmt: skip


def _folded(title: str, lines: Sequence[str]) -> list[Group]:
    return [Group(look="folded", title=title, blocks=[Items(lines)])] if lines else []
