"""Scores of many predictions against every reference: sums over a recording's object-frames, in one pass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.audit.predictions import CameraPredictions, Prediction
from bench.audit.sources import AuditSource, instance_ids, refuse_without_masks, same_objects
from bench.errors import BenchError
from bench.evaluation import count_frame, load_protocol
from bench.evaluation.sums import name_bins
from bench.harness.frames import UnscorableFrame
from bench.harness.provenance import recording_digest
from bench.harness.stages import StageClock
from bench.recordings import Recording, read_truth
from bench.reference import Category, ReferenceBuilder, ReferenceFrame, ReferenceSettings, Status

FALSE_POSITIVES, ALL_MOVING = "false_positives", "all_moving"
CATEGORIES = tuple(category.value for category in Category if category is not Category.MOVING)
ROWS = (*CATEGORIES, ALL_MOVING, FALSE_POSITIVES)

PAPER, SURFACE, EXACT = "paper-v1", "surface-v1", "exact"
BINS = load_protocol(SURFACE).bins
REFERENCES = (PAPER, "concave", "surface-patches", SURFACE, EXACT)  # the exact masks last

# Accumulators, and metrics as ratios of two of them: those of `bench.evaluation.definitions`.
SUMS = ("every", "iou", "detected", "coverage_detected", "detected_50", "share")
METRICS = {
    "iou": ("iou", "every"),
    "tpr": ("coverage_detected", "detected"),
    "detection_rate_50": ("detected_50", "every"),
    "false_positive_share": ("share", "every"),
}
# How far the regions of `surface-v1` are right, of the object-frames of a class, bin of ranges and bin of ego speeds.
FITS = ("object_frames", "core_px", "core_outside_px", "mask_px", "left_out_px", "unknown_share")
OBJECT_METRICS = ("iou", "tpr", "detection_rate_50")
FRAME_METRICS = ("false_positive_share",)


def _bin(value: float, edges: Sequence[float]) -> str:
    """The name of a value's bin; "nan" where it is unknown."""
    return str(name_bins(pd.Series([value]), edges)[0])


def lidar_references() -> dict[str, ReferenceSettings]:
    """The lidar references by name, all of `REFERENCES` but the last.

    The convex hulls of `paper-v1`, concave hulls by the same rules, the surface patches from which `surface-v1` makes
    its regions, all of whose pixels count, and these regions.
    """
    paper, surface = (load_protocol(name).reference_settings() for name in (PAPER, SURFACE))
    settings = (paper, replace(paper, polygon_kind="concave"), replace(surface, outline=None), surface)
    return dict(zip(REFERENCES[:-1], settings, strict=True))


@dataclass(kw_only=True, eq=False)
class RankingSums:
    """Sums of a recording; its size does not depend on the recording's.

    Attributes:
        sums: (rows, references, predictions, accumulators) float64, of `ROWS`, `REFERENCES` and `SUMS`. Accumulators
            of object-frames are 0 in the row of false positives, `share` in all others.
        unknown: (rows,) float64, share of the possible pixels that `surface-v1` leaves unknown, summed over
            object-frames.
        fits: by class, range and ego speed, (len(FITS),) float64 each.
        images: that were scored.
        digest: of the recording.
        problems: one line per image that could not be used.
        seconds: time of each stage.
    """

    sums: NDArray[np.float64]
    unknown: NDArray[np.float64]
    fits: dict[tuple[str, str, str], NDArray[np.float64]] = field(default_factory=dict)
    images: int = 0
    digest: str = ""
    problems: list[str] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)

    @classmethod
    def empty(cls, predictions: int) -> RankingSums:
        """Of nothing."""
        return cls(sums=np.zeros((len(ROWS), len(REFERENCES), predictions, len(SUMS))), unknown=np.zeros(len(ROWS)))

    def add(
        self, references: Sequence[ReferenceFrame], masks: Sequence[NDArray[np.bool_]], *, component_size_px: int
    ) -> None:
        """Score the masks of an image.

        Args:
            references: of the same objects, in the order of `REFERENCES`.
            masks: (H, W) bool, one per prediction.
            component_size_px: as in the protocol; of no effect on these sums.
        """
        for number, reference in enumerate(references):
            for which, mask in enumerate(masks):
                self._add_mask(self.sums[:, number, which], reference, mask, component_size_px)
        surface, exact = references[REFERENCES.index(SURFACE)], references[REFERENCES.index(EXACT)]
        speed = _bin(surface.ego_speed_mps, BINS.ego_speed_mps)
        for number, item in enumerate(surface.objects, start=1):
            if item.status is Status.EVALUATED:
                unknown = item.unknown_px / (item.region_px + item.unknown_px)
                self.unknown[_rows_of(item.category)] += unknown
                away = _bin(item.range_m, BINS.range_m)
                fit = self.fits.setdefault((item.object_class, away, speed), np.zeros(len(FITS)))
                fit += _fit(surface.labels == number, exact.labels == number, surface.ignored, unknown)
        self.images += 1

    def _add_mask(
        self, sums: NDArray[np.float64], reference: ReferenceFrame, mask: NDArray[np.bool_], component_size_px: int
    ) -> None:
        frame, objects = count_frame(reference, mask, component_size_px=component_size_px)
        sums[ROWS.index(FALSE_POSITIVES)] += _of_frame(frame.fp_px / (frame.width * frame.height))
        for item, counts in zip(reference.objects, objects, strict=True):
            if item.status is Status.EVALUATED:
                sums[_rows_of(item.category)] += _of_object(counts.tp, counts.fp, counts.fn)


