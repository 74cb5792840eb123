"""Results over time: the headline metrics of a method over commits, as tables and a chart.

Runs of one method as it was asked for, on one data set and split by one protocol, are a series, in the order of their
commits. Where two neighbours do not compare, because protocol, data or reference changed, a stretch ends and the line
breaks: the values of a stretch are of the images that all of it scored, as in the leaderboard. What changed from one
run to the next is what `compare` says of the two.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.errors import DataError
from bench.evaluation import Metric, find_metric
from bench.harness.code_state import commit_time
from bench.harness.manifest import Aspect, differences
from bench.reporting import canvas, document
from bench.reporting.canvas import write_picture
from bench.reporting.compare.changes import HEADLINES, RunComparison, Verdict, changes_over_everything, compare_runs
from bench.reporting.compare.writing import points, points_interval
from bench.reporting.document import Block, Cell, Heading, Items, Paragraph, Picture, Style, Table
from bench.reporting.formats import INTERVALS, annotations_field, metric_cell, metric_record, write_texts
from bench.reporting.leaderboard.reading import Group, group_of, read_runs, readable, why_apart
from bench.reporting.stored_run import StoredRun

NOTE = (
    "In percent, over all moving object-frames and, of false positives, over all images that the runs of a table "
    f"scored. {INTERVALS} A change is what compare says of a run and the one before it, in pairs, by recording, on "
    "the images that both scored: overlapping intervals do not say that two runs are equal. Each pair is judged by "
    "itself: of very many steps without any effect a few are called a change. In the order of the commits' times where "
    "the current folder's repository has them, else of the runs' own; + is code that was not committed."
)
COMMIT_CHARS = 8
_STYLES: dict[Verdict, Style] = {Verdict.BETTER: "good", Verdict.WORSE: "bad"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Point:
    """A run of a series.

    Attributes:
        run: as it is stored.
        metrics: the headlines, by name, of the images that all of its stretch scored.
        commit: of the method's code, short, "+" behind it where files were changed; "" where it is unknown.
        time: of the commit; of the run where no repository has the commit.
        since: against the run before it; None of the first of a stretch.
    """

    run: StoredRun
    metrics: Mapping[str, Metric]
    commit: str
    time: datetime
    since: RunComparison | None

    @property
    def name(self) -> str:
        """The commit, or the run where it is unknown."""
        return self.commit or self.run.label

    @property
    def committed(self) -> bool:
        """True if the code is as its commit has it."""
        return bool(self.commit) and not self.commit.endswith("+")

    def change(self, metric: str) -> Mapping[Any, Any] | None:
        """The row of `metric_changes` of a headline since the run before; None where there is none."""
        return None if self.since is None else changes_over_everything(self.since).loc[metric].to_dict()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stretch:
    """Neighbouring runs that compare.

    Attributes:
        group: as the leaderboard has them, on the images that all scored.
        points: at least one, in order.
        break_before: why the first does not compare with the last of the stretch before; "" of the first stretch.
    """

    group: Group
    points: tuple[Point, ...]
    break_before: str


@dataclass(frozen=True, eq=False)
class Series:
    """A method as it was asked for, on one data set, by one protocol.

    Attributes:
        title: method, settings, data set, split and protocol.
        stretches: in order.
    """

    title: str
    stretches: tuple[Stretch, ...]

    @cached_property
    def points(self) -> tuple[Point, ...]:
        """All runs, in order."""
        return tuple(point for stretch in self.stretches for point in stretch.points)

    @property
    def metrics(self) -> list[str]:
        """Names of the headlines that all runs have."""
        return [name for name in HEADLINES if all(name in point.metrics for point in self.points)]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class History:
    """Series of several runs.

    Attributes:
        series: by title.
        alone: titles of what has one run only, and so no history.
        damaged: folder and fault of every run that cannot be read.
        packed: runs in one file, which are left out, with the folder to unpack each into.
    """

    series: tuple[Series, ...]
    alone: tuple[str, ...]
    damaged: tuple[tuple[str, str], ...]
    packed: tuple[tuple[Path, Path], ...]


def read_history(folders: Sequence[Path], *, checkout: Path) -> History:
    """Find and read the runs in folders, at any depth, and compare neighbours.

    Args:
        folders: of runs, or runs themselves.
        checkout: a folder in the repository that knows the times of commits; any other folder where none does.

    Raises:
        DataError: a folder holds no run, or no method has two.
    """
    found: dict[Path, StoredRun] = {}
    damaged: dict[str, str] = {}
    packed: dict[Path, Path] = {}
    for folder in folders:
        sound, faults, bundles = read_runs(folder)
        found |= {run.folder.resolve(): run for run in sound}
        damaged |= dict(faults)
        packed |= dict(bundles)
    several: dict[str, list[StoredRun]] = {}
    for run in found.values():
        several.setdefault(_title(run), []).append(run)
    faults = [*damaged.items()]
    series = [
        _series(title, readable(runs, faults), checkout=checkout) for title, runs in several.items() if len(runs) > 1
    ]
    series = [one for one in series if len(one.points) > 1]
    if not series:
        got = "one run of each" if found else "none that can be read"
        raise DataError(", ".join(map(str, folders)), expected="several runs of one method", got=got)
    return History(
        series=tuple(sorted(series, key=lambda one: one.title)),
        alone=tuple(sorted(several.keys() - {one.title for one in series})),
        damaged=tuple(sorted(faults)),
        packed=tuple(packed.items()),
    )


def _title(run: StoredRun) -> str:
    """Name of a series: another default of a method, or another state of a protocol, is a change within it."""
    manifest = run.summary.manifest
    data, method = manifest.dataset, manifest.method
    asked = [f"{name}={value}" for name, value in sorted({**method.asked, **data.input_errors}.items())]
    named = f"{method.name} ({', '.join(asked)})" if asked else method.name
    return f"{named} on {data.name}, {data.split or 'all recordings'}, {manifest.protocol.name}"


def _series(title: str, runs: Sequence[StoredRun], *, checkout: Path) -> Series:
    times = {run.folder: _time(run, checkout) for run in runs}
    parts: list[list[StoredRun]] = []
    reasons: list[str] = []
    for run in sorted(runs, key=lambda run: (times[run.folder], _is_changed(run), _started(run))):
        reason = _break(parts[-1], run) if parts else ""
        if reason or not parts:
            parts.append([])
            reasons.append(reason)
        parts[-1].append(run)
    stretches = [_stretch(part, reason, times) for part, reason in zip(parts, reasons, strict=True)]
    return Series(title=title, stretches=tuple(stretches))


def _time(run: StoredRun, checkout: Path) -> datetime:
    commit = run.summary.commit
    return (commit and commit_time(commit, checkout)) or _started(run)


def _started(run: StoredRun) -> datetime:
    started = datetime.fromisoformat(run.summary.provenance.started_utc)
    return started if started.tzinfo else started.replace(tzinfo=UTC)


def _is_changed(run: StoredRun) -> bool:
    return (run.summary.commit or "").endswith("+")


def _break(stretch: Sequence[StoredRun], run: StoredRun) -> str:
    """Why a run does not compare with those before it; "" where it does."""
    before, after = stretch[-1].summary.manifest, run.summary.manifest
    apart = [str(difference) for difference in differences(before, after) if not difference.comparable]
    if apart:
        return "; ".join(apart)
    was, now = before.dataset.recordings, after.dataset.recordings
    if any(now.get(name, was[name]) != was[name] for name in was):  # others may come and go: they are not compared
        return next(str(one) for one in differences(before, after) if one.aspect is Aspect.DATA)
    return why_apart(stretch, run)


def _stretch(runs: Sequence[StoredRun], break_before: str, times: Mapping[Path, datetime]) -> Stretch:
    group = group_of(runs)
    entries = {entry.folder: entry for entry in group.entries}
    pairs = [None, *(compare_runs(runs[place : place + 2])[0] for place in range(len(runs) - 1))]
    made = []
    for run, since in zip(runs, pairs, strict=True):
        values, commit = entries[run.folder].metrics, run.summary.commit or ""
        made.append(
            Point(
                run=run,
                metrics={name: values[name] for name in HEADLINES if name in values},
                commit=commit[:COMMIT_CHARS] + ("+" if commit.endswith("+") else ""),
                time=times[run.folder],
                since=since,
            )
        )
    return Stretch(group=group, points=tuple(made), break_before=break_before)


def history_tables(found: History) -> Iterator[Block]:
    """Values and changes of each series, for the terminal."""
    for series in found.series:
        yield Heading(series.title)
        yield from _of_series(series)
    yield Paragraph(NOTE, "dim")
    yield from _alone(found)


def _alone(found: History) -> Iterator[Block]:
    if found.alone:
        yield Paragraph(f"Of one run only, without a history: {'; '.join(found.alone)}.", "dim")


def report(found: History, *, charts: Sequence[Picture]) -> Iterator[Block]:
    """Each series with its chart, one after the other; then the runs that cannot be read.

    Args:
        found: the history.
        charts: one for each series.
    """
    yield Heading("Results over time", 1)
    yield Paragraph(NOTE)
    for series, chart in zip(found.series, charts, strict=True):
        yield Heading(series.title)
        yield chart
        yield from _of_series(series)
    yield from _alone(found)
    if found.damaged:
        yield Heading("Runs that cannot be read")
        yield Items([f"{run}: {fault}" for run, fault in found.damaged])


def _of_series(series: Series) -> Iterator[Block]:
    before: Point | None = None
    for number, stretch in enumerate(series.stretches, start=1):
        if before is not None:
            yield Paragraph(_break_line(before, stretch), "strong")
        yield _values(series, stretch, f"values-{number}")
        if len(stretch.points) > 1:
            yield _changes(series, stretch, f"changes-{number}")
        before = stretch.points[-1]


def _break_line(before: Point, stretch: Stretch) -> str:
    after = stretch.points[0]
    return (
        f"{after.name} does not compare with {before.name}, which is no change of the method: {stretch.break_before}."
    )


def _values(series: Series, stretch: Stretch, name: str) -> Table:
    group = stretch.group
    unreviewed = f"; {group.unreviewed.rstrip('.')}" if group.unreviewed else ""
    return Table(
        name=name,
        title=f"{group.images} images that all scored, reference {group.reference_digest[:12]}{unreviewed}",
        columns=["Commit", "Run", "Date", *(find_metric(metric).label for metric in series.metrics)],
        rows=[
            [point.commit or "unknown", point.run.label, f"{point.time:%Y-%m-%d}",
             *(metric_cell(point.metrics[metric]) for metric in series.metrics)]
            for point in stretch.points
        ],
        words=3,
    )  # fmt: skip


def _changes(series: Series, stretch: Stretch, name: str) -> Table:
    pairs = pairwise(stretch.points)
    return Table(
        name=name,
        title="Change since the run before, percentage points, as compare says",
        columns=["Commits", *(find_metric(metric).label for metric in series.metrics)],
        rows=[
            [f"{before.name} to {after.name}", *(_change_cell(after.change(metric)) for metric in series.metrics)]
            for before, after in pairs
        ],
    )


def _change_cell(change: Mapping[Any, Any] | None) -> Cell:
    assert change is not None, "within a stretch"
    interval = "" if change["ci95"] is None else points_interval(change["ci95"])
    verdict = Verdict(change["verdict"])
    return Cell(points(change["difference"]), tuple(filter(None, (interval, verdict.value))), _STYLES.get(verdict, ""))


WIDTH_IN, PANEL_IN, RUN_IN = 5.2, 1.15, 0.45  # of the chart, of the height of a panel, of the width of a run
LABEL_LETTERS, LEGEND_COLUMNS = 14, 3
_WIDEST_IN = 14.0
_LINES = {Verdict.BETTER: (canvas.GREEN, "-", 1.8), Verdict.WORSE: (canvas.VERMILION, "-", 1.8)}
_NOT_SHOWN = (canvas.GREY, ":", 1.0)
_LEGEND = {
    "better": _LINES[Verdict.BETTER],
    "worse": _LINES[Verdict.WORSE],
    "no difference shown": _NOT_SHOWN,
}
_DOT: dict[str, Any] = {"marker": "o", "markersize": 4, "color": canvas.BLUE}
_BREAK: dict[str, Any] = {"color": canvas.BLACK, "linewidth": 0.7, "linestyle": "--"}


@canvas.styled
def draw(series: Series) -> Figure:
    """Draw each headline over the runs, in percent with 95 % intervals; the line breaks where runs do not compare.

    A line between neighbours has the colour of what `compare` says of them.
    """
    width = min(max(WIDTH_IN, 1.5 + RUN_IN * len(series.points)), _WIDEST_IN)
    figure = canvas.new_figure(width, 1.1 + PANEL_IN * len(series.metrics), layout="constrained")
    panels = figure.subplots(len(series.metrics), 1, sharex=True, squeeze=False)[:, 0]
    for axes, metric in zip(panels, series.metrics, strict=True):
        _draw_metric(axes, series, metric)
    panels[-1].set_xticks(
        range(len(series.points)),
        [f"{point.name}\n{point.time:%Y-%m-%d}" for point in series.points],
        rotation=90 if len(series.points) > 6 else 0,
    )
    figure.suptitle(f"{series.title}\npercent, with 95 % intervals, by recording", x=0.01, ha="left", fontsize=8)
    looks = {
        name: {"color": colour, "linestyle": style, "linewidth": width}
        for name, (colour, style, width) in _LEGEND.items()
    }
    if not all(point.committed for point in series.points):
        looks["not committed"] = _DOT | {"markerfacecolor": "white", "linestyle": ""}
    if len(series.stretches) > 1:
        looks["these do not compare"] = _BREAK
    handles = [panels[0].plot([], [], label=name, **look)[0] for name, look in looks.items()]
    figure.legend(handles=handles, loc="outside lower left", ncols=LEGEND_COLUMNS, frameon=False)
    return figure


def _draw_metric(axes: Axes, series: Series, metric: str) -> None:
    place, last = 0, math.nan
    for stretch in series.stretches:
        if place:
            axes.axvline(place - 0.5, zorder=1, **_BREAK)
        for point in stretch.points:
            value, ci95 = 100 * point.metrics[metric].value, point.metrics[metric].ci95
            if ci95 is not None:
                ends = [100 * end for end in ci95]
                axes.plot([place, place], ends, color=canvas.BLUE, linewidth=1.0, alpha=0.6, zorder=2)
            change = point.change(metric)
            if change is not None:
                colour, style, width = _LINES.get(Verdict(change["verdict"]), _NOT_SHOWN)
                ends = [last, value]
                axes.plot([place - 1, place], ends, color=colour, linestyle=style, linewidth=width, zorder=2.5)
            face = canvas.BLUE if point.committed else "white"
            axes.plot([place], [value], markerfacecolor=face, zorder=3, **_DOT)
            place, last = place + 1, value
    axes.set_ylabel(textwrap.fill(find_metric(metric).label, LABEL_LETTERS))
    axes.margins(y=0.15)
    axes.set_xlim(-0.5, len(series.points) - 0.5)
    axes.grid(color=canvas.LIGHT_GREY, linewidth=0.4)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def to_csv(found: History) -> str:
    """One line per run and headline, ratios at full precision; empty where there is no number."""
    return document.to_csv(_records(found))


def _records(found: History) -> Iterator[dict[str, object]]:
    for series in found.series:
        for number, stretch in enumerate(series.stretches, start=1):
            group = stretch.group
            for point in stretch.points:
                for metric in series.metrics:
                    yield {
                        "series": series.title, "stretch": number, "break_before": stretch.break_before,
                        "protocol_digest": group.protocol_digest, "reference_digest": group.reference_digest,
                        "images_compared": group.images, "run": point.run.label, "commit": point.run.summary.commit,
                        "time_utc": point.time.isoformat(timespec="seconds"), "metric": metric,
                        **metric_record(point.metrics[metric]), **_change_record(point, metric),
                    } | annotations_field(group.unreviewed)  # fmt: skip


def _change_record(point: Point, metric: str) -> dict[str, object]:
    change = point.change(metric)
    low, high = (change and change["ci95"]) or (math.nan, math.nan)
    known = change or {}
    return {
        "before_run": point.since and point.since.before.label,
        **{name: known.get(name) for name in ("difference", "verdict", "p_holm")},
        "difference_ci95_low": low,
        "difference_ci95_high": high,
    }


def to_latex(found: History) -> str:
    r"""The tables as floats; `\label` "tab:history-<series>-values-<stretch>" and "-changes-<stretch>"."""
    return "\n".join(
        document.to_latex(
            [block for block in _of_series(series) if isinstance(block, Table)],
            label=f"history-{number}",
            about=series.title,
        )
        for number, series in enumerate(found.series, start=1)
    )


def write_history(found: History, out: Path) -> tuple[Path, ...]:
    """Write `history.html`, `.md`, `.csv`, `.tex` and a chart for each series; their paths.

    Each file appears whole or not at all.
    """
    charts = [
        Picture(f"history-{number}.png", f"Headline metrics over commits: {series.title}", _caption(series))
        for number, series in enumerate(found.series, start=1)
    ]
    blocks = list(report(found, charts=charts))
    drawn = [
        file
        for chart, series in zip(charts, found.series, strict=True)
        for file in write_picture((out / chart.address).with_suffix(""), draw(series))
    ]
    texts = write_texts(
        out,
        {
            "history.html": document.to_page("Results over time", blocks, folder=out),
            "history.md": document.to_markdown(blocks),
            "history.csv": to_csv(found),
            "history.tex": to_latex(found),
        },
    )
    return (*texts, *drawn)


def _caption(series: Series) -> str:
    """Why the line breaks, where it does."""
    pairs = pairwise(series.stretches)
    return " ".join(_break_line(before.points[-1], after) for before, after in pairs)
