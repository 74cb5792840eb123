"""The answer of a method on one image, and what can be wrong with it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

PAPER_THRESHOLD = 6e-4  # likelihood above which the paper's method marks a cell; the scale of likelihoods is about it

Scalar = TypeVar("Scalar", bound=np.generic)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Segmentation:
    """A method's answer for the current image, on square cells that tile it from the first pixel.

    Attributes:
        cell_size_px: side of a cell; 1 for every pixel.
        mask: (rows, columns) bool; moving. It belongs to the current, that is the last, image.
        likelihood: (rows, columns) float32; motion likelihood, 0 where undefined; None for a method without one.
        undefined: (rows, columns) bool; where the method has no answer, which counts as static; None for nowhere.
        causes: names of what can flag a cell, for example the constraints; empty for a method without any.
        cause: (rows, columns) uint8, index into `causes` of the largest contribution; None without causes.
        likelihood_is_score: the likelihood is a score in [0, 1], for example a network's, not the paper's mean of
            angles; it decides the bins of histograms and the scale of pictures.
        threshold: of the likelihood, above which cells are in the mask; None where the mask comes about in another way.
            Reports say of what was missed how far below it lies.
        parts: named (rows, columns) float arrays to look at, for example the single deviations and the flow; they may
            be missing where a step was found in the cache.
    """

    cell_size_px: int
    mask: NDArray[np.bool_]
    likelihood: NDArray[np.float32] | None = None
    undefined: NDArray[np.bool_] | None = None
    causes: tuple[str, ...] = ()
    cause: NDArray[np.uint8] | None = None
    parts: dict[str, NDArray[np.float32]] | None = None
    likelihood_is_score: bool = False
    threshold: float | None = None

    def mask_at(self, width: int, height: int) -> NDArray[np.bool_]:
        """The mask at every pixel of the image: (height, width) bool."""
        return self._spread(self.mask, width, height)

    def undefined_at(self, width: int, height: int) -> NDArray[np.bool_]:
        """Pixels of cells where the method has no answer: (height, width) bool."""
        if self.undefined is None:
            return np.zeros((height, width), dtype=bool)
        return self._spread(self.undefined, width, height)

    def _spread(self, cells: NDArray[Scalar], width: int, height: int) -> NDArray[Scalar]:
        if self.cell_size_px == 1:
            return cells
        rows = np.repeat(cells, self.cell_size_px, axis=1)  # within rows first: they are few yet
        return np.repeat(rows, self.cell_size_px, axis=0)[:height, :width]


def segmentation_fault(answer: object, *, width: int, height: int) -> str | None:
    """Describe what is wrong with a method's answer on an image of `width` x `height` px; None where nothing is."""
    return next(_faults(answer, width, height), None)


def _faults(answer: object, width: int, height: int) -> Iterator[str]:
    if not isinstance(answer, Segmentation):
        yield f"expected a bench.methods.Segmentation from segment(), got {type(answer).__name__}"
        return
    size = answer.cell_size_px
    if isinstance(size, bool) or not (isinstance(size, int | np.integer) and 1 <= size <= max(width, height)):
        yield f"cell_size_px: expected a whole number from 1 to {max(width, height)}, got {size!r}"
        return
    shape = -(-height // int(size)), -(-width // int(size))
    arrays: list[tuple[str, object, type[np.generic]]] = [
        ("mask", answer.mask, np.bool_),
        ("undefined", answer.undefined, np.bool_),
        ("likelihood", answer.likelihood, np.floating),
        ("cause", answer.cause, np.uint8),
        *((f"parts[{name!r}]", values, np.floating) for name, values in (answer.parts or {}).items()),
    ]
    for name, values, kind in arrays:
        if values is not None or name == "mask":
            yield from _array_faults(name, values, shape, kind)
    if answer.likelihood is not None:
        yield from _likelihood_faults(answer.likelihood, score=answer.likelihood_is_score)
    yield from _threshold_faults(answer)
    names = answer.causes
    if not (isinstance(names, tuple) and all(isinstance(name, str) for name in names) and len({*names}) == len(names)):
        yield f"causes: expected a tuple of names, each once, got {names!r}"
    elif answer.cause is not None and answer.cause.max() >= len(names):
        yield f"cause: expected indices into {len(names)} causes, got {answer.cause.max()}"


def _array_faults(name: str, values: object, shape: tuple[int, int], kind: type[np.generic]) -> Iterator[str]:
    expected = f"{name}: expected a {shape} array of {'float' if kind is np.floating else kind.__name__.rstrip('_')}"
    if not isinstance(values, np.ndarray):
        yield f"{expected}, got {type(values).__name__}"
    elif values.shape != shape or not np.issubdtype(values.dtype, kind):
        yield f"{expected}, got {values.shape} of {values.dtype}"


def _likelihood_faults(likelihood: NDArray[np.floating], *, score: bool) -> Iterator[str]:
    lowest, highest = float(likelihood.min()), float(likelihood.max())  # NaN passes through both
    if not (np.isfinite(lowest) and np.isfinite(highest)):
        bad = int((~np.isfinite(likelihood)).sum())
        yield f"likelihood: expected finite numbers, 0 where undefined, got {bad} that are NaN or infinite"
    elif lowest < 0 or (score and highest > 1):
        expected = "a score in [0, 1]" if score else "at least 0"
        yield f"likelihood: expected {expected}, got {lowest:.9g} to {highest + 0.0:.9g}"


def _threshold_faults(answer: Segmentation) -> Iterator[str]:
    threshold = answer.threshold
    if threshold is None:
        return
    if isinstance(threshold, bool) or not isinstance(threshold, int | float | np.number):
        yield f"threshold: expected a number, got {threshold!r}"
    elif answer.likelihood is None:
        yield f"threshold: expected a likelihood that it is of, or no threshold, got {threshold:g} alone"
    elif answer.likelihood_is_score and not 0 <= threshold <= 1:
        yield (
            f"threshold: expected one of the likelihood, a score in [0, 1], got {threshold:g}; leave it out "
            "where the mask comes about in another way"
        )
