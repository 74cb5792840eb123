"""A comparison of runs for people and programs: a page, Markdown, CSV, pictures of what changed most, terminal."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pandas as pd

from bench.atomic import refuse_foreign, replacing, write_bytes
from bench.evaluation import find_metric
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.sums import ALL_MOVING, FRAMES, recording_values
from bench.harness import FramePipeline, ProcessedFrame
from bench.harness.digests import short_digest
from bench.harness.stages import Progress
from bench.harness.stored import StoredRun
from bench.reporting.canvas import figure_pixels, jpeg_bytes
from bench.reporting.compare import (
    HEADLINES,
    IMPROVEMENTS,
    LISTED,
    RunComparison,
    Shown,
    changes_over_everything,
    compare_runs,
    paired_objects,
    read_comparable,
    verdict_line,
)
from bench.reporting.document import (
    Bar,
    Block,
    Cell,
    Choice,
    Column,
    Filters,
    Group,
    Heads,
    Paragraph,
    Picture,
    Report,
    Style,
    Table,
    Tags,
)
from bench.reporting.formats import CEILING, LABELS, found_by, hundredths, image_name, points, points_interval
from bench.reporting.frame import Layers, draw_frames, scored_layers
from bench.reporting.frame_pictures import ImageKey, draw_images

NOTE = (
    "Differences are after minus before, in percentage points, with 95 % intervals by recording, in pairs: the "
    "difference is taken again without each recording (jackknife). p: two-sided, of no difference, corrected after "
    "Holm over the rows of one metric that have a p-value (the categories and all moving objects; false-positive "
    "coverage has one row), for each pair of runs by itself. Only IoU and TPR over all object-frames, detection at "
    "50 % and false-positive coverage are judged; other metrics are shown with their interval and without a p-value. "
    "Better or worse is said only if the interval excludes 0 and the corrected p-value is at most 5 %; both "
    f"need {FEWEST_RECORDINGS} recordings with cases of both runs: with fewer, the same change in all of them could be "
    "chance. Recordings: with cases of both runs. TPR and IoU over detected object-frames are taken over other "
    "object-frames in each run where detection differs; TPR and IoU over all are not. Chance: the same objects on the "
    f"mask of another frame. Ceiling: on the same images, {CEILING}."
)
STYLES: dict[str, Style] = {Shown.BETTER: "good", Shown.WORSE: "bad"}


def p_text(p_value: float) -> str:
    """For example "0.012" or "<0.001"; "" for NaN."""
    if math.isnan(p_value):
        return ""
    return "<0.001" if p_value < 0.001 else f"{p_value:.3f}"


def _bound(ratio: float) -> str:
    return "" if math.isnan(ratio) else hundredths(ratio)


_COLUMNS: dict[str, Heads] = {
    "metric": Column("Metric", lambda name: find_metric(name).label),
    "label": "Type",
    "verdict": Column("Verdict", lambda verdict: Cell(str(verdict), style=STYLES.get(verdict, ""))),
    "frames_before": "Frames",
    "recordings": "Recs",
    "before": Column("before", hundredths),
    "after": Column("after", hundredths),
    "difference": Column("change", points),
    "ci95": Column("95 %", points_interval),
    "p_holm": Column("p (Holm)", p_text),
    "chance_before": Column("chance before", _bound),
    "chance_after": Column("after", _bound),
    "ceiling": Column("ceiling", _bound),
}
_CHANGE = ["recordings", "before", "after", "difference", "ci95"]

# What is of all kinds of motion or of all recordings has no such tag, and stays.
FILTERS = {"motion": "Kind of motion", "recording": "Recording", "change": "Change"}


def _frame_tags(frame: Mapping[Any, Any]) -> Tags:
    change = Shown.BETTER if frame["kind"] in IMPROVEMENTS else Shown.WORSE
    return {"motion": LABELS.get(frame["category"], ""), "recording": frame["recording"], "change": change.value}


def _motion_tag(name: str) -> Tags:
    return {} if name in (ALL_MOVING, FRAMES) else {"motion": LABELS[name]}


def _pair(comparison: RunComparison, out: Path, *, filters: bool) -> Iterator[Block]:
    """The verdict first, then pictures, then the tables that it rests on."""
    yield Paragraph(verdict_line(comparison), "strong")
    yield verdict_tiles(comparison)
    sides = {"before": comparison.before, "after": comparison.after}
    yield Table(
        columns=["", "", ""],
        rows=[
            [side, Cell(run.label, link=_page_address(run, out)), "" if method == run.label else method]
            for (side, run), method in zip(sides.items(), comparison.methods, strict=True)
        ],
        words=3,
        look="about",
    )
    yield from map(Paragraph, comparison.notes)
    titles = {name: frame_title(frame) for name, frame in comparison.pictures.items()}
    pictures = [Picture(f"pictures/{name}", title, title, tags=_frame_tags(comparison.pictures[name]))
                for name, title in titles.items()]  # fmt: skip
    yield Group(look="pairs", blocks=pictures[:FIRST_PICTURES])
    if filters:
        yield Filters([Choice(tag, label) for tag, label in FILTERS.items()])
    yield headline_table(comparison)
    if pictures[FIRST_PICTURES:]:
        more = Group(look="pairs", blocks=pictures[FIRST_PICTURES:])
        yield Group(look="folded", title=f"{len(pictures) - FIRST_PICTURES} more pictures", blocks=[more])
    changed = [_frame_table(str(kind), frames) for kind, frames in comparison.frames.groupby("kind", sort=False)]
    for table in (_recording_table(comparison), _detection_table(comparison), *changed, _further_table(comparison)):
        yield Group(look="folded", title=table.title, blocks=[replace(table, title="")])
    yield from (Paragraph(remark, "dim") for remark in comparison.remarks)


FIRST_PICTURES = 4  # that a reader sees before the tables


def _page_address(run: StoredRun, out: Path) -> str:
    """Address of a run's page as seen from a folder; "" where the run has none."""
    page = run.folder / "index.html"
    return quote(Path(os.path.relpath(page.resolve(), out.resolve())).as_posix()) if page.is_file() else ""


