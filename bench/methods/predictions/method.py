"""Predictions from disk as a segmentation method."""

from __future__ import annotations

from copy import copy
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from bench.errors import DataError, UsageError
from bench.methods.contract import Method, MethodInput, UnansweredImage
from bench.methods.predictions.files import PredictionReader, on_cells
from bench.methods.predictions.images import NAMINGS, ImageKey, Naming
from bench.methods.predictions.pairing import PredictionIndex, index_predictions
from bench.recordings import load_card
from bench.records.segmentation import Segmentation

MissingPolicy = Literal["error", "skip", "empty"]
MISSING_POLICIES: tuple[MissingPolicy, ...] = get_args(MissingPolicy)
DEFAULT_THRESHOLD = 0.5
HALF = 0.5  # of a block's pixels, from which on the block moves


class PredictedMotion(Method):
    """Returns the prediction of each image from a file.

    The folder is gone through once, when the first image is asked for, unless that has been done before.

    Args:
        name: what the results call it.
        folder: of the predictions.
        dataset: card of the data set whose images they name.
        split: of the data set; None for all of it.
        threshold: score above which a pixel moves; None for masks, and 0.5 for scores.
        missing: what becomes of an image without a prediction: "error" to fail, "skip" to leave it unscored, "empty"
            for nothing that moves.
        naming: what the names of the files are.
        history: images that must lie before one that is scored; 1 scores the same images as methods that compare two.
        digest: that the folder must have; None for any.

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
        naming: Naming = "auto",
        history: int = 1,
        digest: str | None = None,
    ) -> None:
        _refuse_unknown("missing", missing, MISSING_POLICIES)
        _refuse_unknown("names", naming, NAMINGS)
        if history < 1:
            raise UsageError(f"history: expected 1 or more, got {history}")
        if threshold is not None and not 0 <= threshold < 1:
            raise UsageError(f"threshold: expected a number in [0, 1), got {threshold}")
        self.name, self.folder, self.dataset, self.split = name, folder, dataset, split
        self.threshold, self.missing, self.naming, self.history = threshold, missing, naming, history
        self.digest = digest
        self._index: PredictionIndex | None = None
        self._reader = PredictionReader()

    def use(self, index: PredictionIndex) -> None:
        """Take a folder that was gone through.

        Raises:
            DataError: it has another digest than was asked for.
            UsageError: a threshold for masks.
        """
        if self.digest is not None and index.digest != self.digest:
            expected = f"predictions with the digest {self.digest[:12]}"
            raise DataError(self.folder, expected=expected, got=f"{index.digest[:12]}; they have changed")
        if index.form == "mask" and self.threshold is not None:
            raise UsageError(f"threshold: expected none for masks, got {self.threshold}; {self.folder} holds no scores")
        if index.form == "score" and self.threshold is None:
            self.threshold = DEFAULT_THRESHOLD
        self.digest, self._index = index.digest, index

    def segment(self, frame: MethodInput) -> Segmentation:
        """The prediction from the image's file.

        Raises:
            DataError: the prediction cannot be used, or is missing where that is an error.
            UnansweredImage: the prediction is missing and to be skipped.
            UsageError: the recording and camera of the image are not given.
        """
        if not frame.recording:
            raise UsageError(f"{self.name}: expected to know which recording and camera it is, got neither")
        index, key = self._indexed(), ImageKey(frame.recording, frame.camera_name, frame.timestamps_ns[-1])
        if key in index.faulty:
            fault = index.faulty[key]
            raise DataError(fault.file, field=fault.field, expected=fault.expected, got=fault.got, hint=fault.hint)
        if key in index.usable:
            prediction = index.usable[key]
            values = self._reader.read(prediction)
            cells, size_px = on_cells(values, prediction.sizes)
        elif self.missing == "empty":
            cells, size_px = np.zeros(frame.valid.shape, dtype=np.float32), 1
        elif self.missing == "skip":
            raise UnansweredImage(f"{self.folder}: no prediction of {key}")
        else:
            raise DataError(self.folder, expected=f"a prediction of {key}", got="none")
        if self.threshold is None:
            return Segmentation(cell_size_px=size_px, mask=cells >= HALF)
        mask = cells > np.float32(self.threshold)
        return Segmentation(
            cell_size_px=size_px, mask=mask, likelihood=cells, likelihood_is_score=True, threshold=self.threshold
        )

    def __deepcopy__(self, _: dict[int, object]) -> PredictedMotion:
        return copy(self)  # it holds what it read of files, and nothing that depends on images before

    def _indexed(self) -> PredictionIndex:
        if self._index is None:
            card = load_card(self.dataset)
            folder = Path(self.folder)
            self.use(index_predictions(folder, card, split=self.split, naming=self.naming, history=self.history))
        assert self._index is not None
        return self._index


def _refuse_unknown(option: str, got: str, known: tuple[str, ...]) -> None:
    if got not in known:
        raise UsageError(f"{option}: expected {', '.join(known)}, got {got!r}")
