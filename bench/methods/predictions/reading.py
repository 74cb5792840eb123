"""The prediction of an image from whichever kind of file it lies in."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from bench.methods.predictions.npz_scores import read_npz_scores
from bench.methods.predictions.png_maps import read_png_map
from bench.methods.predictions.run_lengths import MaskEntry, decode_union, read_entries
from bench.methods.predictions.sizes import ImageSizes


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """Where the prediction of an image lies.

    Attributes:
        file: it stands in.
        camera: of the image.
        names: by which the file's list names the image; empty for a file of one image.
        sizes: of the image.
    """

    file: Path
    camera: str
    names: tuple[str, ...]
    sizes: ImageSizes


class PredictionReader:
    """Reads predictions; the file of many images that was read last is kept."""

    def __init__(self) -> None:
        self._held: tuple[Path, Mapping[str, list[MaskEntry]]] | None = None

    def entries(self, file: Path) -> Mapping[str, list[MaskEntry]]:
        """The entries of a file of many images, by the names of their images.

        Raises:
            DataError: it cannot be read.
        """
        if self._held is None or self._held[0] != file:
            by_name: defaultdict[str, list[MaskEntry]] = defaultdict(list)
            for entry in read_entries(file):
                by_name[entry.name].append(entry)
            self._held = file, dict(by_name)
        return self._held[1]

    def read(self, prediction: Prediction) -> NDArray[Any]:
        """Read a prediction.

        Returns:
            (rows, columns) bool, moving, or float32 scores in [0, 1], at the size that they were stored at.

        Raises:
            DataError: it cannot be used; of the subclasses in `faults` where its size or values are at fault.
        """
        if prediction.names:
            entries = self.entries(prediction.file)
            chosen = [e for name in prediction.names for e in entries.get(name, []) if e.is_of(prediction.camera)]
            return decode_union(chosen, prediction.sizes, file=prediction.file)
        if prediction.file.suffix.lower() == ".npz":
            return read_npz_scores(prediction.file, prediction.sizes)
        return read_png_map(prediction.file, prediction.sizes)
