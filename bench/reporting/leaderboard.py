"""A leaderboard: the runs of a folder in groups that compare, ranked, with what bounds them, beside the shipped ones.

"Best" is a method only where `compare` shows it better than every other one; else it is the first.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import count, groupby
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from bench.errors import BenchError, DataError, UsageError
from bench.evaluation.definitions import find_metric
from bench.evaluation.summary import Metric, ObjectMetrics, Summary
from bench.evaluation.sums import ALL_MOVING
from bench.harness.answers import read_seconds
from bench.harness.digests import short_digest
from bench.harness.manifest import ANSWERS_MANIFEST, MANIFEST, PREDICTIONS_DIGEST, Manifest
from bench.harness.stored import SUMMARY, StoredRun, read_run, reference_digest, refuse_unscored
from bench.harness.verify import is_verified
from bench.methods import known_methods
from bench.methods.registry import describe_method
from bench.plain_text import counted
from bench.reporting import formats
from bench.reporting.compare import (
    LEAST_COMMON,
    Shown,
    differing_settings,
    in_one_table,
    on_common_images,
    reference_of,
    what_is_shown_of,
)
from bench.reporting.document import (
    Block,
    Cell,
    Choice,
    Column,
    Filters,
    Group,
    Heading,
    Items,
    Paragraph,
    Table,
    section,
    to_markdown,
    to_page,
    write_together,
)
from bench.reporting.run_tables import SWEEP

STORED = "leaderboard.json"
ORDERED_BY = "iou"
RANKING_PROTOCOL = "surface-v1"  # orders methods as exact masks do (reports/paper/reference.md)
ORACLE_SETTINGS = ("sees_the_truth", "sees_the_reference")  # true for what is given more than a method may know
HIDDEN_SETTINGS = (*ORACLE_SETTINGS, "scenario")  # distinguish no methods: a table says the kind, and a path is a path
FALSE_POSITIVES, OF_PIXELS = "false_positive_coverage", "segmentation_iou"  # of whole images, the same in every row
PREDICTED = "bench.methods.predictions.method:PredictedMotion"  # of masks that `evaluate` scored
# What readers call a method whose key says little; of others the key with spaces.
NAMES = {
    "spherical": "the paper's method",
    "spherical-guided": "the paper's method, its flow guided by the road",
    "spherical-sparse": "the paper's constraints on sparse tracks",
    "spherical-visual-odometry": "the paper's method with visual odometry",
    "learned": "a trained network",
    "truth": "the exact masks",
}


# Of masks: an oracle is given what no method may know, the ceiling is the exact masks, pixel by pixel.
Kind = Literal["method", "oracle", "ceiling"]


class _Stored(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Entry(_Stored):
    """A run in a table.

    Attributes:
        run: folder, relative to the one that was searched.
        method: as readers call it, with those settings in which its runs of the group differ from its defaults.
        key: that `--method` takes.
        about: what it does, in a line; "" where that is not known here.
        code_file: that holds it; "" for one that is not of this package.
        kind: a method, or what bounds methods.
        values: row -> metric -> value, of all images of the group; what is of whole images stands in every row.
        images: that the run scored; the group may be taken over fewer.
        cost_ms: median time of the method for an image; None of what is none.
        date: UTC, on which it was started.
        code: version and commit.
        failures: images, units and recordings that could not be used.
        verified: its counts were found again from its masks, on this machine.
        shipped: it is a row of the leaderboard that comes with the package, and no run.
        rank: among the methods of the group; None for what is none.
        behind: the first of the group is shown to be better; None for the first, and where that was not compared.
    """

    run: str
    method: str
    key: str
    about: str
    code_file: str
    kind: Kind
    values: dict[str, dict[str, Metric]]
    images: int
    cost_ms: float | None
    date: str
    code: str
    failures: int
    verified: bool
    shipped: bool = False
    rank: int | None = None
    behind: bool | None = None

    @property
    def metrics(self) -> Mapping[str, Metric]:
        """Over all moving objects."""
        return self.values[ALL_MOVING]


class RankedGroup(_Stored):
    """Runs of one data set, split and protocol, on the images that all of them scored, where their references agree.

    Attributes:
        images: that all runs scored; all values are of these.
        reference_digest: of the reference on these images.
        cases: row -> object-frames and recordings; all moving objects, then the categories that occur.
        ceilings: row -> metric -> value of the exact masks; what is unknown is left out.
        entries: methods, best first by IoU over all moving object-frames, then what bounds them.
        unreviewed: says that nobody has looked at the annotations, as `RunSummary.unreviewed`.
    """

    dataset: str
    split: str | None
    protocol: str
    protocol_digest: str
    reference_digest: str
    images: int
    cases: dict[str, tuple[int, int]]
    ceilings: dict[str, dict[str, float]]
    entries: tuple[Entry, ...]
    unreviewed: str

    @property
    def judged(self) -> bool:
        """True if its protocol is the one that says which method is best."""
        return self.protocol == RANKING_PROTOCOL

    @property
    def methods(self) -> tuple[Entry, ...]:
        """Those that anybody could run, best first."""
        return tuple(entry for entry in self.entries if entry.kind == "method")

    @property
    def best(self) -> bool:
        """True if the first method is shown to be better than each of the others."""
        return self.judged and len(self.methods) > 1 and all(entry.behind for entry in self.methods[1:])

    @property
    def title(self) -> str:
        """Data, protocol, reference and images that its runs share."""
        object_frames, recordings = self.cases[ALL_MOVING]
        cases = f"{counted(object_frames, 'object-frame')}, {counted(recordings, 'recording')}"
        told = (
            f"{self.dataset}, {self.split or 'all recordings'}, {self.protocol} "
            f"({short_digest(self.protocol_digest)}), reference {short_digest(self.reference_digest)}: "
            f"{counted(self.images, 'image')} that all scored, {cases}"
        )
        return "; ".join(filter(None, (told, self.unreviewed.rstrip("."))))

    def compares_with(self, other: RankedGroup) -> bool:
        """True if its values are of the same data, rules, images and reference."""
        same = ("dataset", "split", "protocol_digest", "reference_digest", "images")
        return all(getattr(self, name) == getattr(other, name) for name in same)

    def ranked(self, entries: Sequence[Entry], **others: object) -> RankedGroup:
        """The group with other entries, methods with their ranks before what bounds them, both in the order of IoU."""
        ranks = count(1)
        ordered = tuple(
            entry.model_copy(update={"rank": next(ranks) if entry.kind == "method" else None})
            for entry in sorted(entries, key=_best_first)
        )
        return self.model_copy(update={"entries": ordered} | others)


def _best_first(entry: Entry) -> tuple[bool, float, str]:
    value = entry.metrics[ORDERED_BY].value
    return entry.kind != "method", (math.inf if math.isnan(value) else -value), entry.run


class Leaderboard(_Stored):
    """Runs of a folder, in groups; `leaderboard.json`.

    Attributes:
        groups: runs that compare; never two in one table that do not.
        not_ranked: folder of every other run, and why it is in no table: not finished, without scores or damaged.
    """

    schema_version: Literal[6] = 6
    groups: tuple[RankedGroup, ...]  # data sets of most recordings first; of one, first those by the judging protocol
    not_ranked: tuple[tuple[str, str], ...]


# From runs to groups.


def read_leaderboard(folder: Path) -> Leaderboard:
    """Find and read all runs under a folder, at any depth; the values of a sweep below it are no entries.

    Raises:
        DataError: there is no folder, or no run in it.
    """
    found, not_ranked = read_runs(folder)
    groups: list[RankedGroup] = []
    for _, of_same_rules in groupby(sorted(found, key=_data_and_rules), key=_data_and_rules):
        runs = list(of_same_rules)
        if len({reference_of(run) for run in runs}) > 1:  # so that all their rows are read
            runs = [run for run in runs if _is_readable(run, not_ranked)]
        tables: list[list[StoredRun]] = []
        for run in sorted(runs, key=lambda run: (-run.summary.images.evaluated, run.label)):
            table = next((table for table in tables if in_one_table(table, run)), [])
            if not table:
                tables.append(table)
            table.append(run)
        groups += map(rank_runs, tables)
    most: dict[str, int] = {}
    for group in groups:
        most[group.dataset] = max(group.cases[ALL_MOVING][1], most.get(group.dataset, 0))
    groups.sort(key=lambda g: (-most[g.dataset], g.dataset, g.split or "", not g.judged))  # else as they came
    return Leaderboard(groups=tuple(groups), not_ranked=tuple(sorted(not_ranked)))


def read_runs(folder: Path) -> tuple[list[StoredRun], list[tuple[str, str]]]:
    """Read the runs under a folder, at any depth, itself included.

    Returns:
        runs: the results by each protocol, called as the folder of the run below this one.
        not_ranked: folder of each that is not finished, without scores or damaged, and what says so.

    Raises:
        DataError: there is no folder, or no run in it.
    """
    if not folder.is_dir():
        raise DataError(folder, expected="a folder of runs", got="no such folder")
    places = {file.parent for file in folder.rglob(MANIFEST) if (file.parent.parent / ANSWERS_MANIFEST).is_file()}
    places |= {file.parent for file in folder.glob(SUMMARY)}  # the results of one protocol, named themselves
    places = {place for place in places if place.parents[1] == folder or not (place.parents[1] / SWEEP).is_file()}
    if not places:
        raise DataError(folder, expected="at least one run", got=f"no {ANSWERS_MANIFEST} at any depth")
    runs: list[StoredRun] = []
    not_ranked: list[tuple[str, str]] = []
    for place in sorted(places):
        run = place.parent
        name = run.relative_to(folder).as_posix() if folder in run.parents else run.resolve().name
        if not (place / SUMMARY).exists():
            not_ranked.append((f"{name}/{place.name}", "not finished; the same `fisheye-bench run` goes on from there"))
            continue
        try:
            stored = read_run(place, label=name)
            refuse_unscored(stored.summary, place)
            if not stored.summary.images.evaluated:
                raise UsageError("no image of it was scored")
            runs.append(stored)
        except BenchError as error:
            not_ranked.append((f"{name}/{place.name}", str(error)))
    return runs, not_ranked


def _is_readable(run: StoredRun, not_ranked: list[tuple[str, str]]) -> bool:
    """Whether all tables of a run can be read; if not, it is listed with its fault."""
    try:
        reference_digest(run.parts)
    except BenchError as error:
        not_ranked.append((f"{run.label}/{run.folder.name}", str(error)))
        return False
    return True


def _data_and_rules(run: StoredRun) -> tuple[str, str, str]:
    return run.manifest.dataset.name, run.manifest.dataset.split or "", run.manifest.protocol.digest


def rank_runs(runs: Sequence[StoredRun]) -> RankedGroup:
    """Take runs that compare over the images that all of them scored, and rank them."""
    compared = on_common_images(runs)
    first, metrics = runs[0].manifest, compared[0].metrics
    cases = {
        name: (row.object_frames, row.recordings)
        for name, row in _rows(metrics).items()
        if row.object_frames or name == ALL_MOVING
    }
    differing = differing_settings([run.manifest for run in runs], hidden=HIDDEN_SETTINGS)
    pairs = [(_entry(run, own, rows=cases), run) for run, own in zip(compared, differing, strict=True)]
    group = RankedGroup(
        dataset=first.dataset.name,
        split=first.dataset.split,
        protocol=first.protocol.name,
        protocol_digest=first.protocol.digest,
        reference_digest=reference_of(compared[0]),
        images=metrics.images.evaluated,
        cases=cases,
        ceilings={name: _ceilings(name, pairs) for name in cases},
        entries=(),
        unreviewed=next((run.summary.unreviewed for run in runs if run.summary.unreviewed), ""),
    )
    methods = sorted((pair for pair in pairs if pair[0].kind == "method"), key=lambda pair: _best_first(pair[0]))
    behind = {
        entry.run: what_is_shown_of(run, methods[0][1], ORDERED_BY) is Shown.BETTER
        for entry, run in (methods[1:] if group.judged else [])
    }
    return group.ranked([entry.model_copy(update={"behind": behind.get(entry.run)}) for entry, _ in pairs])


def _rows(metrics: Summary) -> dict[str, ObjectMetrics]:
    return {ALL_MOVING: metrics.all_moving} | metrics.categories


def _ceilings(row: str, pairs: Sequence[tuple[Entry, StoredRun]]) -> dict[str, float]:
    """Values of the exact masks: all of their own run; without it, two that runs of data with truth know."""
    known: dict[str, Metric] = {}
    for entry, run in pairs:
        metrics = _rows(run.metrics)[row]
        ceilings = [name for name in metrics.metric_names() if name.startswith("ceiling_")]
        known |= {name.removeprefix("ceiling_"): metrics.metric(name) for name in ceilings}
        if entry.kind == "ceiling":
            known = entry.values[row]
            break
    return {name: metric.value for name, metric in known.items() if not math.isnan(metric.value)}


def _entry(run: StoredRun, differing: Mapping[str, object], *, rows: Mapping[str, object]) -> Entry:
    summary, metrics, code, method = run.summary, run.metrics, run.manifest.code, run.manifest.method
    false = metrics.false_positives
    highest = ["detection_rate", *formats.detection_levels(metrics.all_moving.metric_names())][-1]
    of_images = {FALSE_POSITIVES: false.coverage, formats.LARGE_FALSE: false.frame_rate,
                 OF_PIXELS: metrics.segmentation.iou}  # fmt: skip
    changed = [f"{name}={value}" for name, value in method.changed_settings().items() if name in differing]
    known = method.is_own and method.place == known_methods().get(method.name)
    return Entry(
        run=run.label,
        method=", ".join([NAMES.get(method.name, method.name.replace("-", " ")), *changed]),
        key=method.called,
        about=describe_method(method.place) if known else "",
        code_file=method.place.partition(":")[0].replace(".", "/") + ".py" if method.is_own else "",
        kind=_kind(run.manifest),
        values={
            name: {ORDERED_BY: row.iou, **of_images, "tpr_all": row.tpr_all, highest: row.metric(highest)}
            for name, row in _rows(metrics).items()
            if name in rows
        },
        images=summary.images.evaluated,
        cost_ms=_cost_ms(run),
        date=summary.provenance.started_utc[:10],
        code=code.version if code.commit is None else f"{code.version} {short_digest(code.commit)}",
        failures=len(summary.failures),
        verified=is_verified(run),
    )


def _kind(manifest: Manifest) -> Kind:
    settings = manifest.method.settings
    if not any(settings.get(name) for name in ORACLE_SETTINGS):
        return "method"
    exact = manifest.method.name == "truth" and settings.get("cell_size_px") == 1
    return "ceiling" if exact else "oracle"


def _cost_ms(run: StoredRun) -> float | None:
    """Median time of the method for an image, as the answers hold it."""
    if _kind(run.manifest) != "method" or PREDICTIONS_DIGEST in run.manifest.method.settings:
        return None
    seconds = read_seconds(run.answers)
    return 1e3 * float(np.nanmedian(seconds)) if np.isfinite(seconds).any() else None


def with_shipped(board: Leaderboard, file: Path) -> Leaderboard:
    """Put the shipped rows beside the runs that compare with them: same data, protocol, images and reference.

    A method that the folder holds itself stands there once, as the folder has it.

    Args:
        board: of a folder.
        file: `leaderboard.json`; where there is none, or one of another schema, no row is added.
    """
    try:
        shipped = Leaderboard.model_validate_json(file.read_bytes()).groups
    except (OSError, ValidationError):
        return board
    return board.model_copy(update={"groups": tuple(_beside_shipped(group, shipped) for group in board.groups)})


def _beside_shipped(group: RankedGroup, shipped: Sequence[RankedGroup]) -> RankedGroup:
    same = next((other for other in shipped if other.compares_with(group)), None)
    if same is None:
        return group
    own = {entry.method for entry in group.entries}
    others = [e.model_copy(update={"shipped": True, "behind": None}) for e in same.entries if e.method not in own]
    ceilings = {row: same.ceilings[row] | known for row, known in group.ceilings.items()}
    return group.ranked([*group.entries, *others], ceilings=ceilings)


# For people.

TITLE = "Leaderboard: which method finds what moves"
ABOUT = (
    "Methods that mark what moves in the images of a driving car's fisheye camera, on the same images. Ranked by "
    f"{RANKING_PROTOCOL}, which ranks methods as exact masks would if they make similar errors; other protocols "
    "have tables of their own."
)
NOTES = (
    "In percent, of the images that all runs of a table scored: at least "
    f"{100 * LEAST_COMMON:.0f} % of those of each, with the same reference. {formats.INTERVALS}",
    "Ranked by IoU over all moving object-frames, an undetected one having 0. A false positive is large if it has more "
    "pixels than the protocol states; coverage hides it. Best is a method only where `compare` shows it better than "
    "each of the others; else it is the first, and those that are not shown to be behind it are “or 1”. Specks apart "
    "from objects cost no IoU of objects; the IoU of pixels counts them.",
    f"Ceiling: {formats.CEILING}. Oracles are given what no method may know. Cost: median time of the method alone for "
    "an image, in one thread. Verified: `verify` counted the run again on this machine. Shipped: a row that comes with "
    "the package, not compared in pairs.",
)


def leaderboard_tables(board: Leaderboard) -> Iterator[Block]:
    """A table per group over all moving objects, readable at 110 columns; then how to read them."""
    for group in board.groups:
        yield replace(_main_table(group, without=OF_PIXELS), title=group.title)
    yield from (Paragraph(note, "dim") for note in NOTES)


def _main_table(group: RankedGroup, *, without: str = "") -> Table:
    """Metrics over all moving objects, and the cost."""
    names = [name for name in group.entries[0].metrics if name != without]
    columns = {(ALL_MOVING, name): find_metric(name).label for name in names}
    return _table(group, columns, title=formats.LABELS[ALL_MOVING], costs=True)


def _kinds_table(group: RankedGroup) -> Table:
    """IoU of each kind of motion."""
    columns = {
        (name, ORDERED_BY): f"{formats.LABELS[name]} ({object_frames}, {recordings})"
        for name, (object_frames, recordings) in group.cases.items()
        if name != ALL_MOVING
    }
    return _table(group, columns, title="IoU by kind of motion (object-frames, recordings)")


def _table(group: RankedGroup, columns: Mapping[tuple[str, str], str], *, title: str, costs: bool = False) -> Table:
    """Metrics of rows with a bar, the interval across it and a tick at the ceiling; the ceiling last if not a run."""
    ceilings = {key: group.ceilings[key[0]].get(key[1]) for key in columns}
    rows: list[list[object]] = []
    for entry in group.entries:
        cells = [formats.bar_cell(entry.values[row][name], tick=tick) for (row, name), tick in ceilings.items()]
        rows.append([_rank(group, entry), _named(entry), *cells, *([entry.cost_ms] if costs else [])])
    if any(ceilings.values()) and all(entry.kind != "ceiling" for entry in group.entries):
        line = [None if value is None else Cell(formats.percent(value)) for value in ceilings.values()]
        rows.append(["", Cell("ceiling: the exact masks", style="dim"), *line, *([None] if costs else [])])
    cost = [Column("ms per image", "{:.1f}".format)] if costs else []
    return Table(title=title, columns=["Rank", "Method, run", *columns.values(), *cost], rows=rows, words=2)


def _rank(group: RankedGroup, entry: Entry) -> Cell:
    """The rank, and below it whether the first is the best or another is not shown to be behind it."""
    if entry.rank is None or entry.shipped or not group.judged:
        return Cell(str(entry.rank or ""))
    if entry.rank == 1:
        return Cell("1", ("best" if group.best else "first",))
    not_compared = any(other.shipped for other in group.methods[: entry.rank - 1])  # in pairs
    return Cell(str(entry.rank), () if entry.behind or not_compared else ("or 1",))


def _named(entry: Entry) -> Cell:
    """The method, the kind of what is none, what is to be known of the run; its key and the run's folder below."""
    told = {
        entry.kind: entry.kind != "method",
        counted(entry.failures, "failure"): entry.failures > 0,
        "verified": entry.verified,
        "shipped": entry.shipped,
    }
    return Cell(
        ", ".join([entry.method, *(words for words, true in told.items() if true)]),
        ("masks of `evaluate`" if entry.key == PREDICTED else f"--method {entry.key}", entry.run),
        "" if entry.kind == "method" else "dim",
    )


