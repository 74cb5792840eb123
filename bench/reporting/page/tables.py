"""The tables of a page, and the run in a few sentences."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
from markupsafe import Markup

from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.protocol import known_protocols
from bench.evaluation.row_source import Columns, group_recordings
from bench.evaluation.summary import Metric, ObjectMetrics, Summary
from bench.evaluation.sums import coverage, intersection_over_union
from bench.harness import Provenance, RunSummary
from bench.methods import METHODS, build_method
from bench.reference import Category
from bench.reporting.page.source import EVALUATED, LISTED, FrameKey, PageSource, listed_rows
from bench.reporting.sheets import COMPARED, count, detection_figures, difference, interval, mean, ours, paper, percent
from bench.reporting.tables import FALSE_POSITIVES, LABELS, Comparison, TableRow, table_rows


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One figure to show.

    Attributes:
        text: for example "72.1 %".
        interval: for example "65.0 to 78.3"; empty without one.
        notes: lines below, for example "chance 12.0 %".
        value: length of the bar in percent; None without a bar.
        low: lower end of the interval in percent; None without.
        high: upper end.
        paper: where the paper's figure is marked, in percent; None without.
        weakest: whether it is the lowest of its group.
    """

    text: str
    interval: str = ""
    notes: tuple[str, ...] = ()
    value: float | None = None
    low: float | None = None
    high: float | None = None
    paper: float | None = None
    weakest: bool = False


