"""A run beside another one on the same images: a few values, and pictures of both methods."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from bench.evaluation import Metric, find_metric
from bench.evaluation.definitions import OBJECT_FRAMES
from bench.harness import FramePipeline, ProcessedFrame
from bench.harness.stages import Progress
from bench.harness.stored import StoredRun
from bench.reference import Category
from bench.reporting.compare.runs import pair_on_common_images, read_comparable
from bench.reporting.document import Column, Picture, Table
from bench.reporting.formats import LABELS, headline_metrics, image_name, with_interval
from bench.reporting.frame import draw_frames, scored_layers
from bench.reporting.frame_pictures import ImageKey, draw_images, example_frames
from bench.reporting.page.charts import figure_uri
from bench.reporting.page.worst import image_key, worst_objects

Beside = tuple[Table, list[Picture], list[str]]  # both values, pictures, why pictures are missing


def beside(run: StoredRun, other: Path, *, pictures: bool, progress: Progress | None = None) -> Beside:
    """Put a run beside another one.

    Args:
        run: of the page.
        other: folder of the other run.
        pictures: draw images from the data set.
        progress: called with the images done and their number.

    Returns:
        table: both values of the headline metrics, on the images that both scored.
        pictures: in the order of the kinds of motion.
        problems: why pictures are missing, one line each.

    Raises:
        DataError: the other run is damaged.
        UsageError: they are of different data or protocols, or scored no image in common.
    """
    both = [replace(one, category=run.category) for one in read_comparable([run.folder, other])]
    one, two, common = pair_on_common_images(*both)
    chosen = _chosen(one, two) if pictures else {}
    uris, problems = draw_images((one, two), chosen, partial(_picture, (one, two)), progress=progress)
    found = [Picture(uris[key], title, title) for key, title in chosen.items() if key in uris]
    table = Table(
        title=f"Both runs, on the {common} images that both scored",
        columns=["", Column(one.label, with_interval), Column(two.label, with_interval)],
        rows=_values(one, two),
        look="metrics",
    )
    return table, found, problems


def _picture(runs: Sequence[StoredRun], key: ImageKey, frames: Sequence[ProcessedFrame], _: FramePipeline) -> str:
    sides = [scored_layers(frame, label=run.label) for run, frame in zip(runs, frames, strict=True)]
    return figure_uri(draw_frames(sides, name=image_name(*key)))


def _values(one: StoredRun, two: StoredRun) -> list[tuple[str, Metric, Metric]]:
    found = [headline_metrics(run.metrics) for run in (one, two)]
    metrics = [find_metric(name) for name in found[0]]
    shown = [metric for metric in metrics if one.category is None or metric.over == OBJECT_FRAMES]
    return [(metric.label, found[0][metric.name], found[1][metric.name]) for metric in shown]


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
    return {key: _title(key, of_image) for key, of_image in reasons.items()}


def _title(key: ImageKey, reasons: Iterable[str]) -> str:
    text = "; ".join(reasons)
    return f"{text[0].upper()}{text[1:]}: {image_name(*key)}"