def verdict_tiles(comparison: RunComparison) -> Table:
    """A card for each metric that is judged, over everything: the change, its interval, what is shown."""
    overall = changes_over_everything(comparison)
    overall = overall.loc[[name for name in HEADLINES if name in overall.index]]
    cells = []
    for row, change in zip(overall.to_dict("records"), _change_cells(overall), strict=True):
        p_value = p_text(row["p_holm"])
        interval = "" if row["ci95"] is None else f"95 %: {points_interval(row['ci95'])}"
        about = f"{hundredths(row['before'])} to {hundredths(row['after'])} %"
        below = (str(row["verdict"]), about, ", ".join(filter(None, (interval, p_value and f"p {p_value}"))))
        cells.append(replace(change, text=f"{change.text} points", below=below, style=change.style or "strong"))
    headings = [HEADLINES[str(name)] for name in overall.index]
    return Table(columns=headings, rows=[cells], words=0, look="tiles")


def _change_cells(rows: pd.DataFrame) -> list[Cell]:
    """The differences as dots with their intervals on one scale, in the colour of what is shown."""
    ends = [abs(end) for ci95 in rows["ci95"] if ci95 is not None for end in ci95]
    scale = 2.1 * max([*ends, *rows["difference"].abs().dropna(), 1e-9])
    cells = []
    for difference, ci95, verdict in zip(rows["difference"], rows["ci95"], rows["verdict"], strict=True):
        interval = None if ci95 is None else (0.5 + ci95[0] / scale, 0.5 + ci95[1] / scale)
        bar = Bar(share=0.5 + difference / scale, interval=interval, tick=0.5, dot=True)
        cells.append(
            Cell(points(difference), style=STYLES.get(verdict, ""), bar=None if math.isnan(difference) else bar)
        )
    return cells