def figure_cell(figure: Metric | Comparison, *, notes: tuple[str, ...] = (), weakest: bool = False) -> Cell:
    """A ratio."""
    if math.isnan(figure.value):
        return Cell(text=percent(figure.value, cases=figure.cases))
    low, high = (None, None) if figure.ci95 is None else (100 * figure.ci95[0], 100 * figure.ci95[1])
    theirs = getattr(figure, "paper", math.nan)
    return Cell(
        text=percent(figure.value),
        interval="" if low is None else f"{low:.1f} to {high:.1f}",
        notes=notes,
        value=100 * figure.value,
        low=low,
        high=high,
        paper=None if math.isnan(theirs) else 100 * theirs,
        weakest=weakest,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class CellRow:
    """A row of cells; `name` heads it, `counts` are numbers in words."""

    name: str
    counts: tuple[str, ...]
    cells: tuple[Cell, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class CellTable:
    """A table of the page."""

    caption: str
    headings: tuple[str, ...]
    rows: tuple[CellRow, ...]


BREAKDOWN_FIGURES = {
    "detection_rate": "found at all",
    "detection_rate_50": "half of it found",
    "tpr_all": "share found (TPR, all)",
    "iou": "IoU, all",
}


def figures_table(caption: str, first: str, rows: dict[str, ObjectMetrics]) -> CellTable:
    """Rows of one breakdown, those without cases included; the lowest share found is marked where it is shown."""
    names = {n: h for n, h in BREAKDOWN_FIGURES.items() if all(n in row.metric_names() for row in rows.values())}
    lowest = lowest_of({name: row.tpr_all for name, row in rows.items()})
    return CellTable(
        caption=caption,
        headings=(first, "recordings", "object-frames", "objects", *names.values()),
        rows=tuple(
            CellRow(
                name=name,
                counts=(str(row.recordings), str(row.object_frames), str(row.tracks)),
                cells=tuple(
                    figure_cell(
                        row.metric(n),
                        notes=_chance(row, n),
                        weakest=n == "tpr_all" and name == lowest,
                    )
                    for n in names
                ),
            )
            for name, row in rows.items()
        ),
    )


def lowest_of(figures: Mapping[str, Metric]) -> str | None:
    """The lowest of several figures by name; None where no interval of another lies wholly above its own."""
    known = {name: figure for name, figure in figures.items() if figure.ci95 is not None}
    lowest = min(known, key=lambda name: known[name].value, default=None)
    if lowest is None or min(f.value for f in figures.values() if not math.isnan(f.value)) < known[lowest].value:
        return None
    return lowest if any(clearly_below(known[lowest], other) for other in known.values()) else None


def clearly_below(figure: Metric, other: Metric) -> bool:
    """Whether both have intervals and the one lies wholly below the other."""
    return figure.ci95 is not None and other.ci95 is not None and figure.ci95[1] < other.ci95[0]


def _chance(row: ObjectMetrics, name: str) -> tuple[str, ...]:
    if not name.startswith("detection_rate"):
        return ()
    chance = row.metric(name.replace("detection_rate", "chance"))
    return () if math.isnan(chance.value) else (f"chance {percent(chance.value)}",)


NEAR_CHANCE = 0.05
_HALF = "detection_rate_50"
_GROUPS = {
    "object_class": "class {}",
    "range_m": "range {} m",
    "ego_speed_mps": "host speed {} m/s",
    "camera": "camera {}",
    "points": "{} lidar points",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Remark:
    """One sentence; `kind` gives its mark."""

    kind: Literal["good", "bad", "note"]
    text: str


def remarks(figures: Summary, *, category: Category | None) -> list[Remark]:
    """What a reader should know first."""
    rows = {name: row for name, row in figures.categories.items() if row.object_frames}
    if not rows:
        return [Remark(kind="note", text="No object-frame was evaluated: there is nothing to say of moving objects.")]
    told = [*_best_and_worst(rows), *_by_chance(rows), *_weak_places(figures)]
    return told if category is not None else [*told, *_false_positives(figures), *_missing(figures)]


def _best_and_worst(rows: dict[str, ObjectMetrics]) -> list[Remark]:
    """The best and the weakest kind of motion where their intervals lie apart; all of them as they are otherwise."""
    told = {name: row.tpr_all for name, row in rows.items() if row.tpr_all.ci95 is not None}
    order = sorted(told, key=lambda name: told[name].value)
    if len(order) > 1 and clearly_below(told[order[0]], told[order[-1]]):
        left = [f"{_name(n).lower()} ({row.recordings})" for n, row in rows.items() if n not in told]
        few = f" Left out, with fewer than {FEWEST_RECORDINGS} recordings: {', '.join(left)}." if left else ""
        return [
            Remark(kind="good", text=f"Best: {_name(order[-1]).lower()}, {_found(rows[order[-1]])}.{few}"),
            Remark(kind="bad", text=f"Weakest: {_name(order[0]).lower()}, {_found(rows[order[0]])}."),
        ]
    if len(rows) == 1:
        return [Remark(kind="note", text=f"{_name(name)}: {_found(row)}.") for name, row in rows.items()]
    shares = ", ".join(f"{_name(name).lower()} {percent(row.tpr_all.value)}" for name, row in rows.items())
    text = f"Share of an object that is found, on average: {shares}; the recordings are too few to call one the best."
    return [Remark(kind="note", text=text)]


def _by_chance(rows: dict[str, ObjectMetrics]) -> list[Remark]:
    """A rate that the mask of another image reaches too says nothing."""
    near, unknown = [], []
    for name, row in rows.items():
        figure_name = _HALF if _HALF in row.metric_names() else "detection_rate"
        rate, chance = row.metric(figure_name), row.metric(figure_name.replace("detection_rate", "chance")).value
        if rate.ci95 is None:
            unknown.append(f"{_name(name).lower()} ({row.recordings})")
        elif rate.ci95[0] < chance:
            near.append(f"{_name(name).lower()} ({percent(rate.value)}, by chance {percent(chance)})")
    touched = [n for n, row in rows.items() if row.detection_rate.value - row.chance.value < NEAR_CHANCE]
    told = []
    if unknown:
        text = f"Recordings too few to tell from chance, {FEWEST_RECORDINGS} are needed: {', '.join(unknown)}."
        told.append(Remark(kind="note", text=text))
    if near:
        text = f"Not clearly better than chance when half of an object must be found: {', '.join(near)}."
        told.append(Remark(kind="bad", text=text))
    if touched:
        names = ", ".join(_name(n).lower() for n in touched)
        text = f"“Found at all” says little for {names}: the mask of another image touches as many of these objects."
        told.append(Remark(kind="note", text=text))
    return told


def _weak_places(figures: Summary) -> list[Remark]:
    """The weakest slice of each breakdown, where its interval lies wholly below that of everything."""
    whole, told = figures.all_moving.tpr_all, []
    for name, words in _GROUPS.items():
        places = {key: row.tpr_all for key, row in figures.breakdowns.get(name, {}).items()}
        known = {key: figure for key, figure in places.items() if clearly_below(figure, whole)}
        if known:
            worst = min(known, key=lambda key: known[key].value)
            told.append(f"{words.format(worst)} with {percent(known[worst].value)}")
    if not told:
        return []
    return [
        Remark(
            kind="bad",
            text=f"Where least of an object is found (on average {percent(whole.value)}): {'; '.join(told)}.",
        )
    ]


def _false_positives(figures: Summary) -> list[Remark]:
    rate = figures.false_positives.coverage
    text = f"Wrongly marked as moving: {percent(rate.value, cases=rate.cases)} of the image on average"
    causes = figures.false_positive_causes
    if causes:
        order = sorted(causes, key=lambda name: -causes[name].value)
        named = [f"{name.replace('_', ' ')} with {percent(causes[name].value)}" for name in order[:2]]
        alone = len(order) == 1 or clearly_below(causes[order[1]], causes[order[0]])
        text += f"; the largest cause is {named[0]}" if alone else f"; the causes ahead are {' and '.join(named)}"
        text += " of the false pixels"
    return [Remark(kind="bad" if rate.value > NEAR_CHANCE else "note", text=f"{text}.")]


def _missing(figures: Summary) -> list[Remark]:
    images = figures.images
    left = images.failed + images.skipped
    if not left:
        return []
    return [
        Remark(kind="bad", text=f"{left} of {images.images} images could not be scored; the last section says why.")
    ]


def _name(category: str) -> str:
    return LABELS[Category(category)].split(" (")[0]


def _found(row: ObjectMetrics) -> str:
    return (
        f"on average {percent(row.tpr_all.value)} of an object is found, over "
        f"{row.object_frames} object-frames of {row.tracks} objects in {row.recordings} recordings"
    )


BREAKDOWNS = {
    "object_class": ("By class", "class"),
    "range_m": ("By range", "nearest point (m)"),
    "ego_speed_mps": ("By speed of the host", "speed (m/s)"),
    "camera": ("By camera", "camera"),
    "points": ("By lidar points on the object", "points"),
}
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """A named length, in percent of the longest possible."""

    name: str
    text: str
    value: float
    interval: str = ""


def headline(rows: Sequence[TableRow]) -> CellTable:
    """Ours beside the paper's: detection rates, TPR and IoU."""
    shown = [row for row in rows if row.name != FALSE_POSITIVES]
    rates = detection_figures(rows)
    return CellTable(
        caption="Results by kind of motion, the paper's figures beside them",
        headings=("kind of motion", "recordings", "object-frames", "objects", *_headings(rates)),
        rows=tuple(
            CellRow(
                name=row.label,
                counts=(count(row.recordings), count(row.frames), count(row.tracks)),
                cells=tuple(_headline_cell(row, name) for name in (*rates, "tpr", "iou_detected")),
            )
            for row in shown
        ),
    )


def _headings(rates: dict[str, str]) -> list[str]:
    first, *others = rates.values()
    return [f"{first} (any pixel)", *(f"found {heading}" for heading in others), "TPR of the found", "IoU of the found"]


def _headline_cell(row: TableRow, name: str) -> Cell:
    figure, notes = row.figures[name], list[str]()
    if name.startswith("detection_rate"):
        chance = row.figures[name.replace("detection_rate", "chance")]
        notes += [] if math.isnan(chance.value) else [f"chance {ours(chance)}"]
    if name in COMPARED:
        told = f" ({difference(figure)})" if difference(figure) else ""
        notes.append(f"paper {paper(figure)}{told}")
    return figure_cell(figure, notes=tuple(notes))


def false_positive_lines(figures: Summary) -> list[tuple[str, str, str]]:
    """Name, figure, and the paper's figure or what it means."""
    last = next(row for row in table_rows(figures) if row.name == FALSE_POSITIVES)
    coverage = last.figures["coverage"]
    return [
        (
            "of the image's area, on average",
            f"{ours(coverage)} {interval(coverage)}",
            f"paper {paper(coverage)} ({difference(coverage)})",
        ),
        (
            "of the valid pixels",
            f"{ours(last.figures['coverage_valid'])} {interval(last.figures['coverage_valid'])}",
            "inside the lens's view and off the host's body",
        ),
        (
            "frames with a large false patch",
            f"{ours(last.figures['frame_rate'])} {interval(last.figures['frame_rate'])}",
            "larger than the protocol states",
        ),
        (
            "false patches per frame",
            mean(last.figures["components_per_frame"]),
            f"over {last.frames} images{of_recordings(last.recordings)}",
        ),
    ]


def of_recordings(recordings: int | None) -> str:
    """For example " of 20 recordings", to be added; "" where it is unknown."""
    return "" if recordings is None else f" of {recordings} recordings"


def breakdown_tables(figures: Summary) -> list[CellTable]:
    """A table for every way to split the object-frames."""
    kinds = {name.replace("_", " "): row for name, row in figures.categories.items()}
    found = (
        [figures_table("By kind of motion", "kind", {"all": figures.all_moving} | kinds)]
        if len([r for r in kinds.values() if r.object_frames]) > 1
        else []
    )
    return [*found, *(figures_table(*BREAKDOWNS[name], rows) for name, rows in figures.breakdowns.items() if rows)]


def cause_bars(figures: Summary) -> list[Bar]:
    """Share of the false pixels by cause, largest first."""
    causes = sorted(figures.false_positive_causes.items(), key=lambda item: -item[1].value)
    return [
        Bar(
            name=name.replace("_", " "),
            text=percent(cause.value),
            value=100 * cause.value,
            interval="" if cause.ci95 is None else f"{100 * cause.ci95[0]:.1f} to {100 * cause.ci95[1]:.1f}",
        )
        for name, cause in causes
        if not math.isnan(cause.value)
    ]


def stage_bars(made: Provenance) -> list[Bar]:
    """Time of every stage, longest first, against all of them."""
    total = sum(made.stage_seconds.values()) or 1.0
    order = sorted(made.stage_seconds.items(), key=lambda item: -item[1])
    per_image = 1e3 / max(made.images, 1)
    return [
        Bar(name=name, text=f"{per_image * seconds:.1f} ms per image ({seconds:.1f} s)", value=100 * seconds / total)
        for name, seconds in order
    ]


def provenance_rows(run: RunSummary) -> list[tuple[str, str]]:
    """What made the run."""
    made = run.provenance
    return [
        ("data set", f"{run.dataset} ({run.card})" + (f", split {run.split}" if run.split else "")),
        ("method", run.method.name),
        ("its settings", json.dumps(run.method.settings)),
        ("protocol", f"{run.protocol.name}, version {run.protocol.version}, digest {run.protocol.digest[:16]}"),
        ("reference", f"fingerprint {run.reference_fingerprint[:16]}"),
        ("data", f"fingerprint {made.data_fingerprint[:16]}"),
        ("code", f"fisheye-bench {made.version}, commit {_commit(made.commit)}"),
        ("Python and libraries", ", ".join([made.python, *(f"{n} {v}" for n, v in made.libraries.items())])),
        ("started", made.started_utc),
        ("took", f"{made.seconds:.1f} s for {made.images} images, at most {made.peak_memory_mb:.0f} MB"),
    ]


def ledger_rows(figures: Summary) -> dict[str, list[tuple[str, int, str]]]:
    """Where every annotated object and every image ended: name, count, why."""
    objects, images = figures.objects, figures.images
    return {
        "objects": [
            ("evaluated", objects.evaluated, "scored above"),
            ("static", objects.static, "does not move, so it is neither searched for nor ignored"),
            *(
                (f"ignored: {name.replace('_', ' ')}", count, REASONS.get(name, ""))
                for name, count in objects.ignored.items()
            ),
            ("annotated, the sum", objects.annotated, "every annotated object in every image, once"),
        ],
        "images": [
            ("scored", images.evaluated, ""),
            ("skipped", images.skipped, "no image before it to compare with, at the time that is due"),
            ("failed", images.failed, "could not be used"),
            ("all, the sum", images.images, "but the first of each recording, which have no history"),
        ],
    }


def _commit(commit: str | None) -> str:
    if commit is None:
        return "unknown"
    return f"{commit[:12]} with changes" if commit.endswith("+") else commit[:12]


_WORDS = ("recording", "camera", "track_id", "object_class", "category", "outcome")
_ORDER = ["recording", "camera", "timestamp_ns", "track_id"]


def table_data(
    source: PageSource, *, pictured: Mapping[tuple[str, str, int, str], str], most: int = LISTED
) -> dict[str, Any]:
    """Columns of the table: words by their place in a dictionary, numbers rounded to what is shown, null for NaN.

    Args:
        source: the run; every annotated object-frame becomes a row where there are few enough of them.
        pictured: image and track -> the id of the element with their pictures; track "" for any object of the image.
        most: rows; where there are more, those with pictures of their own and the least covered are listed.

    Returns:
        `rows`, `annotated` (with those that are not listed), `words` (dictionaries), `columns` (one list each), and
        `command`, which draws an image, with `{recording}`, `{camera}` and `{index}` left to be filled.
    """
    rows, annotated = listed_rows(source.objects, pictured=pictured.keys(), most=most)
    columns: dict[str, list[Any]] = {}
    words: dict[str, list[str]] = {}
    for name in _WORDS:
        shown = _outcomes(rows) if name == "outcome" else pd.Series(_texts(rows, name), dtype=object)
        codes, found = pd.factorize(shown.str.replace("_", " ") if name == "category" else shown, sort=True)
        columns[name], words[name] = codes.tolist(), [str(word) for word in found]
    tp, fp, region = (rows.numbers(name) for name in ("tp", "fp", "region_px"))
    scored = rows.is_word("status", EVALUATED)
    covered, overlap = coverage(tp, rows.numbers("fn")), intersection_over_union(tp, fp, rows.numbers("fn"))
    columns["coverage"] = _numbers(np.where(scored, 100 * covered, np.nan), 1)
    columns["iou"] = _numbers(np.where(scored, 100 * overlap, np.nan), 1)
    columns["false_px"] = _numbers(np.where(scored, fp, np.nan), 0)
    columns["region_px"] = _numbers(np.where(scored, region, np.nan), 0)
    columns["time_s"] = _numbers(rows.integers("timestamp_ns") / 1e9, 3)
    columns["range_m"] = _numbers(rows.numbers("range_m"), 1)
    columns["ego_kmh"] = _numbers(3.6 * rows.numbers("ego_speed_mps"), 1)
    columns["points"] = _numbers(rows.numbers("points"), 0)
    times_ns = rows.integers("timestamp_ns").tolist()
    keys: list[FrameKey] = list(zip(_texts(rows, "recording"), _texts(rows, "camera"), times_ns, strict=True))
    columns["picture"] = [
        pictured.get((*key, track)) or pictured.get((*key, ""), "")
        for key, track in zip(keys, _texts(rows, "track_id"), strict=True)
    ]
    columns["index"] = _image_indices(source, keys)
    return {
        "rows": len(rows),
        "annotated": annotated,
        "words": words,
        "columns": columns,
        "command": view_command(source),
    }


def script_json(content: object) -> Markup:
    """JSON that may stand inside a `<script>` element: nothing in it can close the element or open a comment."""
    text = json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    escapes: dict[str, str | int | None] = {
        "<": "\\u003c",
        ">": "\\u003e",
        "&": "\\u0026",
        "\u2028": "\\u2028",
        "\u2029": "\\u2029",
    }
    return Markup(text.translate(str.maketrans(escapes)))


def view_command(source: PageSource) -> str:
    """The call of `view` that draws an image of the run, with its method, settings and protocol."""
    run = source.run
    words = ["fisheye-bench", "view", run.card, "--method", run.method.called]
    defaults = _default_settings(run.method.called)
    for name, value in _leaves(run.method.settings):
        if _get(defaults, name) != value:
            words += ["--set", f"{name}={json.dumps(value)}"]
    known = source.protocol.name in known_protocols()
    words += ["--protocol", source.protocol.name if known else str(source.folder / "protocol.json")]
    told = " ".join(shlex.quote(word) for word in words)
    return told + " --recording {recording} --camera {camera} --frame {index}"


def _default_settings(method: str) -> dict[str, object]:
    """What need not be said; nothing for a method that is not of this package, since nothing stored is imported."""
    return build_method(method).settings() if method in METHODS else {}


def _image_indices(source: PageSource, keys: Sequence[FrameKey]) -> list[int]:
    """Index of each image among those of its camera; the first ones, which have no history, are in no table."""
    history = 1 if source.run.method.history is None else source.run.method.history
    expected = pd.DataFrame(keys, columns=_ORDER[:3]).drop_duplicates()
    counts = source.frames.recordings()
    index: dict[FrameKey, int] = {}
    for group in group_recordings({name: counts[name] for name in set(expected["recording"])}):
        frames = Columns(source.frames.read(group, _ORDER[:3])).canonical(_ORDER[:3]).table.to_pandas()
        frames["index"] = frames.groupby(_ORDER[:2], sort=False, observed=True).cumcount() + history
        found = expected[expected["recording"].isin(group)].merge(frames.astype(dict.fromkeys(_ORDER[:2], object)))
        index |= dict(zip(zip(*(found[name] for name in _ORDER[:3]), strict=True), found["index"], strict=True))
    return [int(index[key]) for key in keys]


def _outcomes(rows: Columns) -> pd.Series[str]:
    status, reason = (pd.Series(_texts(rows, name), dtype=object) for name in ("status", "reason"))
    return status.where(reason == "", status + ": " + reason.str.replace("_", " "))


def _texts(rows: Columns, name: str) -> list[str]:
    """The words of a column, "" for null."""
    codes, words = rows.words(name)
    texts: list[str] = np.array([*words, ""], dtype=object)[codes].tolist()
    return texts


def _leaves(settings: Mapping[str, object], parents: str = "") -> list[tuple[str, object]]:
    found: list[tuple[str, object]] = []
    for name, value in settings.items():
        if isinstance(value, Mapping):
            found += _leaves(value, f"{parents}{name}.")
        else:
            found.append((parents + name, value))
    return found


def _get(settings: object, name: str) -> object:
    for part in name.split("."):
        settings = settings.get(part) if isinstance(settings, Mapping) else None
    return settings


def _numbers(values: Any, digits: int) -> list[float | int | None]:
    shown = [None if math.isnan(value) else round(float(value), digits) for value in values]
    return [value if value is None or digits else int(value) for value in shown]
