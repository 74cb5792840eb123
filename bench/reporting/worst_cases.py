"""The worst object-frames and images of a run: which they are, what was measured of each, and their pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray
from shapely import get_coordinates, get_parts

from bench.evaluation import FRAMES_SCHEMA, OBJECTS_SCHEMA, Rows
from bench.evaluation.definitions import coverage, false_share
from bench.evaluation.rows import EVALUATED, IMAGE, OBJECT, pick, read_parts, sort_rows
from bench.harness import FramePipeline, ProcessedFrame
from bench.harness.stages import Progress
from bench.harness.stored import StoredRun
from bench.reference import Category, Status
from bench.reporting.charts import figure_uri
from bench.reporting.document import Cell, Paragraph, Table
from bench.reporting.formats import LABELS, frame_name, image_name
from bench.reporting.frame import (
    PixelClass,
    detected_pixels,
    draw_close_up,
    draw_frames,
    pixel_classes,
    scored_layers,
)
from bench.reporting.frame_pictures import ImageKey, draw_images, draw_panels

Row = Mapping[str, Any]  # of a stored table, with `coverage`
Rank = Callable[[pd.DataFrame], pd.DataFrame]
APART_NS = 1_000_000_000


def worst_objects(objects: Rows, categories: Sequence[Category], *, most: int) -> dict[str, list[Row]]:
    """Evaluated object-frames with the lowest coverage, by category, as rows of `OBJECTS_SCHEMA` plus `coverage`.

    Of each track only the worst, then, while there is room, the worst of its other seconds; of equals the largest.
    """

    def rank(rows: pd.DataFrame) -> pd.DataFrame:
        measured = rows.assign(coverage=coverage)
        return measured.sort_values(["coverage", "region_px"], ascending=[True, False], kind="stable")

    found = _worst(objects, OBJECTS_SCHEMA, rank, key=OBJECT, each=["category"], of=[*IMAGE[:2], "track_id"], most=most)
    return {category.value: [row for row in found if row["category"] == category] for category in categories}


def worst_frames(frames: Rows, *, most: int) -> list[Row]:
    """Scored images with the largest false-positive coverage, as rows of `FRAMES_SCHEMA` plus `coverage`.

    Without the histograms. Of each recording and camera only the worst, then, while there is room, the worst of its
    other seconds.
    """

    def rank(rows: pd.DataFrame) -> pd.DataFrame:
        marked = rows[rows["fp_px"] > 0].assign(coverage=false_share)
        return marked.sort_values("coverage", ascending=False, kind="stable")

    return _worst(frames, FRAMES_SCHEMA, rank, key=IMAGE, each=["status"], of=IMAGE[:2], most=most)


def image_key(row: Row) -> ImageKey:
    """The image of a row."""
    return row["recording"], row["camera"], row["timestamp_ns"]


def _worst(
    source: Rows, schema: pa.Schema, rank: Rank, *, key: Sequence[str], each: list[str], of: Sequence[str], most: int
) -> list[Row]:
    """The first of the ranked rows of `each` kind; of what `of` names one a second, the first of all before others."""
    flat = [field.name for field in schema if not pa.types.is_list(field.type)]
    scored = (part[part["status"] == EVALUATED] for part in read_parts(source, flat))

    def first(rows: pd.DataFrame) -> pd.DataFrame:
        seconds = rank(rows).assign(second=rows["timestamp_ns"] // APART_NS)
        apart = seconds.drop_duplicates([*each, *of, "second"])
        again = apart.duplicated([*each, *of])
        return pd.concat([apart[~again], apart[again]]).groupby(each).head(most).sort_index()

    chosen = rank(pick((sort_rows(part, key) for part in scored), first)).drop(columns="second")
    return [{str(name): value for name, value in row.items()} for row in chosen.to_dict("records")]


BLIND_BAND_DEG = 10.0
OBJECT_NOTE = (
    "Hidden: share of the outline that lies behind nearer objects. Of the pixels that were missed: undefined, where "
    f"the method could not say; near travel, within {BLIND_BAND_DEG:.0f}° of the direction of travel, where the image "
    "hardly moves; above horizon, where constraints that compare with the road cannot work; likelihood, the median "
    "motion likelihood beside the threshold."
)
IMAGE_NOTE = (
    "Of the falsely marked pixels: largest, those in the largest connected patch; at objects, in patches that touch a "
    "moving object; cause, the most frequent; below horizon, on the ground or what is on it; on stationary, on "
    "annotated objects that are stationary."
)


OF_OBJECT = ("undefined", "near travel", "above horizon", "likelihood")  # facts that only the image shows
OF_IMAGE = ("below horizon", "on stationary")


def object_facts(row: Row, seen: Mapping[str, str]) -> dict[str, str]:
    """Return what was measured of an object-frame, by heading; "" where nothing is known.

    Args:
        row: of `OBJECTS_SCHEMA`, evaluated, with `coverage`.
        seen: facts `OF_OBJECT`; none without the data.
    """
    facts = {
        "found": _percent(row["coverage"]),
        "range": f"{row['range_m']:.1f} m",
        "lidar points": f"{row['points']:.0f}",
        "size": f"{row['region_px']:.0f} px",
        "hidden": _percent(1 - row["region_px"] / row["polygon_px"]),
        "speed": f"{row['speed_mps']:.1f} m/s",
        "ego vehicle": f"{row['ego_speed_mps']:.1f} m/s",
    }
    return facts | {heading: seen.get(heading, "") for heading in OF_OBJECT}


def image_facts(row: Row, seen: Mapping[str, str]) -> dict[str, str]:
    """Return what was measured of the false positives of an image, by heading, in the same way.

    Args:
        row: of `FRAMES_SCHEMA`, scored, with `coverage`.
        seen: facts `OF_IMAGE`; none without the data.
    """
    false_px = max(row["fp_px"], 1)
    causes = row["fp_by_cause"] if isinstance(row["fp_by_cause"], Mapping) else {}
    cause, pixels = max(causes.items(), key=lambda item: item[1], default=("", 0))
    facts = {
        "wrongly marked": _percent(row["coverage"]),
        "patches": f"{row['fp_components']}",
        "largest": _percent(row["fp_largest_px"] / false_px),
        "at objects": _percent(1 - row["fp_unattached_px"] / false_px),
        "cause": f"{cause.replace('_', ' ')} {_percent(pixels / false_px)}" if cause else "",
        "ego vehicle": f"{row['ego_speed_mps']:.1f} m/s",
    }
    return facts | {heading: seen.get(heading, "") for heading in OF_IMAGE}


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


_PANELS_SCALE = 0.8
_LEAST_STEP_M = 1e-4  # shorter ones have no direction


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameView:
    """One image of the page.

    Attributes:
        areas: what was found, missed and wrongly marked, as a `data:` address.
        panels: what the method saw.
        close_ups: by track, an evaluated object enlarged.
        facts: by track, those of an evaluated object that only the image shows; None for those of the false positives.
    """

    areas: str
    panels: str
    close_ups: dict[str, str]
    facts: dict[str | None, dict[str, str]]


def _view(processed: ProcessedFrame, pipeline: FramePipeline) -> FrameView:
    reference, name = processed.reference, frame_name(processed.reference)
    layers = scored_layers(processed)
    evaluated = {k: target for k, target in enumerate(reference.objects, 1) if target.status is Status.EVALUATED}
    facts: dict[str | None, dict[str, str]] = {None: _facts_of_false(pipeline, processed)}
    for k, target in evaluated.items():
        missed = (reference.labels == k) & ~detected_pixels(processed)
        facts[target.track_id] = facts_of_missed(pipeline, processed, missed=missed)
    return FrameView(
        areas=figure_uri(draw_frames([layers], name=name)),
        panels=figure_uri(draw_panels(processed), scale=_PANELS_SCALE),
        close_ups={
            target.track_id: figure_uri(draw_close_up(layers, target, name=name)) for target in evaluated.values()
        },
        facts=facts,
    )


def facts_of_missed(pipeline: FramePipeline, processed: ProcessedFrame, *, missed: NDArray[np.bool_]) -> dict[str, str]:
    """Facts `OF_OBJECT` of the pixels of an object that were missed, (H, W) bool; "" without any."""
    segmentation, (height, width) = processed.segmentation, missed.shape
    rays_vehicle = _rays_vehicle(pipeline, missed)
    shares = [
        segmentation.undefined_at(width, height)[missed],
        _along_travel(pipeline, processed, rays_vehicle),
        rays_vehicle[:, 2] > 0,
    ]
    facts = dict(zip(OF_OBJECT, map(_share, shares), strict=False))
    if segmentation.likelihood is not None and segmentation.threshold is not None and missed.any():
        v, u = (axis // segmentation.cell_size_px for axis in np.nonzero(missed))
        facts["likelihood"] = f"{np.median(segmentation.likelihood[v, u]):.2g} ({segmentation.threshold:.2g})"
    return facts


def _facts_of_false(pipeline: FramePipeline, processed: ProcessedFrame) -> dict[str, str]:
    reference = processed.reference
    false = pixel_classes(reference, detected=detected_pixels(processed)) == PixelClass.FALSE_POSITIVE
    stationary = np.zeros(false.shape, dtype=np.uint8)
    for one in reference.objects:
        if one.status is Status.STATIC and one.polygon is not None and not one.polygon.is_empty:
            outlines = [np.round(get_coordinates(part.exterior)).astype(np.int32) for part in get_parts(one.polygon)]
            cv2.fillPoly(stationary, outlines, 1)
    shares = _rays_vehicle(pipeline, false)[:, 2] < 0, stationary[false] > 0
    return dict(zip(OF_IMAGE, map(_share, shares), strict=True))


def _rays_vehicle(pipeline: FramePipeline, area: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(N, 3) unit rays of the pixels of an area, in the axes of the vehicle."""
    v, u = np.nonzero(area)
    rays_camera, _ = pipeline.camera.model.unproject(np.column_stack([u, v]).astype(np.float64))
    rays: NDArray[np.float64] = rays_camera @ pipeline.camera.vehicle_from_camera.rotation.T
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return rays