def headline_table(comparison: RunComparison) -> Table:
    """The metrics that are judged, by kind of motion, with their verdicts; kinds without object-frames are left out."""
    title = f"{comparison.after.label} (after) against {comparison.before.label} (before), percent"
    return _change_table(comparison.changes, HEADLINES, title, ["metric", "label", "verdict"], [*_CHANGE, "p_holm"])


def _recording_table(comparison: RunComparison) -> Table:
    """The metrics that are judged, by recording: all moving objects of each, and its whole images."""
    sides = {"before": comparison.before, "after": comparison.after}
    values = pd.concat({side: recording_values(run.sums)[0] for side, run in sides.items()}, axis=1).sort_index()
    columns = [Column(f"{label}: {side}", _bound) for label in HEADLINES.values() for side in sides]
    gains = values["after", "iou"] - values["before", "iou"]
    return Table(
        title=f"By recording, percent, before and after; better or worse by {HEADLINES['iou']}",
        columns=["Recording", *columns],
        rows=values[[(side, name) for name in HEADLINES for side in sides]].reset_index(),
        tags=[{"recording": str(name), "change": _direction(gain)} for name, gain in gains.items()],
    )


def _direction(gain: float) -> str:
    """Better or worse; "" for neither."""
    return Shown.BETTER.value if gain > 0 else Shown.WORSE.value if gain < 0 else ""


def _further_table(comparison: RunComparison) -> Table:
    """The other metrics, and what bounds all of them: the chance level of detection, the score of the exact masks."""
    title = "All metrics, percent, with chance levels and the ceiling"
    numbers = ["frames_before", *_CHANGE, "chance_before", "chance_after", "ceiling"]
    changes = comparison.changes
    return _change_table(changes, changes.index.unique("metric"), title, ["metric", "label"], numbers)


def _change_table(
    changes: pd.DataFrame, metrics: Iterable[str], title: str, words: Sequence[str], numbers: Sequence[str]
) -> Table:
    """For each metric the rows that have it."""
    held = changes[changes["frames_before"] > 0].reset_index()
    rows = pd.concat([held[held["metric"] == metric] for metric in metrics])
    tags = [*map(_motion_tag, rows["slice"])]
    if "verdict" in words:
        tags = [{**tag, "change": str(verdict)} for tag, verdict in zip(tags, rows["verdict"], strict=True)]
        rows = rows.assign(difference=pd.Series(_change_cells(rows), rows.index, dtype=object))
    columns = {name: _COLUMNS[name] for name in (*words, *numbers)}
    return Table(title=title, columns=columns, rows=rows, words=len(words), tags=tags)


def _detection_table(comparison: RunComparison) -> Table:
    return Table(
        title=f"Object-frames gained and lost: found by {found_by(comparison.before.protocol)}",
        columns=["Type", "Object-frames", "detected before", "after", "newly detected", "newly missed"],
        rows=comparison.detections.rename(index=LABELS).reset_index(),
        tags=[*map(_motion_tag, comparison.detections.index)],
    )


def _frame_table(kind: str, frames: pd.DataFrame) -> Table:
    what, which = "share of the image", "the image with most"
    if frames["track_id"].notna().all():
        what, which = "coverage", f"largest first, one per object, at most {LISTED}"
    records = frames.to_dict("records")
    names = [frame_title(frame).removeprefix(kind).lstrip(": ") for frame in records]
    before = Column(f"{what} before, percent", hundredths)
    return Table(
        title=f"{kind.capitalize()}: {which}",
        columns={"name": "Frame", "before": before, "after": Column("after", hundredths)},
        rows=frames.assign(name=names),
        tags=[*map(_frame_tags, records)],
    )


