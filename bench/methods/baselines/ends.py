"""The two methods that bound every table."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from bench.methods.contract import MethodInput, Segmentation


class Nothing:
    """Says that nothing moves: detection rate 0, false positives 0."""

    name: ClassVar[str] = "nothing"
    history: ClassVar[int] = 1

    def settings(self) -> dict[str, object]:
        """No parameters."""
        return {}

    def segment(self, frame: MethodInput) -> Segmentation:
        """An empty mask."""
        return Segmentation(cell_size_px=1, mask=np.zeros(frame.valid.shape, dtype=bool))


class Everything:
    """Says that everything moves: detection rate 1, coverage 1, and false positives over the rest."""

    name: ClassVar[str] = "everything"
    history: ClassVar[int] = 1

    def settings(self) -> dict[str, object]:
        """No parameters."""
        return {}

    def segment(self, frame: MethodInput) -> Segmentation:
        """A full mask."""
        return Segmentation(cell_size_px=1, mask=np.ones(frame.valid.shape, dtype=bool))
