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
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.errors import DataError
from bench.evaluation import Metric, find_metric
from bench.harness.code_state import commit_time
from bench.harness.digests import short_digest
from bench.harness.manifest import Aspect, differences
from bench.harness.stored import StoredRun
from bench.reporting import canvas, document
from bench.reporting.compare.changes import HEADLINES, RunComparison, Shown, changes_over_everything, compare_runs
from bench.reporting.compare.runs import why_apart
from bench.reporting.document import Block, Cell, Column, Heading, Items, Paragraph, Picture, Report, Style, Table
from bench.reporting.formats import (
    INTERVALS,
    annotations_field,
    metric_cell,
    metric_record,
    points,
    points_interval,
)
from bench.reporting.leaderboard.reading import Group, group_of, read_runs, readable

NOTE = (
    "In percent, over all moving object-frames and, of false positives, over all images that the runs of a table "
    f"scored. {INTERVALS} A change is what compare says of a run and the one before it, in pairs, by recording, on "
    "the images that both scored: overlapping intervals do not say that two runs are equal. Each pair is judged by "
    "itself: of very many steps without any effect a few are called a change. In the order of the commits' times where "
    "the current folder's repository has them, else of the runs' own; + is code that was not committed."
)
COMMIT_CHARS = 8
_STYLES: dict[Shown, Style] = {Shown.BETTER: "good", Shown.WORSE: "bad"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Point:
    """A run of a series.

    Attributes:
        run: as it is stored.
        stretch: number of the neighbouring runs that compare, from 1.
        break_before: why its stretch does not compare with the one before; "" in the first.
        group: its stretch as the leaderboard has it, on the images that all of it scored.
        metrics: the headlines, by name, of these images.
        commit: of the method's code, short, "+" behind it where files were changed; "" where it is unknown.
        time: of the commit; of the run where no repository has the commit.
        since: against the run before it; None of the first of a stretch.
    """

    run: StoredRun
    stretch: int
    break_before: str
    group: Group
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

    def change(self, metric: str) -> Mapping[Any, Any]:
        """The row of `metric_changes` of a headline since the run before; empty where there is none."""
        return {} if self.since is None else changes_over_everything(self.since).loc[metric].to_dict()


Series = Sequence[Point]  # of a method as it was asked for, on one data set, by one protocol, in order


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class History:
    """Series of several runs.

    Attributes:
        series: by method, settings, data set, split and protocol, in words.
        alone: what has one run only, and so no history, in such words.
        damaged: folder and fault of every run that cannot be read.
        packed: runs in one file, which are left out, with the folder to unpack each into.
    """

    series: Mapping[str, Series]
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
    runs = {title: readable(some, faults) if len(some) > 1 else some for title, some in sorted(several.items())}
    series = {title: _series(some, checkout=checkout) for title, some in runs.items() if len(some) > 1}
    if not series:
        got = "one run of each" if found else "none that can be read"
        raise DataError(", ".join(map(str, folders)), expected="several runs of one method", got=got)
    return History(
        series=series,
        alone=tuple(title for title in runs if title not in series),
        damaged=tuple(sorted(faults)),
        packed=tuple(packed.items()),
    )


def _title(run: StoredRun) -> str:
    """Name of a series: another default of a method, or another state of a protocol, is a change within it."""
    manifest = run.manifest
    data, method = manifest.dataset, manifest.method
    asked = [f"{name}={value}" for name, value in sorted({**method.asked, **data.input_errors}.items())]
    named = f"{method.name} ({', '.join(asked)})" if asked else method.name
    return f"{named} on {data.name}, {data.split or 'all recordings'}, {manifest.protocol.name}"


def _series(runs: Sequence[StoredRun], *, checkout: Path) -> Series:
    times = {run.folder: _time(run, checkout) for run in runs}
    stretches: list[list[StoredRun]] = []
    reasons: list[str] = []
    for run in sorted(runs, key=lambda run: (times[run.folder], _is_changed(run), _started(run))):
        reason = _break(stretches[-1], run) if stretches else ""
        if reason or not stretches:
            stretches.append([])
            reasons.append(reason)
        stretches[-1].append(run)
    points: list[Point] = []
    for number, (stretch, reason) in enumerate(zip(stretches, reasons, strict=True), start=1):
        group = group_of(stretch)
        entries = {entry.folder: entry for entry in group.entries}
        pairs = [None, *(compare_runs(pair)[0] for pair in pairwise(stretch))]
        for run, since in zip(stretch, pairs, strict=True):
            values, commit = entries[run.folder].metrics, run.commit or ""
            points.append(
                Point(
                    run=run,
                    stretch=number,
                    break_before=reason,
                    group=group,
                    metrics={name: values[name] for name in HEADLINES if name in values},
                    commit=commit[:COMMIT_CHARS] + ("+" if commit.endswith("+") else ""),
                    time=times[run.folder],
                    since=since,
                )
            )
    return points


def _time(run: StoredRun, checkout: Path) -> datetime:
    commit = run.commit
    return (commit and commit_time(commit, checkout)) or _started(run)


def _started(run: StoredRun) -> datetime:
    started = datetime.fromisoformat(run.summary.provenance.started_utc)
    return started if started.tzinfo else started.replace(tzinfo=UTC)


def _is_changed(run: StoredRun) -> bool:
    return (run.commit or "").endswith("+")


def _break(stretch: Sequence[StoredRun], run: StoredRun) -> str:
    """Reason that a run does not compare with those before it; "" where it does."""
    before, after = stretch[-1].manifest, run.manifest
    apart = [str(difference) for difference in differences(before, after) if not difference.comparable]
    if apart:
        return "; ".join(apart)
    was, now = before.dataset.recordings, after.dataset.recordings
    if any(now.get(name, was[name]) != was[name] for name in was):  # others may come and go: they are not compared
        return next(str(one) for one in differences(before, after) if one.aspect is Aspect.DATA)
    return why_apart(stretch, run)


def _shown(series: Series) -> dict[str, str]:
    """Names and headings of the headlines that all runs have."""
    return {name: label for name, label in HEADLINES.items() if all(name in point.metrics for point in series)}


def _stretches(series: Series) -> Iterator[list[Point]]:
    return (list(points) for _, points in groupby(series, key=lambda point: point.stretch))


def history_tables(found: History) -> Iterator[Block]:
    """Values and changes of each series, for the terminal."""
    for title, series in found.series.items():
        yield from (Heading(title), *_blocks(series))
    yield Paragraph(NOTE, "dim")
    yield from _alone(found)


def _alone(found: History) -> Iterator[Block]:
    if found.alone:
        yield Paragraph(f"Of one run only, without a history: {'; '.join(found.alone)}.", "dim")


def _blocks(series: Series) -> Iterator[Block]:
    """Two tables for each stretch; between stretches, why they do not compare."""
    shown, breaks = _shown(series), ["", *_breaks(series)]
    for stretch, line in zip(_stretches(series), breaks, strict=True):
        if line:
            yield Paragraph(line, "strong")
        group, number = stretch[0].group, stretch[0].stretch
        unreviewed = f"; {group.unreviewed.rstrip('.')}" if group.unreviewed else ""
        yield Table(
            name=f"values-{number}",
            title=(
                f"{group.images} images that all scored, reference {short_digest(group.reference_digest)}{unreviewed}"
            ),
            columns=["Commit", "Run", "Date", *(Column(label, metric_cell) for label in shown.values())],
            rows=[
                [one.commit or "unknown", one.run.label, f"{one.time:%Y-%m-%d}", *map(one.metrics.get, shown)]
                for one in stretch
            ],
            words=3,
        )
        if len(stretch) > 1:
            yield Table(
                name=f"changes-{number}",
                title="Change since the run before, percentage points, as compare says",
                columns=["Commits", *(Column(label, _change_cell) for label in shown.values())],
                rows=[[f"{one.name} to {other.name}", *map(other.change, shown)] for one, other in pairwise(stretch)],
            )


def _breaks(series: Series) -> list[str]:
    """A line for every two neighbouring stretches."""
    return [
        f"{after.name} does not compare with {before.name}, which is no change of the method: {after.break_before}."
        for before, after in pairwise(series)
        if before.stretch != after.stretch
    ]


def _change_cell(change: Mapping[Any, Any]) -> Cell:
    interval = "" if change["ci95"] is None else points_interval(change["ci95"])
    shown = Shown(change["verdict"])
    return Cell(points(change["difference"]), tuple(filter(None, (interval, shown.value))), _STYLES.get(shown, ""))


WIDTH_IN, PANEL_IN, RUN_IN = 5.2, 1.15, 0.45  # of the chart, of the height of a panel, of the width of a run
LABEL_LETTERS, LEGEND_COLUMNS, LETTERS_PER_IN = 14, 3, 17  # of an axis, of the legend, of the title
_WIDEST_IN = 14.0
_LINES = {Shown.BETTER: (canvas.GREEN, "-", 1.8), Shown.WORSE: (canvas.VERMILION, "-", 1.8)}
_NOT_SHOWN = (canvas.GREY, ":", 1.0)
_LEGEND = {
    "better": _LINES[Shown.BETTER],
    "worse": _LINES[Shown.WORSE],
    "no difference shown": _NOT_SHOWN,
}
_DOT: dict[str, Any] = {"marker": "o", "markersize": 4, "color": canvas.BLUE}
_BREAK: dict[str, Any] = {"color": canvas.BLACK, "linewidth": 0.7, "linestyle": "--"}


@canvas.styled
def draw(title: str, series: Series) -> Figure:
    """Draw each headline over the runs, in percent with 95 % intervals; the line breaks where runs do not compare.

    A line between neighbours has the colour of what `compare` says of them.
    """
    width, shown = min(max(WIDTH_IN, 1.5 + RUN_IN * len(series)), _WIDEST_IN), _shown(series)
    figure = canvas.new_figure(width, 1.1 + PANEL_IN * len(shown), layout="constrained")
    panels = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    for axes, metric in zip(panels, shown, strict=True):
        _draw_metric(axes, series, metric)
    panels[-1].set_xticks(
        range(len(series)),
        [f"{point.name}\n{point.time:%Y-%m-%d}" for point in series],
        rotation=90 if len(series) > 6 else 0,
    )
    title = textwrap.fill(title, round(LETTERS_PER_IN * width), break_on_hyphens=False)
    figure.suptitle(f"{title}\npercent, with 95 % intervals, by recording", x=0.01, ha="left", fontsize=8)
    looks = {
        name: {"color": colour, "linestyle": style, "linewidth": width}
        for name, (colour, style, width) in _LEGEND.items()
    }
    if not all(point.committed for point in series):
        looks["not committed"] = _DOT | {"markerfacecolor": "white", "linestyle": ""}
    if series[-1].stretch > 1:
        looks["these do not compare"] = _BREAK
    handles = [panels[0].plot([], [], label=name, **look)[0] for name, look in looks.items()]
    figure.legend(handles=handles, loc="outside lower left", ncols=LEGEND_COLUMNS, frameon=False)
    return figure


def _draw_metric(axes: Axes, series: Series, metric: str) -> None:
    last = math.nan
    for place, point in enumerate(series):
        if place and point.stretch != series[place - 1].stretch:
            axes.axvline(place - 0.5, zorder=1, **_BREAK)
        value, ci95 = 100 * point.metrics[metric].value, point.metrics[metric].ci95
        if ci95 is not None:
            ends = [100 * end for end in ci95]
            axes.plot([place, place], ends, color=canvas.BLUE, linewidth=1.0, alpha=0.6, zorder=2)
        if change := point.change(metric):
            colour, style, width = _LINES.get(Shown(change["verdict"]), _NOT_SHOWN)
            axes.plot([place - 1, place], [last, value], color=colour, linestyle=style, linewidth=width, zorder=2.5)
        face = canvas.BLUE if point.committed else "white"
        axes.plot([place], [value], markerfacecolor=face, zorder=3, **_DOT)
        last = value
    axes.set_ylabel(textwrap.fill(find_metric(metric).label, LABEL_LETTERS))
    axes.margins(y=0.15)
    axes.set_xlim(-0.5, len(series) - 0.5)
    axes.grid(color=canvas.LIGHT_GREY, linewidth=0.4)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def report(found: History) -> Report:
    r"""Each series with its chart, one after the other; then the runs that cannot be read.

    A line of numbers per run and headline, ratios in [0, 1]. The tables as floats have the `\label`s
    "tab:history-<series>-values-<stretch>" and "-changes-<stretch>".
    """
    blocks: list[Block] = [Paragraph(NOTE)]
    latex = []
    for number, (title, series) in enumerate(found.series.items(), start=1):
        text = f"Headline metrics over commits: {title}"
        own = [*_blocks(series)]
        blocks += [Heading(title), Picture(f"history-{number}.png", text, " ".join(_breaks(series))), *own]
        tables = [block for block in own if isinstance(block, Table)]
        latex.append(document.to_latex(tables, label=f"history-{number}", about=title))
    blocks += _alone(found)
    if found.damaged:
        blocks += [Heading("Runs that cannot be read"), Items([f"{run}: {fault}" for run, fault in found.damaged])]
    return Report(title="Results over time", blocks=blocks, numbers=_records(found), latex="\n".join(latex), page=True)


def _records(found: History) -> Iterator[dict[str, object]]:
    for title, series in found.series.items():
        for point in series:
            group = point.group
            of_run = {
                "series": title, "stretch": point.stretch, "break_before": point.break_before,
                "protocol_digest": group.protocol_digest, "reference_digest": group.reference_digest,
                "images_compared": group.images, "run": point.run.label, "commit": point.run.commit,
                "time_utc": point.time.isoformat(timespec="seconds"),
            }  # fmt: skip
            for metric in _shown(series):
                change = point.change(metric)
                low, high = change.get("ci95") or (None, None)
                yield of_run | {"metric": metric, **metric_record(point.metrics[metric])} | {
                    "before_run": point.since and point.since.before.label,
                    **{name: change.get(name) for name in ("difference", "verdict", "p_holm")},
                    "difference_ci95_low": low, "difference_ci95_high": high,
                } | annotations_field(group.unreviewed)  # fmt: skip


def write_history(found: History, out: Path) -> tuple[Path, ...]:
    """Write `history.html`, `.md`, `.csv`, `.tex` and a chart for each series; their paths."""
    drawn = [
        canvas.write_picture(out / f"history-{number}", draw(title, series))
        for number, (title, series) in enumerate(found.series.items(), start=1)
    ]
    return (*report(found).write(out, "history"), *(file for pair in drawn for file in pair))
