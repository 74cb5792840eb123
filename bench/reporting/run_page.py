"""The page of a run: what a reader should know first, all metrics and charts, the worst cases, every object-frame.

`write_page` reads what a run has stored and makes the blocks of its sections. Only pictures go back to the data set;
without the data the page is complete but for them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from urllib.parse import quote

from bench.atomic import write_output
from bench.evaluation import find_metric, published
from bench.evaluation.definitions import OBJECT_FRAMES
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.rows import EVALUATED
from bench.evaluation.summary import Summary
from bench.evaluation.sums import recording_values
from bench.harness import FramePipeline, ProcessedFrame
from bench.harness.digests import short_digest
from bench.harness.stages import Progress
from bench.harness.stored import StoredRun, read_run
from bench.reference import Category
from bench.reporting.charts import Chart, draw_charts, figure_uri
from bench.reporting.compare import pair_on_common_images, read_comparable
from bench.reporting.document import (
    Block,
    Cell,
    Choice,
    Code,
    Column,
    Filters,
    Group,
    Heading,
    Items,
    Paragraph,
    Picture,
    Table,
    to_page,
)
from bench.reporting.formats import (
    LABELS,
    headline_metrics,
    image_name,
    percent,
    with_interval,
)
from bench.reporting.frame import draw_frames, scored_layers
from bench.reporting.frame_pictures import ImageKey, draw_images, example_frames
from bench.reporting.glance import bar_cell, breakdowns, kind_tables, remarks, tiles
from bench.reporting.object_table import FILTERS, object_table, view_command
from bench.reporting.run_tables import (
    is_rendered,
    left_out_note,
    rows_with_cases,
    table_note,
    table_rows,
    text_tables,
)
from bench.reporting.worst_cases import IMAGE_NOTE, OBJECT_NOTE, Card, Gallery, image_key, worst_cases, worst_objects

LISTED_RECORDINGS = 200


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


def _cause_table(metrics: Summary, *, of_recordings: str) -> Table | None:
    """The causes of false marks, the largest first; None where the method names none."""
    causes = {name: cause for name, cause in metrics.false_positive_causes.items() if not math.isnan(cause.value)}
    if not causes:
        return None
    ordered = sorted(causes.items(), key=lambda item: -item[1].value)
    return Table(
        title=f"Share of the falsely marked pixels{of_recordings}",
        columns=["cause", "share"],
        rows=[[name.replace("_", " "), bar_cell(cause)] for name, cause in ordered],
        look="narrow",
    )


def _origin_table(run: StoredRun) -> Table:
    """Data, method, protocol and code that made a run."""
    manifest, made = run.manifest, run.summary.provenance
    data, method, protocol, code = manifest.dataset, manifest.method, manifest.protocol, manifest.code
    rows = {
        "data set": f"{data.name} ({data.card}){f', split {data.split}' if data.split else ''}",
        "method": method.name,
        "its settings": json.dumps(method.settings),
        "protocol": f"{protocol.name}, version {protocol.version}, digest {short_digest(protocol.digest)}",
        "reference": f"digest {short_digest(str(manifest.reference))}",
        "data": ", ".join(f"{name} {digest}" for name, digest in data.recordings.items()),
        "version": code.version,
        "code": code.text,
        "Python and libraries": ", ".join(f"{name} {version}" for name, version in code.libraries.items()),
        "started": made.started_utc,
        "took": f"{made.seconds:.1f} s for {made.images} images, at most {made.peak_memory_mb:.0f} MB",
    }
    return _about_table(rows)


def _about_table(rows: Mapping[str, str]) -> Table:
    return Table(columns=["", ""], rows=list(rows.items()), words=2, look="about")


REASONS = {
    "unclear": "flagged as unclear by the annotation",
    "class_not_in_protocol": "a class that the protocol does not score",
    "motion_unknown": "no velocity is known",
    "category_not_in_protocol": "a kind of motion that the protocol does not score",
    "out_of_view": "outside of the lens's view",
    "no_sweep": "no lidar sweep near the image",
    "beyond_range": "farther away than the protocol's range limit",
    "too_few_points": "fewer lidar points than the protocol asks for",
    "polygon_too_small": "a reference polygon below the protocol's area",
    "occluded": "wholly behind nearer objects",
}


def _ledger_tables(metrics: Summary) -> list[Table]:
    """The outcome of every annotated object-frame and of every image."""
    objects, images = metrics.objects, metrics.images
    of_objects = [
        ["evaluated", objects.evaluated, "scored above"],
        ["static", objects.static, "does not move, so it is neither searched for nor ignored"],
        *([f"ignored: {reason.replace('_', ' ')}", number, REASONS.get(reason, "")]
          for reason, number in objects.ignored.items()),
        ["annotated, the sum", objects.annotated, "every annotated object in every image, once"],
    ]  # fmt: skip
    of_images = [
        ["scored", images.evaluated, ""],
        ["skipped", images.skipped, "no image before it to compare with, at the time that is due"],
        ["failed", images.failed, "could not be used"],
        *([["not annotated", images.not_annotated, "masks without scores"]] if images.not_annotated else []),
        ["all, the sum", images.images, "but the first of each recording, which have no history"],
    ]
    titles = {"Annotated object-frames": of_objects, "Images": of_images}
    return [Table(title=title, columns=["outcome", "number", "why"], rows=rows) for title, rows in titles.items()]


def _object_section(run: StoredRun, cards: Sequence[Card]) -> Group:
    pictured = {(*card.key, track): card.element for card in reversed(cards) if card.view
                for track in ("", card.track or "")}  # fmt: skip
    table, annotated = object_table(run, pictured=pictured)
    few = "Every annotated object in every image."
    if len(table.rows) < annotated:
        few = (f"The run has {annotated:,} object-frames, more than a page can hold: here are the {len(table.rows):,} "
               "that were found least, and those with pictures; its folder counts has all.")  # fmt: skip
    about = (
        f"{few} Press a heading to sort, type or choose to filter. An object leads to its picture; where the page "
        "holds none, this command draws it, with recording, camera and image of the row:"
    )
    choices = [Choice(tag, label, EVALUATED if tag == "outcome" else "") for tag, label in FILTERS.items()]
    blocks: list[Block] = [Paragraph(about), Code(view_command(run)), Filters(choices, "Search"), table]
    title = "All object-frames" if len(table.rows) == annotated else "Object-frames"
    return Group(look="section", name="frames", title=title, count=f"{len(table.rows):,} rows", blocks=blocks)


# Pictures of one run or of two on the same images.


def _pictures(
    runs: Sequence[StoredRun], titles: Mapping[ImageKey, str], *, progress: Progress | None
) -> tuple[Group, list[str]]:
    """Draw images as runs were scored on them, and say why others could not be drawn."""

    def draw(key: ImageKey, frames: Sequence[ProcessedFrame], _: FramePipeline) -> str:
        labels = [run.label if len(runs) > 1 else "" for run in runs]
        sides = [scored_layers(frame, label=label) for label, frame in zip(labels, frames, strict=True)]
        return figure_uri(draw_frames(sides, name=image_name(*key)))

    uris, problems = draw_images(runs, titles, draw, progress=progress)
    shown = [Picture(uris[key], title, title) for key, title in titles.items() if key in uris]
    return Group(look="pairs", blocks=shown), problems


def _beside_section(
    run: StoredRun, other: Path, *, pictures: bool, progress: Progress | None
) -> tuple[Group, list[str]]:
    """Both values of the headline metrics and both methods on the same images, of those that both scored."""
    both = [replace(one, category=run.category) for one in read_comparable([run.folder, other])]
    one, two, common = pair_on_common_images(*both)
    shown, problems = _pictures((one, two), _chosen(one, two) if pictures else {}, progress=progress)
    values = [headline_metrics(side.metrics) for side in (one, two)]
    names = [name for name in values[0] if one.category is None or find_metric(name).over == OBJECT_FRAMES]
    table = Table(
        title=f"Both runs, on the {common} images that both scored",
        columns=["", Column(one.label, with_interval), Column(two.label, with_interval)],
        rows=[[find_metric(name).label, *(metrics[name] for metrics in values)] for name in names],
    )
    about = (
        "The same images as both runs were scored on them: of each kind of motion the one in which an object fills "
        f"most pixels, and the one that each run found least of. {_COLOURS} `fisheye-bench compare` says what differs "
        "for certain."
    )
    blocks: list[Block] = [Paragraph(about), table, *map(_missing, problems), shown]
    return Group(look="section", name="beside", title="Side by side", blocks=blocks), problems


_COLOURS = "Green is found, blue missed, orange wrongly marked."


def _missing(problem: str) -> Paragraph:
    return Paragraph(f"Pictures are missing: {problem}", "warn")


def _chosen(one: StoredRun, two: StoredRun) -> dict[ImageKey, str]:
    """Images with the reason why they are shown, by kind of motion; both runs choose the same way."""
    names = one.protocol.reference.categories if one.category is None else (one.category,)
    kinds = [Category(name) for name in names]
    largest = example_frames(one.objects)
    least = [(run.label, worst_objects(run.objects, kinds, most=1)) for run in (one, two)]
    reasons: dict[ImageKey, list[str]] = {}
    for kind in kinds:
        of_kind: list[tuple[ImageKey, str]] = []
        if kind in largest:
            of_kind.append((largest[kind], "the largest object"))
        of_kind += [(image_key(row), f"least found by {label}") for label, rows in least for row in rows[kind.value]]
        for key, reason in of_kind:
            reasons.setdefault(key, []).append(f"{LABELS[kind].lower()}, {reason}")
    return {key: _title("; ".join(of_image), key) for key, of_image in reasons.items()}


def _title(text: str, key: ImageKey) -> str:
    return f"{text[0].upper()}{text[1:]}: {image_name(*key)}"


# The page.

WORST, WORST_OF_CATEGORY = 3, 12
EXAMPLES = 2  # pictures that a reader sees first


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
    folder: Path,
    *,
    category: Category | None = None,
    out: Path | None = None,
    other: Path | None = None,
    pictures: bool = True,
    progress: Progress | None = None,
) -> Page:
    """Write the page of a run, or of one kind of motion of it.

    Args:
        folder: of the run or of its results by a protocol.
        category: only this kind of motion, with a larger gallery; None for all.
        out: the file; `index.html`, or `index-<category>.html`, beside the results without it.
        other: folder of a run to stand beside on the same images; None for none.
        pictures: process the worst images once more and show them.
        progress: called with the images done and their number.

    Raises:
        DataError: a stored result is missing or damaged. Missing data for pictures is no error; it is said.
        UsageError: `other` does not compare.
    """
    run = read_run(folder, category=category)
    beside, problems = [], list[str]()
    if other is not None:
        section, problems = _beside_section(run, other, pictures=pictures, progress=progress)
        beside = [section]
    most = WORST if category is None else WORST_OF_CATEGORY
    galleries, missing = worst_cases(run, most=most, pictures=pictures, progress=progress)
    title = f"{run.manifest.method.name} on {run.manifest.dataset.name}"
    title += "" if run.category is None else f": {LABELS[run.category]}"
    blocks = [*_head(run), *_sections(run, galleries, missing, beside, pictures=pictures)]
    file = out or run.folder / ("index.html" if category is None else f"index-{category.value}.html")
    write_output(file, to_page(title, blocks, folder=run.folder))
    return Page(file=file, problems=tuple(dict.fromkeys([*missing, *problems])))


def _of_recordings(metrics: Summary) -> str:
    recordings = metrics.false_positives.recordings
    return "" if recordings is None else f" of {recordings} recordings"


def _head(run: StoredRun) -> list[Block]:
    manifest, summary = run.manifest, run.summary
    data, method = manifest.dataset, manifest.method
    settings = ", ".join(f"{name} = {value}" for name, value in method.changed_settings().items())
    place = f" ({method.place})" if method.place else ""
    split = f", split {data.split}" if data.split else ""
    about = {
        "Data": f"{data.name} ({data.card}){split}: {summary.images.evaluated} images{_of_recordings(run.metrics)}. "
        f"{summary.caveats}".rstrip(),
        "Method": f"{method.name}{place}; {f'settings: {settings}' if settings else 'all settings as by default'}.",
        "Protocol": f"{manifest.protocol.name}, version {manifest.protocol.version}",
        "Run": f"{run.label}, {summary.provenance.started_utc[:16].replace('T', ' ')} UTC, fisheye-bench "
        f"{manifest.code.version}",
    }
    if is_rendered(data.card):
        about["Paper"] = f"{published.SOURCE}. Its values stand beside as “paper”: same form, not the same data."
    intro = (
        f"How well the method “{method.name}” marks what moves in the camera images of a driving car, measured against "
        "outlines made from lidar."
    )
    return [Paragraph(intro), _about_table(about)]


WORDS = {
    "object-frame": "One moving object in one image. The same object in ten images makes ten.",
    "found, detection rate": "Share of object-frames with at least one marked pixel, or at least 10 % or 50 % of their "
    "pixels.",
    "chance": "The same rate when the objects are compared with the marks of another image: what a blind guess of the "
    "same size gets. Only what lies above it says something.",
    "TPR, coverage": "Share of an object's pixels that are marked; averaged over the found object-frames (the paper's "
    "way) or over all of them.",
    "IoU": "Overlap of marks and object, divided by their union: it falls when the marks spill over the outline.",
    "core, unknown band": "The pixels that are an object's for certain, and a narrow band around them, yellow in the "
    "pictures, which may be: marks in it count neither way. “Unknown” is the band's share of both.",
    "false-positive coverage": "Share of the image that is marked though nothing moves there.",
    "95 % interval": "The range below a value, from how much whole recordings differ. A wide one means: too few "
    f"recordings to be sure; under {FEWEST_RECORDINGS} there is none.",
}


def _sections(
    run: StoredRun, galleries: Sequence[Gallery], missing: Sequence[str], beside: Sequence[Group], *, pictures: bool
) -> Iterator[Group]:
    """The sections of the page, each of which opens with a sentence."""
    section = partial(Group, look="section")
    whole, metrics, summary = run.category is None, run.metrics, run.summary
    cards = [card for *_, of_gallery in galleries for card in of_gallery]
    charts = draw_charts(run)
    banded = "unknown_share" in metrics.all_moving.metric_names()
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
    yield from beside
    at_all = "half of every object was found" if banded else "objects were found at all"
    yield section(name="around", title="Around the ego vehicle", blocks=[
        Paragraph("The ground seen from above, the ego vehicle in the middle driving upwards: yellow cells mark places "
                  f"where {at_all}, dark ones where they were missed; hatched cells hold too few to say."),
        charts["range"][0].drawing()])  # fmt: skip
    if whole:
        yield _chart_section("plane", "In the image", charts["plane"], "The run holds no maps of the image plane.",
            "The same question on the image itself: which pixels of moving objects were missed, and where false marks "
            "lie. Bright is bad; no moving object was ever in an empty cell.")  # fmt: skip
    yield _chart_section("coverage", "How much of an object is found", charts["coverage"],
        "No object-frame was evaluated.",
        "The share of object-frames that count as found when at least so much of the object must be marked. A curve "
        "that stays high to the right is good; one that follows the dashed line is chance.")  # fmt: skip
    if whole:
        yield _chart_section("threshold", "Other thresholds", charts["threshold"],
            "The run holds no likelihoods: its method gives masks only.",
            "What other thresholds of the motion likelihood would give: more found on the way up, more wrongly marked "
            "on the way right. The dot is the run as it was scored.")  # fmt: skip
        if causes := _cause_table(metrics, of_recordings=_of_recordings(metrics)):
            yield section(name="causes", title="Causes of the false marks", count=f"{len(causes.rows)} causes", blocks=[
                Paragraph("Every falsely marked pixel is counted for the part of the method that contributes most to "
                          "the likelihood there."), causes])  # fmt: skip
    yield section(name="worst", title="Worst cases", count=f"{len(cards)} cases",
                  blocks=[*_worst(galleries, missing, whole=whole, pictures=pictures)])  # fmt: skip
    yield _object_section(run, cards)
    yield section(name="origin", title="Origin of the values", blocks=[
        Paragraph("What made this run; the same code, settings and data give the same values."),
        _origin_table(run)])  # fmt: skip
    here = "" if whole else " (here: those of this kind of motion only)"
    messages = [f"{number} x {problem}" for problem, number in summary.images.problems.items()]
    yield section(name="ledger", title="What was left out, and why", count=f"{len(summary.failures)} failures", blocks=[
        Paragraph(f"Every annotated object in every image ends in exactly one of these lines{here}; detections on "
                  "ignored objects count neither as right nor as wrong."),
        *_ledger_tables(metrics),
        *_folded("Messages of images that were not scored", messages),
        *_folded(f"{len(summary.failures)} failures", summary.failures)])  # fmt: skip


def _folded(title: str, lines: Sequence[str]) -> list[Group]:
    return [Group(look="folded", title=title, blocks=[Items(lines)])] if lines else []


def _chart_section(name: str, title: str, charts: Sequence[Chart], none: str, about: str) -> Group:
    shown: Block = Group(look="charts", blocks=[chart.drawing() for chart in charts])
    blocks = [Paragraph(about), shown if charts else Paragraph(none, "warn")]
    return Group(look="section", name=name, title=title, count=f"{len(charts)} charts", blocks=blocks)


def _glance(run: StoredRun, *, pictures: bool) -> Iterator[Block]:
    metrics, failures = run.metrics, run.summary.failures
    yield Paragraph("What a reader should know first; every sentence is computed from the values below.")
    yield tiles(metrics, category=run.category)
    yield from remarks(metrics)
    if failures:
        text = f"{len(failures)} failures while scoring: all values are of the rest, the last section lists them."
        yield Paragraph(text, "bad")
    if pictures:
        wanted = [kind for kind, row in metrics.categories.items() if row.object_frames]
        largest = {kind: key for kind, key in example_frames(run.objects).items() if kind in wanted}
        titles = {key: _title(f"{LABELS[kind].lower()}, the largest object", key) for kind, key in largest.items()}
        shown, problems = _pictures([run], dict(list(titles.items())[:EXAMPLES]), progress=None)
        yield from map(_missing, problems)
        yield shown
        yield Paragraph(f"{_COLOURS} These show the largest objects; what was found least is among the worst cases.",
                        "dim")  # fmt: skip
    if kinds := kind_tables(metrics):
        yield from kinds
        yield Paragraph("Bars: this run, long is good; the line across is the 95 % interval, and “lowest” marks the "
                        "smallest IoU of a table where its interval lies wholly below that of another row.",
                        "dim")  # fmt: skip
    banded = "unknown_share" in metrics.all_moving.metric_names()
    words = {word: text for word, text in WORDS.items() if banded or "band" not in word}
    yield Group(look="folded", title="The words used here", blocks=[_about_table(words)])


def _results(run: StoredRun) -> list[Block]:
    """Ours, beside the paper's where that says something, and all metrics with their intervals behind a line."""
    beside = is_rendered(run.manifest.dataset.card)
    rows = [row for row in table_rows(run.metrics, beside_paper=beside) if run.category in (None, row.name)]
    behind = ", with the paper's value and the difference behind ours" if beside else ""
    blocks: list[Block] = [Paragraph(f"Each row is a kind of motion{behind}.")]
    if shown := rows_with_cases(rows):
        first, *others = (replace(table, note="") for table in text_tables(shown) if len(table.rows))
        blocks += [first, Group(look="folded", title="All metrics with their intervals", blocks=others)]
    if left_out := left_out_note(rows):
        blocks.append(Paragraph(left_out, "dim"))
    return [*blocks, Paragraph(table_note(rows), "dim")]


