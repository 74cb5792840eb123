"""Pictures of chosen images and what they show, from the masks that were scored and the reference built again."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from shapely import box

from bench.errors import BenchError
from bench.harness import FramePipeline, ProcessedFrame
from bench.harness.frames import UnscorableFrame
from bench.harness.replay import StoredFrames
from bench.reference import ReferenceObject, Status
from bench.reporting.colours import FALSE_NEGATIVE, FALSE_POSITIVE, TRUE_POSITIVE
from bench.reporting.count_view import PixelClass, draw_counts, pixel_classes
from bench.reporting.overlay import overlay_mask, overlay_polygons
from bench.reporting.page.reasons import BLIND_BAND_DEG, FrameEvidence, ObjectEvidence
from bench.reporting.page.source import PageSource
from bench.reporting.page.svg import figure_uri, jpeg_uri
from bench.reporting.page.worst import FrameKey
from bench.reporting.panels import PanelColumn, draw_panels

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