def _rows_of(category: Category | None) -> list[int]:
    assert category is not None, "what is evaluated has a category"
    return [ROWS.index(category.value), ROWS.index(ALL_MOVING)]


def _fit(
    core: NDArray[np.bool_], mask: NDArray[np.bool_], ignored: NDArray[np.bool_], unknown_share: float
) -> NDArray[np.float64]:
    """`FITS` of one object-frame; `ignored` holds its band and those of others."""
    areas = (core, core & ~mask, mask, mask & ~core & ~ignored)
    return np.array([1, *(np.count_nonzero(area) for area in areas), unknown_share], dtype=np.float64)


def _of_object(tp: int, fp: int, fn: int) -> NDArray[np.float64]:
    """Accumulators of one object-frame, in the order of `SUMS`."""
    covered, overlap = tp / (tp + fn), tp / (tp + fp + fn)  # what is evaluated has pixels
    return np.array([1.0, overlap, tp > 0, covered if tp else 0.0, covered >= 0.5, 0.0])


def _of_frame(false_positive_share: float) -> NDArray[np.float64]:
    """Accumulators of one image-frame, in the order of `SUMS`."""
    return np.array([1.0, 0.0, 0.0, 0.0, 0.0, false_positive_share])


def rank_recording(source: AuditSource, *, predictions: Sequence[Prediction]) -> RankingSums:
    """Score all predictions on a recording against all references.

    An image that a single prediction or reference cannot use is left out for all, so that all are scored over the same
    object-frames.

    Raises:
        DataError: the recording cannot be opened, or has no rendered masks.
    """
    clock, found = StageClock(), RankingSums.empty(len(predictions))
    with clock.stage("open"):
        recording = source.recorded.open()
        refuse_without_masks(recording)
        found.digest = recording_digest(recording)
    for camera in sorted(recording.cameras):
        _rank_camera(recording, camera, found, predictions=predictions, clock=clock)
    found.seconds = dict(clock.seconds)
    return found


def _rank_camera(
    recording: Recording, camera: str, found: RankingSums, *, predictions: Sequence[Prediction], clock: StageClock
) -> None:
    protocol = load_protocol(PAPER)
    size_px = protocol.scoring.false_positive_component_px
    predicted = CameraPredictions(recording, camera, predictions=predictions, protocol=protocol, clock=clock)
    others = [ReferenceBuilder(recording, camera, settings) for settings in list(lidar_references().values())[1:]]
    instance_of = instance_ids({track.track_id: track.instance_id for track in recording.tracks})
    for index in range(predicted.history, len(predicted.images)):
        image = predicted.images[index]
        try:
            with clock.stage("reference"):
                by_lidar = [builder.build(image) for builder in (predicted.references, *others)]
                ids = read_truth(image, predicted.camera)
                references = same_objects(by_lidar, ids, instance_of)
            masks = predicted.masks(index, by_lidar[0], ids)
        except UnscorableFrame:
            continue
        except BenchError as error:
            found.problems.append(str(error))
            continue
        with clock.stage("counts"):
            found.add(references, masks, component_size_px=size_px)
