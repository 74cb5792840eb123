"""Predictions from disk as a segmentation method, whether they may be scored, and the report of what does not fit."""

from __future__ import annotations

import json
from copy import copy
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from bench.atomic import write_text
from bench.errors import DataError, UsageError
from bench.methods.contract import Method, MethodInput, UnansweredImage
from bench.methods.predictions.pairing import FaultKind, ImageKey, PredictionIndex
from bench.recordings import DatasetCard
from bench.records.segmentation import Segmentation

MissingPolicy = Literal["error", "skip", "empty"]
DEFAULT_THRESHOLD = 0.5
HALF = 0.5  # of a block's pixels, from which on the block moves
SCHEMA_VERSION = 1


class PredictedMotion(Method):
    """Returns the prediction of each image from a file, once `index_predictions` has gone through the folder.

    Args:
        name: what the results call it.
        folder: of the predictions.
        dataset: card of the data set whose images they name.
        split: of the data set; None for all of it.
        threshold: score above which a pixel moves; None for masks, and 0.5 for scores.
        missing: what becomes of an image without a prediction: "error" to fail, "skip" to leave it unscored, "empty"
            for nothing that moves.

    Raises:
        UsageError: a value that an argument cannot have.
    """

    reads_images = False

    def __init__(
        self,
        *,
        name: str,
        folder: str,
        dataset: str,
        split: str | None = None,
        threshold: float | None = None,
        missing: MissingPolicy = "error",
    ) -> None:
        if missing not in get_args(MissingPolicy):
            raise UsageError(f"missing: expected {', '.join(get_args(MissingPolicy))}, got {missing!r}")
        if threshold is not None and not 0 <= threshold < 1:
            raise UsageError(f"threshold: expected a number in [0, 1), got {threshold}")
        self.name, self.folder, self.dataset, self.split = name, folder, dataset, split
        self.threshold, self.missing = threshold, missing
        self._index: PredictionIndex | None = None

    def settings(self) -> dict[str, object]:
        """The constructor's parameters, and the digest of what was found in the folder."""
        return super().settings() | {"digest": None if self._index is None else self._index.digest}

    def use(self, index: PredictionIndex) -> None:
        """Take a folder that was gone through.

        Raises:
            UsageError: a threshold for masks.
        """
        if index.form == "mask" and self.threshold is not None:
            raise UsageError(f"threshold: expected none for masks, got {self.threshold}; {self.folder} holds no scores")
        if index.form == "score" and self.threshold is None:
            self.threshold = DEFAULT_THRESHOLD
        self._index = index

    def segment(self, frame: MethodInput) -> Segmentation:
        """The prediction from the image's file.

        Raises:
            DataError: the prediction cannot be used, or is missing where that is an error.
            UnansweredImage: the prediction is missing and to be skipped.
        """
        index = self._index
        assert index is not None, "the folder was gone through"
        key = ImageKey(frame.recording, frame.camera_name, frame.timestamps_ns[-1])
        prediction = index.predictions.get(key)
        if prediction is not None and prediction.files:
            cells, cell_px = prediction.sizes.on_cells(prediction.values(prediction.content()))
        elif self.missing == "empty":
            cells, cell_px = np.zeros(frame.valid.shape, dtype=np.float32), 1
        elif self.missing == "skip":
            raise UnansweredImage(f"{self.folder}: no prediction of {key}")
        else:
            raise DataError(self.folder, expected=f"a prediction of {key}", got="none")
        if self.threshold is None:
            return Segmentation(cell_size_px=cell_px, mask=cells >= HALF)
        mask = cells > np.float32(self.threshold)
        return Segmentation(
            cell_size_px=cell_px, mask=mask, likelihood=cells, likelihood_is_score=True, threshold=self.threshold
        )

    def __deepcopy__(self, _: dict[int, object]) -> PredictedMotion:
        return copy(self)  # it holds what it read of files, and nothing that depends on images before


def refuse_faults(method: PredictedMotion, index: PredictionIndex) -> None:
    """Refuse a folder with any fault where every prediction is required; else score what is there.

    Args:
        method: with the folder.
        index: of the folder.

    Raises:
        DataError: says how many faults of each kind there are; or nothing there can be used.
    """
    if index.usable and (method.missing != "error" or not index.faults):
        return
    counts = {kind: len(index.of_kind(kind)) for kind in FaultKind}
    expected = f"a prediction of each of {index.expected} images, and nothing else"
    got = ", ".join(f"{count} {kind.value}" for kind, count in counts.items() if count)
    hint = "fix them, all are listed with -v"
    if index.usable:
        hint += "; or score what is there: --missing skip leaves images without one out, "
        hint += "--missing empty counts them as empty"
    raise DataError(method.folder, expected=expected, got=got, hint=hint)


def write_report(file: Path, card: DatasetCard, method: PredictedMotion, index: PredictionIndex) -> None:
    """Write how a folder of predictions fits a data set, as `predictions.json`: counts, and all faults by kind."""
    told = ("form", "digest", "expected", "unscored", "elsewhere", "largest")
    content = {
        "schema_version": SCHEMA_VERSION,
        "dataset": card.name,
        **{name: getattr(method, name) for name in ("split", "folder", "threshold", "missing")},
        **{name: getattr(index, name) for name in told},
        "usable": len(index.usable),
        "faults": {
            kind.value: [{"place": fault.place, "reason": fault.reason} for fault in index.of_kind(kind)]
            for kind in FaultKind
        },
    }
    write_text(file, json.dumps(content, indent=1, ensure_ascii=False) + "\n")