def report(comparisons: Sequence[RunComparison], *, out: Path) -> Report:
    """The first run with each of the others; of numbers a line per pair of runs, row and metric, ratios in [0, 1].

    Args:
        comparisons: with the same first run.
        out: folder from which links to runs lead.
    """
    first = comparisons[0].before.manifest
    data = first.dataset
    about = (
        f"Data set {data.name}, {data.split or 'all recordings'}, protocol {first.protocol.name} "
        f"({short_digest(first.protocol.digest)}), reference {short_digest(str(first.reference))}."
    )
    sections = [
        Group(look="section", name=f"pair-{number}",
              title=f"{pair.after.label} against {pair.before.label}" if comparisons[1:] else "What is shown",
              blocks=[*_pair(pair, out, filters=number == 1)])
        for number, pair in enumerate(comparisons, start=1)
    ]  # fmt: skip
    how = Group(look="section", name="how", title="How to read it", blocks=[Paragraph(about), Paragraph(NOTE)])
    tables = {(c.before.label, c.after.label): _numbers(c).assign(**_images(c)) for c in comparisons}
    return Report(
        title=f"{', '.join(c.after.label for c in comparisons)} against {comparisons[0].before.label}",
        blocks=[*sections, how],
        numbers=pd.concat(tables, names=["before_run", "after_run"]).droplevel(2).reset_index(),
        page=True,
    )


def _images(comparison: RunComparison) -> dict[str, int]:
    return dict(zip(("images_before", "images_after", "images_compared"), comparison.images, strict=True))


def _numbers(comparison: RunComparison) -> pd.DataFrame:
    """A line for each row and metric."""
    table = comparison.changes.reset_index().rename(columns={"slice": "row", "frames_before": "frames"})
    table[["ci95_low", "ci95_high"]] = [ci95 or (math.nan, math.nan) for ci95 in table["ci95"]]
    counts = ["p_value", "cases_before", "cases_after", "recordings"]
    shown = ["row", "frames", "metric", "verdict", "before", "after", "difference", *counts]
    return table[[*shown, "ci95_low", "ci95_high", "p_holm", "chance_before", "chance_after", "ceiling"]]


CHANGES = "object_changes.csv"
_CHANGED = ("gained", "lost", "both")


def _write_object_changes(file: Path, comparisons: Sequence[RunComparison]) -> None:
    """Write one line per object-frame that was gained, was lost, or changed its coverage, a part of them at a time."""
    columns = ["before_run", "after_run", "recording", "camera", "timestamp_ns", "track_id", "object_class", "category",
               "range_m", "region_px", "change", "coverage_before", "coverage_after", "iou_before",
               "iou_after"]  # fmt: skip
    refuse_foreign(file, columns[0])
    with replacing(file) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        stream.write(",".join(columns) + "\n")
        for comparison in comparisons:
            for rows in paired_objects(comparison.before, comparison.after):
                changed = rows[rows["change"].isin(_CHANGED) & (rows["coverage_before"] != rows["coverage_after"])]
                changed = changed.assign(before_run=comparison.before.label, after_run=comparison.after.label)
                changed[columns].to_csv(stream, header=False, index=False, lineterminator="\n")


_TERMINAL_NOTE = (
    "Differences in percentage points, with 95 % intervals by recording, in pairs; p: corrected over the rows of a "
    f"metric; a verdict needs {FEWEST_RECORDINGS} recordings (recs). All metrics, chance and ceiling: compare.html."
)


def terminal_report(comparison: RunComparison) -> list[Block]:
    """The metrics that are judged, for 100 columns."""
    return [headline_table(comparison), Paragraph(_TERMINAL_NOTE, "dim")]


PICTURED = 2  # frames of each kind
QUALITY = 90  # of JPEG; as PNG a picture takes 2 MB
_PICTURE_NAME = re.compile(r"\d\d-\d\d-[a-z-]+\.jpg")