def _methods(board: Leaderboard) -> Group:
    """What each method does, where its code is, and the runs that the tables show."""
    entries = [entry for group in board.groups if group.judged or len(board.groups) == 1 for entry in group.entries]
    rows = [[e.method, e.about, e.code_file, e.run, e.images, e.date, e.code] for e in entries]
    columns = ["Method", "What it does", "Code", "Run", "Images", "Scored", "by"]
    table = Table(columns=columns, rows=rows, words=len(columns))
    return section("methods", "The methods", [table])


def write_leaderboard(board: Leaderboard, out: Path) -> tuple[Path, ...]:
    """Write `index.html`, `leaderboard.json` and `.md`, each file whole or not at all; the files, the page first.

    Args:
        board: the runs.
        out: folder, is made.
    """
    others = Items([f"{run}: {reason}" for run, reason in board.not_ranked])
    not_ranked = [section("not-ranked", "Runs that are not ranked", [others])] if board.not_ranked else []
    notes = [Paragraph(note, "dim") for note in NOTES]
    tables = [_group(group) for group in board.groups]
    first: Mapping[str, str] = tables[0].tags if tables else {}
    choices = [Choice(tag, label, first.get(tag, "")) for tag, label in TAGS.items()]
    page: list[Block] = [
        Paragraph(ABOUT),
        section("table", "All runs", [Filters(choices), *tables]),
        _methods(board),
        section("how", "How to read it", notes),
        *not_ranked,
    ]
    sections = [replace(table, look="section") for table in tables]
    own = [g.model_copy(update={"entries": tuple(e for e in g.entries if not e.shipped)}) for g in board.groups]
    texts = {
        "index.html": to_page(TITLE, page),
        STORED: board.model_copy(update={"groups": tuple(own)}).model_dump_json() + "\n",
        "leaderboard.md": to_markdown([Heading("Leaderboard", 1), *notes, *sections, _methods(board), *not_ranked]),
    }
    return write_together(out, texts)


TAGS = {"dataset": "Data set", "protocol": "Protocol"}  # of tables, by which the page filters them


def _group(group: RankedGroup) -> Group:
    data = f"{group.dataset}, {group.split}" if group.split else group.dataset
    tables = [_main_table(group), *([_kinds_table(group)] if len(group.cases) > 1 else [])]
    return Group(title=group.title, blocks=tables, tags=dict(zip(TAGS, (data, group.protocol), strict=True)))