def _worst(galleries: Sequence[Gallery], missing: Sequence[str], *, whole: bool, pictures: bool) -> Iterator[Block]:
    images = ", and the images with most false marks" if whole else ""
    yield Paragraph(
        f"The object-frames of each kind that were found least{images}: one of each object first, then of its other "
        f"seconds. {_COLOURS}"
    )
    yield from map(_missing, missing)
    yield from (Paragraph(note, "dim") for note in (OBJECT_NOTE, *([IMAGE_NOTE] if whole else [])))
    for title, table, cards in galleries:
        yield Heading(title, 3)
        yield table
        yield Group(look="boxes", blocks=[_box(card, pictures=pictures) for card in cards])


def _box(card: Card, *, pictures: bool) -> Group:
    """A worst case: what was measured, its picture and the object enlarged, and what each step saw."""
    blocks: list[Block] = [Paragraph(card.facts_line, "dim")]
    if card.view is None:
        why = "the data set was not available" if pictures else "the page was made without pictures"
        blocks.append(Paragraph(f"No picture: {why}.", "warn"))
    else:
        blocks.append(Picture(card.view.areas, f"Camera image of {card.title}: green found, blue missed, orange wrong"))
        if card.track is not None:
            blocks.append(Picture(card.view.close_ups[card.track], f"{card.title}, enlarged"))
        panels = Picture(card.view.panels, f"Flow, deviations, likelihood and segmentation of {card.title}")
        blocks.append(Group(look="folded", title="Panels: what each step saw", blocks=[panels]))
    return Group(look="box", name=card.element, title=card.title, blocks=blocks)
