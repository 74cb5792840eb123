"""A sweep for people: the headline metrics of a run for each value of one setting, as tables and a chart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.evaluation import find_metric
from bench.harness import RunSummary
from bench.reporting import canvas
from bench.reporting.charts import Chart
from bench.reporting.document import Column, Paragraph, Report, Table
from bench.reporting.formats import INTERVALS, headline_metrics, metric_cell

STYLES = {  # colour and marker of each headline metric
    "iou": (canvas.PURPLE, "^"),
    "tpr_all": (canvas.GREEN, "s"),
    "detection_rate_50": (canvas.BLUE, "o"),
    "false_positive_coverage": (canvas.VERMILION, "D"),
}
LOG_FROM = 10.0  # ratio of the largest to the smallest value from which the axis is logarithmic
METHOD_ONLY = "Injected errors reach the method only: the reference keeps the true calibration and ego-motion."


def table(setting: str, runs: Mapping[str, RunSummary], *, title: str, note: str = "") -> Table:
    """A row a value, over all moving objects."""
    headings = [find_metric(name).label for name in headline_metrics(next(iter(runs.values())))]
    return Table(
        title=title,
        columns=[setting, "Images", "Object-frames", "Recordings", *(Column(text, metric_cell) for text in headings)],
        rows=[
            [value, *_counts(summary).values(), *headline_metrics(summary).values()] for value, summary in runs.items()
        ],
        note=note,
    )


def report(setting: str, runs: Mapping[str, RunSummary], *, title: str, note: str = "") -> Report:
    """One table over all moving objects, and how to read it; of numbers a line a value, ratios in [0, 1]."""
    about = f"IoU and TPR are averages over all object-frames that move. {INTERVALS} {note}".rstrip()
    numbers = []
    for value, summary in runs.items():
        row: dict[str, object] = {setting: value, **_counts(summary)}
        for name, metric in headline_metrics(summary).items():
            low, high = metric.ci95 or (None, None)
            row |= {name: metric.value, f"{name}.ci95_low": low, f"{name}.ci95_high": high}
        numbers.append(row)
    return Report(title=title, blocks=[Paragraph(about), table(setting, runs, title="")], numbers=numbers)


@canvas.styled
def draw(setting: str, runs: Mapping[str, RunSummary], *, title: str, note: str = "") -> Figure:
    """Draw the headline metrics of every value, in percent, with their 95 % intervals."""
    figure = canvas.new_figure(5.2, 3.4, layout="constrained")
    axes = figure.add_subplot()
    positions = place_values(axes, list(runs))
    order = np.argsort(positions, kind="stable")
    found = [headline_metrics(summary) for summary in runs.values()]
    for name in found[0]:
        colour, marker = STYLES[name]
        values = 100 * np.array([metrics[name].value for metrics in found])
        low, high = 100 * np.array([metrics[name].ci95 or (np.nan, np.nan) for metrics in found]).T
        axes.vlines(positions, low, high, color=colour, linewidth=1.0, alpha=0.6)
        axes.plot(
            np.array(positions)[order],
            values[order],
            color=colour,
            marker=marker,
            markersize=3.5,
            linewidth=1.0,
            label=find_metric(name).label,
        )
    axes.set(xlabel=setting, ylabel="percent", ylim=(-2, 102))
    axes.grid(color=canvas.LIGHT_GREY, linewidth=0.4)
    axes.set_title(f"{title}\nwith 95 % intervals, by recording", loc="left", pad=18)
    axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 0.99), ncols=4, frameon=False, handletextpad=0.3)
    figure.supxlabel(note, x=0.02, ha="left", fontsize=6, color="#555555")
    return figure


def place_values(axes: Axes, values: Sequence[str]) -> list[float]:
    """Set the axis of the values and return where each stands: by its number, or one after the other."""
    try:
        numbers = [float(value) for value in values]
    except ValueError:
        axes.set_xticks(range(len(values)), list(values), rotation=20, ha="right")
        return [float(number) for number in range(len(values))]
    if min(numbers) > 0 and max(numbers) >= LOG_FROM * min(numbers):
        axes.set_xscale("log")
    return numbers


def write_sweep(
    folder: Path, setting: str, runs: Mapping[str, RunSummary], *, title: str, note: str = ""
) -> tuple[Path, ...]:
    """Write the page `sweep.html`, `.md`, `.csv` and the chart as `.svg`; their paths.

    Args:
        folder: of the sweep.
        setting: that was changed.
        runs: by value, in the order in which they are shown.
        title: stands above table and chart.
        note: how to read them.
    """
    figure = draw(setting, runs, title=title, note=note)
    texts = report(setting, runs, title=title, note=note)
    chart = Chart(name="sweep", figure=figure, label=f"Headline metrics for each value of {setting}").drawing()
    files = replace(texts, blocks=[*texts.blocks, chart], page=True).write(folder, "sweep")
    return (*files, *canvas.write_picture(folder / "sweep", figure, formats=("svg",)))


def _counts(summary: RunSummary) -> dict[str, int]:
    moving = summary.all_moving
    images = summary.images.evaluated
    return {"images": images, "object_frames": moving.object_frames, "recordings": moving.recordings}
