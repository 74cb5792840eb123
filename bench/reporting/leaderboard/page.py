"""All files of a leaderboard: the page, Markdown, CSV, JSON and the chart."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

from bench.atomic import write_output
from bench.errors import BenchError
from bench.harness.stages import Progress
from bench.recordings import load_card
from bench.reporting import document
from bench.reporting.canvas import write_picture
from bench.reporting.frame import AREA_COLOURS, AREA_NAMES
from bench.reporting.leaderboard.chart import draw_quality_and_cost
from bench.reporting.leaderboard.pictures import Example, draw_examples
from bench.reporting.leaderboard.reading import RANKING_PROTOCOL, Group, Leaderboard
from bench.reporting.leaderboard.texts import NOTES, best_methods, json_group, report
from bench.reporting.page.charts import Chart, inline_svg

CHART = "quality-and-cost"
DIGITS = 5  # of the page's numbers, which it shows with fewer; leaderboard.json has all
CHART_OF_ALL = document.Picture(
    f"{CHART}.png",
    f"IoU of each method under {RANKING_PROTOCOL} against its time for an image",
    f"The time of a method against its IoU under {RANKING_PROTOCOL}; the diamond is the best method, dashed lines are "
    "what bounds all of them. The page, index.html beside this file, sorts, filters and shows two methods on an image.",
)


def write_leaderboard(
    found: Leaderboard, out: Path, *, pictures: bool = True, progress: Progress | None = None
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Write `index.html`, `leaderboard.md`, `.csv`, `.json` and the chart, each file whole or not at all.

    Args:
        found: the runs.
        out: folder, is made.
        pictures: show the same images as every run of rendered data was scored on them; needs the data sets.
        progress: called with the runs drawn and their number, for each group anew.

    Returns:
        files: the page first.
        problems: why pictures are missing, one line each.
    """
    examples: dict[str, list[Example]] = {}
    problems: list[str] = []
    for group in found.groups if pictures else ():
        if group.judged and group.dataset not in examples and _rendered(group):
            examples[group.dataset], missing = draw_examples(group, progress=progress)
            problems += missing
    charted = [
        group for group in found.groups if group.judged and any(entry.cost_ms is not None for entry in group.methods)
    ]
    page = out / "index.html"
    write_output(page, _page(found, out, charted=charted, examples=examples))
    files = (page, *report(found, charts=[CHART_OF_ALL] if charted else []).write(out, "leaderboard"))
    if charted:
        files += write_picture(out / CHART, draw_quality_and_cost(charted))
    return files, tuple(problems)


def _rendered(group: Group) -> bool:
    """True if the page may show its images: a page may be passed on, those of recorded data sets may not."""
    try:
        return load_card(group.card).scenario is not None
    except BenchError:
        return False


def _page(found: Leaderboard, out: Path, *, charted: Sequence[Group], examples: dict[str, list[Example]]) -> str:
    charts = [
        Chart(
            name=f"{CHART}-{number}",
            figure=draw_quality_and_cost([group]),
            label=f"Time of each method for an image against its IoU on {group.dataset}",
        )
        for number, group in enumerate(charted, start=1)
    ]
    groups = [json_group(group) | {"pages": _pages(group, out)} for group in found.groups]
    data = {"groups": groups, "examples": examples}
    shown = json.loads(document.to_json(data), parse_float=lambda number: round(float(number), DIGITS))
    return document.render(
        "leaderboard/board.html.j2",
        data=shown,
        charts=[inline_svg(chart) for chart in charts],
        best=list(best_methods(found)),
        damaged=found.damaged,
        linked=any(group["pages"] for group in groups),
        judged=RANKING_PROTOCOL,
        notes=NOTES,
        areas=[(colour, AREA_NAMES[kind]) for kind, colour in AREA_COLOURS.items()],
        pictures=any(examples.values()),
        style=document.packaged("page/page.css") + document.packaged("leaderboard/board.css"),
        script=document.packaged("leaderboard/board.js"),
    )


def _pages(group: Group, out: Path) -> dict[str, str]:
    """Addresses of the pages of runs inside `out`; others do not travel with the leaderboard and are no links."""
    pages = {entry.run: (entry.folder / "index.html").resolve() for entry in group.entries}
    inside = {run: page for run, page in pages.items() if page.is_relative_to(out.resolve()) and page.is_file()}
    return {run: quote(page.relative_to(out.resolve()).as_posix()) for run, page in inside.items()}
