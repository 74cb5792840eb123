"""The worst object-frames and images of a run as cards: a picture, the figures, and the reason.

Every sentence about a reason states the figure that it rests on. Where no rule applies, that is what is said.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from shapely import box

from bench.errors import BenchError
from bench.harness import FramePipeline, ProcessedFrame
from bench.harness.frames import UnscorableFrame
from bench.harness.replay import StoredFrames
from bench.reference import Category, ReferenceObject, Status
from bench.reporting.canvas import FALSE_NEGATIVE, FALSE_POSITIVE, TRUE_POSITIVE
from bench.reporting.count_view import PixelClass, draw_counts, pixel_classes
from bench.reporting.overlay import overlay_mask, overlay_polygons
from bench.reporting.page.charts import figure_uri, jpeg_uri
from bench.reporting.page.source import FrameKey, PageSource, frame_key, worst_frames, worst_of_categories
from bench.reporting.panels import PanelColumn, draw_panels

MOST = 0.5  # of the missed or false pixels, to be called the reason
WELL_FOUND = 0.8
FEW_POINTS = 20
SMALL_PX = 400
SAME_SPEED_MPS = 0.5
BLIND_BAND_DEG = 10.0
BELOW_HORIZON = {"preceding": "positive height", "approaching": "anti-parallel"}  # they need the road behind the object
SHOWN = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectEvidence:
    """What the image shows of an object beyond the stored counts; shares are of its missed pixels, NaN without any.

    Attributes:
        undefined: share in cells where the method could not say.
        blind_band: share within `BLIND_BAND_DEG` of the direction of travel, forward or backward.
        above_horizon: share that looks upwards.
        likelihood: median motion likelihood; NaN for a method without.
    """

    undefined: float
    blind_band: float
    above_horizon: float
    likelihood: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameEvidence:
    """What the image shows of its false positives beyond the stored counts; shares are of them, NaN without any.

    Attributes:
        below_horizon: share that looks downwards.
        static_objects: share on annotated objects that stand still.
    """

    below_horizon: float
    static_objects: float


def object_reason(row: Mapping[str, object], evidence: ObjectEvidence | None, *, threshold: float | None) -> str:
    """Say why an object-frame was covered so little.

    Args:
        row: of `OBJECTS_SCHEMA`, evaluated, with `coverage`.
        evidence: from the image; None without the data.
        threshold: of the method's likelihood; None where it has none.
    """
    if _number(row, "coverage") >= WELL_FOUND:
        return f"Nothing to explain: {_percent(_number(row, 'coverage'))} of it is found."
    found = [*(_seen_reasons(row, evidence) if evidence else []), *_stored_reasons(row)]
    told = " Also: ".join(found[:SHOWN]) or "No single reason found in the numbers."
    if evidence is None or math.isnan(evidence.likelihood) or threshold is None or evidence.undefined >= MOST:
        return told
    side = "below" if evidence.likelihood <= threshold else "above"
    told += f" On its missed pixels the median motion likelihood is {evidence.likelihood:.1e}, {side} the threshold of "
    return told + f"{threshold:.1e}."


def frame_reason(row: Mapping[str, object], evidence: FrameEvidence | None) -> str:
    """Say where the false positives of an image come from.

    Args:
        row: of `FRAMES_SCHEMA`, scored, with `coverage`.
        evidence: from the image; None without the data.
    """
    false_px = max(int(_number(row, "fp_px")), 1)
    causes = row["fp_by_cause"]
    found = []
    if isinstance(causes, Mapping) and causes:
        name, pixels = max(causes.items(), key=lambda item: item[1])
        words, share = str(name).replace("_", " "), pixels / false_px
        lead = "Mostly" if share >= MOST else "No single cause; the largest is"
        found.append(f"{lead} {words}, with {_percent(share)} of the false pixels.")
    largest = _number(row, "fp_largest_px") / false_px
    if largest >= MOST:
        found.append(f"One connected patch makes {_percent(largest)} of them.")
    attached = 1 - _number(row, "fp_unattached_px") / false_px
    if attached >= MOST:
        found.append(f"{_percent(attached)} are in patches that touch a moving object.")
    if evidence is not None and evidence.below_horizon >= MOST:
        found.append(f"{_percent(evidence.below_horizon)} lie below the horizon, on the ground and what stands on it.")
    if evidence is not None and evidence.static_objects >= MOST / 5:
        found.append(f"{_percent(evidence.static_objects)} lie on annotated objects that stand still.")
    return " ".join(found) or "No single reason found in the numbers."


def _seen_reasons(row: Mapping[str, object], evidence: ObjectEvidence) -> list[str]:
    found = []
    if evidence.undefined >= MOST:
        found.append(f"The method could not say: {_percent(evidence.undefined)} of the missed pixels are undefined.")
    constraint = BELOW_HORIZON.get(str(row["category"]))
    if constraint is not None and evidence.above_horizon >= MOST:
        found.append(
            f"{_percent(evidence.above_horizon)} of the missed pixels lie above the horizon, where {constraint}, the "
            f"constraint for {row['category']} objects, cannot work."
        )
    if evidence.blind_band >= MOST:
        found.append(
            f"Blind band: {_percent(evidence.blind_band)} of the missed pixels lie within {BLIND_BAND_DEG:.0f}° of the "
            "direction of travel, where the image hardly moves."
        )
    return found


def _stored_reasons(row: Mapping[str, object]) -> list[str]:
    found = []
    region, polygon, points = (_number(row, name) for name in ("region_px", "polygon_px", "points"))
    if region < MOST * polygon:
        found.append(f"Occluded: {_percent(1 - region / polygon)} of its outline lies behind nearer objects.")
    speed, ego = _number(row, "speed_mps"), _number(row, "ego_speed_mps")
    if row["category"] == "preceding" and abs(speed - ego) < SAME_SPEED_MPS:
        found.append(f"It drives almost as fast as the host ({speed:.1f} and {ego:.1f} m/s), so little changes to see.")
    if points < FEW_POINTS:
        found.append(f"Only {points:.0f} lidar points: the reference itself is uncertain.")
    if region < SMALL_PX:
        found.append(f"Small: {region:.0f} pixels.")
    return found


def _number(row: Mapping[str, object], name: str) -> float:
    return float(str(row[name]))


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


Progress = Callable[[float, int], None]
_PANELS_SCALE = 0.8
_CLOSE_UP_PX = 480, 360
_LEAST_STEP_M = 1e-4  # shorter ones have no direction


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameView:
    """One image of the page.

    Attributes:
        areas: what was found, missed and wrongly marked, as a `data:` address.
        panels: what the method saw.
        close_ups: by track, an evaluated object enlarged.
        objects: by track, what the image shows of it.
        evidence: of the false positives.
    """

    areas: str
    panels: str
    close_ups: dict[str, str]
    objects: dict[str, ObjectEvidence]
    evidence: FrameEvidence


def view_frames(
    source: PageSource, keys: Iterable[FrameKey], *, progress: Progress | None = None
) -> tuple[dict[FrameKey, FrameView], list[str]]:
    """Draw images as they were scored, on the data set that the run names.

    Returns:
        views: of the images that could be processed.
        problems: why the others could not, one line each, none twice.
    """
    expected = sorted(set(keys))
    try:
        stored = StoredFrames(source.folder, source.run, source.protocol)
    except BenchError as error:
        return {}, [str(error)]
    views: dict[FrameKey, FrameView] = {}
    problems: dict[str, None] = {}
    for key in expected:
        try:
            views[key] = _view(stored.process(*key), stored.pipeline(*key[:2]))
        except (BenchError, UnscorableFrame) as error:
            problems[str(error)] = None
        if progress is not None:
            progress(len(views), len(expected))
    return views, list(problems)


def _view(processed: ProcessedFrame, pipeline: FramePipeline) -> FrameView:
    reference = processed.reference
    height, width = reference.valid.shape
    detected = processed.segmentation.mask_at(width, height) & reference.valid
    column = PanelColumn(image=processed.pixels, segmentation=processed.segmentation, reference=reference)
    areas = draw_counts(processed.pixels, reference=reference, detected=detected)
    tinted = _tinted(processed, detected)
    evaluated = [(k, one) for k, one in enumerate(reference.objects) if one.status is Status.EVALUATED]
    return FrameView(
        areas=figure_uri(areas),
        panels=figure_uri(draw_panels(column), scale=_PANELS_SCALE),
        close_ups={one.track_id: _close_up(tinted, one) for _, one in evaluated},
        objects={
            one.track_id: _object_evidence(pipeline, processed, detected, region=reference.labels == k + 1)
            for k, one in evaluated
        },
        evidence=_frame_evidence(pipeline, processed, detected),
    )


def _tinted(processed: ProcessedFrame, detected: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """The image with the areas that it is scored by, at full resolution."""
    classes = pixel_classes(processed.reference, detected=detected)
    tinted = processed.pixels
    for kind, colour in (
        (PixelClass.TRUE_POSITIVE, TRUE_POSITIVE),
        (PixelClass.FALSE_NEGATIVE, FALSE_NEGATIVE),
        (PixelClass.FALSE_POSITIVE, FALSE_POSITIVE),
    ):
        tinted = overlay_mask(tinted, mask=classes == kind, colour=colour, strength=0.45)
    return tinted


def _close_up(tinted: NDArray[np.uint8], target: ReferenceObject) -> str:
    """The object with as much around it as it is large, enlarged to a fixed size."""
    assert target.polygon is not None, "an evaluated object has a polygon"
    drawn = overlay_polygons(tinted, polygons=[target.polygon], colours=["#ffffff"])
    height, width = drawn.shape[:2]
    u_min, v_min, u_max, v_max = target.polygon.intersection(box(0, 0, width - 1, height - 1)).bounds
    aspect = _CLOSE_UP_PX[0] / _CLOSE_UP_PX[1]
    half_v = min(max(v_max - v_min, (u_max - u_min) / aspect, 24.0), height / 2, width / 2 / aspect)
    half_u = half_v * aspect
    u = float(np.clip((u_min + u_max) / 2, half_u, width - half_u))
    v = float(np.clip((v_min + v_max) / 2, half_v, height - half_v))
    crop = drawn[round(v - half_v) : round(v + half_v), round(u - half_u) : round(u + half_u)]
    larger = cv2.resize(crop, _CLOSE_UP_PX, interpolation=cv2.INTER_CUBIC)
    return jpeg_uri(np.asarray(larger, dtype=np.uint8))


def _object_evidence(
    pipeline: FramePipeline, processed: ProcessedFrame, detected: NDArray[np.bool_], *, region: NDArray[np.bool_]
) -> ObjectEvidence:
    height, width = region.shape
    missed = region & ~detected
    rays_vehicle = _rays_vehicle(pipeline, missed)
    likelihood = _likelihood_of(processed, missed)
    return ObjectEvidence(
        undefined=_mean(processed.segmentation.undefined_at(width, height)[missed]),
        blind_band=_mean(_along_travel(pipeline, processed, rays_vehicle)),
        above_horizon=_mean(rays_vehicle[:, 2] > 0),
        likelihood=float(np.median(likelihood)) if likelihood.size else float("nan"),
    )


def _frame_evidence(pipeline: FramePipeline, processed: ProcessedFrame, detected: NDArray[np.bool_]) -> FrameEvidence:
    reference = processed.reference
    false = pixel_classes(reference, detected=detected) == PixelClass.FALSE_POSITIVE
    standing = np.zeros(false.shape, dtype=np.uint8)
    for one in reference.objects:
        if one.status is Status.STATIC and one.polygon is not None and not one.polygon.is_empty:
            cv2.fillPoly(standing, [np.round(np.asarray(one.polygon.exterior.coords)[:, :2]).astype(np.int32)], 1)
    return FrameEvidence(
        below_horizon=_mean(_rays_vehicle(pipeline, false)[:, 2] < 0),
        static_objects=_mean(standing[false] > 0),
    )


def _likelihood_of(processed: ProcessedFrame, area: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Motion likelihood of the pixels of an area; empty for a method without."""
    likelihood, cell = processed.segmentation.likelihood, processed.segmentation.cell_size_px
    if likelihood is None:
        return np.empty(0, dtype=np.float32)
    v, u = np.nonzero(area)
    return likelihood[v // cell, u // cell]


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
    """(N,) bool, rays within the blind band; none where the camera stands."""
    step = processed.given.current_from_previous[-1].translation_m
    if np.linalg.norm(step) < _LEAST_STEP_M:
        return np.zeros(len(rays_vehicle), dtype=bool)
    travel = pipeline.camera.vehicle_from_camera.rotation @ (step / np.linalg.norm(step))
    along: NDArray[np.bool_] = np.abs(rays_vehicle @ travel) > np.cos(np.radians(BLIND_BAND_DEG))
    return along


def _mean(flags: NDArray[np.bool_]) -> float:
    return float(flags.mean()) if flags.size else float("nan")


Row = Mapping[str, object]


@dataclass(frozen=True, slots=True, kw_only=True)
class Picked:
    """What the galleries show, worst first."""

    objects: dict[str, list[dict[str, object]]]
    frames: list[dict[str, object]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Card:
    """One card.

    Attributes:
        element: id of its element.
        key: its image.
        title: what it shows.
        facts: one line of figures.
        reason: in words.
        view: pictures; None without the data.
        track: of the object; empty for an image.
        close_up: the object enlarged; empty for an image or without the data.
    """

    element: str
    key: FrameKey
    title: str
    facts: str
    reason: str
    view: FrameView | None
    track: str
    close_up: str


def pick(source: PageSource, *, most: int) -> Picked:
    """Choose the worst: of each category, and, on a page of all, the images with most false positives."""
    categories = source.protocol.reference.categories if source.category is None else (source.category,)
    objects = worst_of_categories(source.objects, [Category(c) for c in categories], most=most)
    return Picked(objects=objects, frames=worst_frames(source.frames, most=most) if source.category is None else [])


def gallery_keys(picked: Picked) -> set[FrameKey]:
    """The images that the cards show."""
    return {frame_key(row) for rows in (*picked.objects.values(), picked.frames) for row in rows}


def object_cards(source: PageSource, picked: Picked, views: Mapping[FrameKey, FrameView]) -> dict[str, list[Card]]:
    """Cards of the worst object-frames by category."""
    threshold = source.run.method.settings.get("threshold")
    known = float(threshold) if isinstance(threshold, int | float) else None
    return {
        category: [
            _object_card(f"worst-{category}-{n}", row, views.get(frame_key(row)), known) for n, row in enumerate(rows)
        ]
        for category, rows in picked.objects.items()
    }


def frame_cards(source: PageSource, picked: Picked, views: Mapping[FrameKey, FrameView]) -> list[Card]:
    """Cards of the images with most false positives."""
    assert source.category is None or not picked.frames
    return [_frame_card(f"false-{n}", row, views.get(frame_key(row))) for n, row in enumerate(picked.frames)]


def _object_card(element: str, row: Row, view: FrameView | None, threshold: float | None) -> Card:
    track = str(row["track_id"])
    evidence = None if view is None else view.objects.get(track)
    coverage = float(str(row["coverage"]))
    return Card(
        element=element,
        key=frame_key(dict(row)),
        title=f"{100 * coverage:.0f} % found: {row['object_class']} “{track}”, {_place(row)}",
        facts=f"{row['range_m']:.1f} m away, {row['points']} lidar points, {row['region_px']} px, object "
        f"{row['speed_mps']:.1f} m/s, host {row['ego_speed_mps']:.1f} m/s",
        reason=object_reason(row, evidence, threshold=threshold),
        view=view,
        track=track,
        close_up="" if view is None else view.close_ups.get(track, ""),
    )


def _frame_card(element: str, row: Row, view: FrameView | None) -> Card:
    coverage = float(str(row["coverage"]))
    evidence = None if view is None else view.evidence
    return Card(
        element=element,
        key=frame_key(dict(row)),
        title=f"{100 * coverage:.0f} % of the image wrongly marked: {_place(row)}",
        facts=f"{row['fp_components']} false patches, the largest {row['fp_largest_px']} px, host "
        f"{row['ego_speed_mps']:.1f} m/s",
        reason=frame_reason(row, evidence),
        view=view,
        track="",
        close_up="",
    )


def _place(row: Row) -> str:
    return f"{row['recording']}, camera {row['camera']}, {int(str(row['timestamp_ns'])) / 1e9:.2f} s"
