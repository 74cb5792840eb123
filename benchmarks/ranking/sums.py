"""Scores of many predictions against every reference: sums over a recording's object-frames, in one pass."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.audit.sources import OpenedSource, same_objects
from bench.errors import BenchError
from bench.evaluation.counts import Mask, count_frame
from bench.evaluation.definitions import UNKNOWN, find_metric
from bench.evaluation.protocol import Protocol, load_protocol
from bench.evaluation.rows import Row
from bench.evaluation.sums import ALL_MOVING, CATEGORY, FRAMES, name_bins, sum_metrics
from bench.harness.frames import UnscorableFrame
from bench.recordings import Recording, read_truth
from bench.records.reference import Category, ReferenceFrame, ReferenceObject, Status
from bench.records.rules import ReferenceSettings
from bench.reference.build import ReferenceBuilder
from benchmarks.ranking.predictions import CameraPredictions, Prediction

FALSE_POSITIVES = "false_positives"
CATEGORIES = tuple(category.value for category in Category if category is not Category.MOVING)
ROWS = (*CATEGORIES, ALL_MOVING, FALSE_POSITIVES)

PAPER, SURFACE, EXACT = "paper-v1", "surface-v1", "exact"
BINS = load_protocol(SURFACE).bins
REFERENCES = (PAPER, "concave", "surface-patches", SURFACE, EXACT)  # the exact masks last

# What ranks the predictions in the rows of object-frames, and in that of false positives.
IOU, FALSE_SHARE = find_metric("iou"), find_metric("false_positive_coverage")
SCORED = ["reference", "prediction", "recording"]
OF_OBJECT = ["category", "object_class", "unknown_px"]
OBJECT_COLUMNS = [*SCORED, *OF_OBJECT, "tp", "fn", "fp"]
FRAME_COLUMNS = [*SCORED, "width", "height", "fp_px"]
# How far the regions of `surface-v1` are right, summed over object-frames by class, range and ego speed.
FIT_SLICES = ["object_class", "range_m", "ego_speed_mps"]
FITS = ["object_frames", "core_px", "core_outside_px", "mask_px", "left_out_px", "unknown_share"]


def lidar_references() -> dict[str, ReferenceSettings]:
    """The lidar references by name, all of `REFERENCES` but the last.

    The convex hulls of `paper-v1`, concave hulls by the same rules, the surface patches from which `surface-v1` makes
    its regions, all of whose pixels count, and these regions.
    """
    paper, surface = (load_protocol(name).reference for name in (PAPER, SURFACE))
    concave, certain = (
        paper.model_copy(update={"polygon_kind": "concave"}),
        surface.model_copy(update={"unknown_band": None}),
    )
    settings = (paper, concave, certain, surface)
    return dict(zip(REFERENCES[:-1], settings, strict=True))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RankingSums:
    """Sums of a recording; their size does not depend on the recording's.

    Attributes:
        scores: sums as `bench.evaluation.sums.sum_metrics` gives them, by reference, prediction and recording: kinds of
            motion, classes, all moving objects, and images.
        fits: `FITS` by `FIT_SLICES`.
    """

    scores: pd.DataFrame
    fits: pd.DataFrame


class RankingRows:
    """Counts of the images of a recording, a row for each reference, prediction and object or image.

    Args:
        predictions: names.
        references: names; the regions of the last but one are compared with the exact masks, the last.
        component_size_px: as in the protocol; of no effect on these sums.
    """

    def __init__(
        self, predictions: Sequence[str], references: Sequence[str] = REFERENCES, *, component_size_px: int
    ) -> None:
        self._predictions, self._references = predictions, references
        self._component_size_px = component_size_px
        self._objects: list[Row] = []
        self._frames: list[Row] = []
        self._fits: list[Row] = []

    def add(self, references: Sequence[ReferenceFrame], masks: Sequence[Mask]) -> None:
        """Score the masks of an image.

        Args:
            references: of the same objects, in the order of their names.
            masks: (H, W) bool, one per prediction.
        """
        for name, reference in zip(self._references, references, strict=True):
            for prediction, mask in zip(self._predictions, masks, strict=True):
                key = {"reference": name, "prediction": prediction, "recording": reference.recording}
                frame, objects = count_frame(reference, mask, component_size_px=self._component_size_px)
                self._frames.append(key | asdict(frame))
                self._objects += [
                    key | {name: getattr(item, name) for name in OF_OBJECT} | asdict(counts)
                    for item, counts in zip(reference.objects, objects, strict=True)
                    if item.status is Status.EVALUATED
                ]
        surface, exact = references[-2:]
        self._fits += [
            _fit(item, surface.labels == number, exact.labels == number, surface)
            for number, item in enumerate(surface.objects, start=1)
            if item.status is Status.EVALUATED
        ]

    def scores(self) -> pd.DataFrame:
        """Return `RankingSums.scores`."""
        objects = pd.DataFrame(self._objects, columns=OBJECT_COLUMNS)
        frames = pd.DataFrame(self._frames, columns=FRAME_COLUMNS)
        slices = {CATEGORY: objects["category"], "object_class": objects["object_class"]}
        slices[ALL_MOVING] = pd.Series(ALL_MOVING, objects.index)
        parts = [
            sum_metrics(objects, [IOU, UNKNOWN], slices, by=SCORED),
            sum_metrics(frames, [FALSE_SHARE], {FRAMES: pd.Series(FALSE_POSITIVES, frames.index)}, by=SCORED),
        ]
        return pd.concat(parts, ignore_index=True)

    def fits(self) -> pd.DataFrame:
        """Return `RankingSums.fits`."""
        rows = pd.DataFrame(self._fits, columns=[*FIT_SLICES, *FITS]).astype(dict.fromkeys(FITS, np.float64))
        for name in ("range_m", "ego_speed_mps"):
            rows[name] = name_bins(rows[name].astype(np.float64), getattr(BINS, name)).astype(object)
        return rows.groupby(FIT_SLICES, dropna=False).sum().reset_index()


def _fit(item: ReferenceObject, core: Mask, mask: Mask, surface: ReferenceFrame) -> Row:
    """Columns `FIT_SLICES` and `FITS` of one object-frame; I of `surface` holds its band and those of others."""
    return {
        "object_class": item.object_class,
        "range_m": item.range_m,
        "ego_speed_mps": surface.ego_speed_mps,
        "object_frames": 1,
        "core_px": np.count_nonzero(core),
        "core_outside_px": np.count_nonzero(core & ~mask),
        "mask_px": np.count_nonzero(mask),
        "left_out_px": np.count_nonzero(mask & ~core & ~surface.ignored),
        "unknown_share": item.unknown_px / (item.region_px + item.unknown_px),
    }


def rank_recording(opened: OpenedSource, *, predictions: Sequence[Prediction]) -> RankingSums:
    """Score all predictions on a recording against all references.

    An image that a single prediction or reference cannot use is left out for all, so that all are scored over the same
    object-frames.
    """
    protocol = load_protocol(PAPER)
    names = [prediction.name for prediction in predictions]
    rows = RankingRows(names, component_size_px=protocol.scoring.false_positive_component_px)
    others = [(opened.recording, settings) for settings in [*lidar_references().values()][1:]]
    for image in predicted_images(opened, predictions, protocol, others=others):
        rows.add(same_objects(image.references, image.ids, opened.instance_of), image.masks)
    return RankingSums(scores=rows.scores(), fits=rows.fits())


class PredictedImage(NamedTuple):
    """An image that every reference and prediction can use.

    Attributes:
        references: each of its own objects.
        ids: (H, W) uint16, true instance ids.
        masks: (H, W) bool, one per prediction.
    """

    references: list[ReferenceFrame]
    ids: NDArray[np.uint16]
    masks: list[Mask]


def predicted_images(
    opened: OpenedSource,
    predictions: Sequence[Prediction],
    protocol: Protocol,
    *,
    others: Sequence[tuple[Recording, ReferenceSettings]],
) -> Iterator[PredictedImage]:
    """The images of all cameras.

    Args:
        opened: the recording.
        predictions: that are asked.
        protocol: of the first reference.
        others: of the other references: of which recording, and how.
    """
    for name in sorted(opened.recording.cameras):
        predicted = CameraPredictions(opened.recording, name, predictions=predictions, protocol=protocol)
        builders = [predicted.references, *(ReferenceBuilder(one, name, settings) for one, settings in others)]
        for index in range(predicted.history, len(predicted.images)):
            image = predicted.images[index]
            try:
                references = [builder.build(image) for builder in builders]
                ids = read_truth(image, predicted.camera)
                masks = predicted.masks(index, references[0], ids)
            except UnscorableFrame:
                continue
            except BenchError as error:
                opened.problems.append(str(error))
                continue
            opened.images += 1
            yield PredictedImage(references=references, ids=ids, masks=masks)