def _draw_changed_frames(
    comparison: RunComparison, folder: Path, *, number: int, progress: Progress | None
) -> RunComparison:
    """Draw the frames that changed most as both methods were scored on them.

    Args:
        comparison: of two runs.
        folder: of the pictures.
        number: of the comparison, for the names of the files.
        progress: called with the pictures done and their number.

    Returns:
        The comparison with the pictures, and with a line for every reason why one could not be made.
    """
    chosen: dict[ImageKey, dict[str, Mapping[Any, Any]]] = {}  # by image and name
    largest = comparison.frames.groupby("kind", sort=False).head(PICTURED).to_dict("records")
    for ordinal, frame in enumerate(largest, start=1):
        name = f"{number:02d}-{ordinal:02d}-{frame['kind'].replace(' ', '-')}.jpg"
        chosen.setdefault((frame["recording"], frame["camera"], frame["timestamp_ns"]), {})[name] = frame

    def draw(key: ImageKey, both: Sequence[ProcessedFrame], _: FramePipeline) -> dict[str, Mapping[Any, Any]]:
        for name, frame in chosen[key].items():
            figure = draw_frames(_sides(frame, both, comparison), name=image_name(*key), title=_headline(frame))
            write_bytes(folder / name, jpeg_bytes(figure_pixels(figure), quality=QUALITY))
        return chosen[key]

    drawn, problems = draw_images((comparison.before, comparison.after), chosen, draw, progress=progress)
    pictures = {name: frame for of_image in drawn.values() for name, frame in of_image.items()}
    remarks = tuple(f"no picture: {problem}" for problem in problems)
    return replace(comparison, pictures=dict(sorted(pictures.items())), remarks=remarks)


def frame_title(frame: Mapping[Any, Any]) -> str:
    """For example "newly missed: pedestrian 'a', crossing, 5.0 m (drive-1, front, 1200 ms)".

    Args:
        frame: with `CHANGED`.
    """
    return f"{_headline(frame)} ({frame['recording']}, {frame['camera']}, {frame['timestamp_ns'] / 1e6:.0f} ms)"


def _headline(frame: Mapping[Any, Any]) -> str:
    return f"{frame['kind']}: {frame['what']}" if frame["what"] else str(frame["kind"])


def _sides(frame: Mapping[Any, Any], both: Sequence[ProcessedFrame], comparison: RunComparison) -> list[Layers]:
    """Each run with its name, and with the coverage of the object where it is one that changed."""
    runs = comparison.before, comparison.after
    numbers = (frame["before"], frame["iou_before"]), (frame["after"], frame["iou_after"])
    sides = []
    for processed, run, method, (value, iou) in zip(both, runs, comparison.methods, numbers, strict=True):
        label = run.label if method == run.label else f"{run.label}: {method}"
        note = f"coverage {100 * value:.1f} %, IoU {100 * iou:.1f} %" if frame["what"] else ""
        sides.append(scored_layers(processed, label=label, note=note))
    return sides


def write_comparison(
    folders: Sequence[Path],
    out: Path,
    *,
    pictures: bool = True,
    progress: Progress | None = None,
) -> tuple[list[RunComparison], tuple[Path, ...]]:
    """Compare runs and write `compare.html`, `.md`, `.csv`, `object_changes.csv` and `pictures/`.

    Each file appears whole or not at all. Pictures of an earlier comparison in `out` are removed, other files are left.

    Args:
        folders: of the runs, the one compared against first.
        out: folder, is made.
        pictures: draw the frames that changed most; needs the data set and the methods.
        progress: called with the pictures done and their number, for each pair anew.

    Returns:
        comparisons: the first run with each of the others.
        files: paths, texts first.

    Raises:
        DataError: a run is damaged.
        UsageError: fewer than two runs, or runs that do not compare.
    """
    comparisons = compare_runs(read_comparable(folders))
    folder = out / "pictures"
    if pictures:
        numbered = enumerate(comparisons, start=1)
        comparisons = [_draw_changed_frames(c, folder, number=number, progress=progress) for number, c in numbered]
    shown = [name for comparison in comparisons for name in comparison.pictures]
    files = report(comparisons, out=out).write(out, "compare")
    _write_object_changes(out / CHANGES, comparisons)
    for old in sorted(folder.glob("*.jpg")):
        if old.name not in shown and _PICTURE_NAME.fullmatch(old.name):
            old.unlink()
    return comparisons, (*files, out / CHANGES, *(folder / name for name in shown))