def _along_travel(
    pipeline: FramePipeline, processed: ProcessedFrame, rays_vehicle: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(N,) bool, rays within the blind band; none where the camera is stationary."""
    step = processed.given.current_from_previous[-1].translation_m
    if np.linalg.norm(step) < _LEAST_STEP_M:
        return np.zeros(len(rays_vehicle), dtype=bool)
    travel = pipeline.camera.vehicle_from_camera.rotation @ (step / np.linalg.norm(step))
    along: NDArray[np.bool_] = np.abs(rays_vehicle @ travel) > np.cos(np.radians(BLIND_BAND_DEG))
    return along


def _share(flags: NDArray[np.bool_]) -> str:
    """Share of true flags; "" without any flag."""
    return _percent(float(flags.mean())) if flags.size else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Card:
    """One object-frame or image.

    Attributes:
        element: id of its element.
        key: its image.
        title: what it shows.
        facts: what was measured, by heading.
        view: pictures; None without the data.
        track: of the object; None for an image.
    """

    element: str
    key: ImageKey
    title: str
    facts: Mapping[str, str]
    view: FrameView | None
    track: str | None = None

    @property
    def facts_line(self) -> str:
        """The facts as a line."""
        return ", ".join(f"{heading} {text}" for heading, text in self.facts.items() if text)


Gallery = tuple[str, Table | Paragraph, list[Card]]  # kind of motion or of images, table of the cards, the worst first


def gallery(title: str, of: str, cards: list[Card]) -> Gallery:
    """The cards as rows that lead to them; columns that nothing is known of are left out.

    Args:
        title: names the kind.
        of: "object" or "image".
        cards: the worst first.
    """
    if not cards:
        none = {"object": "No object-frame of this kind was evaluated.", "image": "No image has false marks."}
        return title, Paragraph(none[of], "bad"), cards
    headings = [heading for heading in cards[0].facts if any(card.facts[heading] for card in cards)]
    rows = [[Cell(card.title, link=f"#{card.element}"), *map(card.facts.get, headings)] for card in cards]
    return title, Table(title=f"{title}, the worst first", columns=[of, *headings], rows=rows), cards


def worst_cases(
    run: StoredRun, *, most: int, pictures: bool, progress: Progress | None = None
) -> tuple[list[Gallery], list[str]]:
    """Choose the worst of each category and, on a page of all, of the images; draw and measure them.

    Args:
        run: the run, or one kind of motion of it.
        most: cards of a category, and of images.
        pictures: process the images once more.
        progress: called with the images done and their number.

    Returns:
        galleries: one for each category, then that of the images.
        problems: why pictures are missing, one line each.
    """
    names = run.protocol.reference.categories if run.category is None else (run.category,)
    objects = worst_objects(run.objects, [Category(name) for name in names], most=most)
    images = worst_frames(run.frames, most=most) if run.category is None else []
    keys = {image_key(row) for rows in (*objects.values(), images) for row in rows} if pictures else set()
    views, problems = draw_images([run], keys, lambda _, frames, of: _view(frames[0], of), progress=progress)
    galleries = [
        gallery(LABELS[name], "object", [_card(f"worst-{name}-{n}", row, views) for n, row in enumerate(rows)])
        for name, rows in objects.items()
    ]
    if run.category is None:
        cards = [_card(f"false-{n}", row, views) for n, row in enumerate(images)]
        galleries.append(gallery("Most false marks", "image", cards))
    return galleries, problems


def _card(element: str, row: Row, views: Mapping[ImageKey, FrameView]) -> Card:
    key, track = image_key(row), row.get("track_id")
    view, name = views.get(key), image_name(*key)
    seen = view.facts.get(track, {}) if view else {}
    facts = image_facts(row, seen) if track is None else object_facts(row, seen)
    title = name if track is None else f"{row['object_class']} “{track}”, {name}"
    return Card(element=element, key=key, title=title, facts=facts, view=view, track=track)
