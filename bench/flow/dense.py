"""Dense flow by OpenCV, its mean on square cells, and a cache of that."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.errors import ShapeError, UnknownNameError, UsageError

if TYPE_CHECKING:
    from joblib import Memory


class DenseFlow(Protocol):
    """Computes dense flow between two grey images."""

    def __call__(self, start: NDArray[np.uint8], end: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Displacement of every pixel of `start` into `end`.

        Args:
            start: (H, W) uint8, grey.
            end: (H, W) uint8, grey.

        Returns:
            (H, W, 2) float32, px: `start[x]` is found at `end[x + flow[x]]`.

        Raises:
            ShapeError: images of different size, or not grey.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class FarnebackFlow:
    """Farnebäck's polynomial expansion, the paper's choice; the paper names no parameters, these are OpenCV's usual.

    Attributes:
        pyramid_scale: size of each pyramid level against the one below.
        levels: pyramid levels.
        window_px: averaging window.
        iterations: per level.
        neighbourhood_px: size of the polynomial's neighbourhood.
        neighbourhood_sigma: Gaussian weight in it, px.
    """

    pyramid_scale: float = 0.5
    levels: int = 3
    window_px: int = 15
    iterations: int = 3
    neighbourhood_px: int = 5
    neighbourhood_sigma: float = 1.2

    def __call__(self, start: NDArray[np.uint8], end: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Displacement of every pixel of `start` into `end`, (H, W, 2) float32, px, as `DenseFlow` says."""
        check_grey((start, end), "dense flow")
        flow = cv2.calcOpticalFlowFarneback(
            start,
            end,
            np.empty((*start.shape, 2), dtype=np.float32),
            self.pyramid_scale,
            self.levels,
            self.window_px,
            self.iterations,
            self.neighbourhood_px,
            self.neighbourhood_sigma,
            0,
        )
        return np.asarray(flow, dtype=np.float32)


@dataclass(frozen=True, slots=True, kw_only=True)
class DisFlow:
    """Dense inverse search (Kroeger et al. 2016).

    Attributes:
        preset: "ultrafast", "fast" or "medium".
        finest_scale: halvings of the image at the finest level that is matched, 0 for the image itself; None for the
            preset's own.
    """

    preset: str = "medium"
    finest_scale: int | None = None

    def __post_init__(self) -> None:
        if self.preset not in _DIS_PRESETS:
            raise UnknownNameError("DIS preset", self.preset, _DIS_PRESETS)
        if self.finest_scale is not None and not 0 <= self.finest_scale <= 10:
            raise UsageError(f"dis: finest_scale: expected 0 to 10 or none, got {self.finest_scale}")

    def __call__(self, start: NDArray[np.uint8], end: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Displacement of every pixel of `start` into `end`, (H, W, 2) float32, px, as `DenseFlow` says."""
        check_grey((start, end), "dense flow")
        if min(start.shape) < SMALLEST_DIS_PX:
            height, width = start.shape
            raise UsageError(f"dis: expected images of at least {SMALLEST_DIS_PX} px a side, got {width} x {height}")
        # A flow handed in would be taken as the first guess; zeros are what OpenCV starts from without one.
        search = cv2.DISOpticalFlow.create(_DIS_PRESETS[self.preset])
        if self.finest_scale is not None:
            search.setFinestScale(self.finest_scale)
        return np.asarray(search.calc(start, end, np.zeros((*start.shape, 2), np.float32)), dtype=np.float32)


SMALLEST_DIS_PX = 12  # OpenCV refuses smaller ones, or ends the process

_DIS_PRESETS = {
    "ultrafast": cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
    "fast": cv2.DISOPTICAL_FLOW_PRESET_FAST,
    "medium": cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
}

DENSE_FLOWS: dict[str, type[FarnebackFlow] | type[DisFlow]] = {"farneback": FarnebackFlow, "dis": DisFlow}


def dense_flow(name: str, **parameters: object) -> FarnebackFlow | DisFlow:
    """The flow of a name.

    Raises:
        UnknownNameError: no such flow, or a parameter that it does not have.
    """
    if name not in DENSE_FLOWS:
        raise UnknownNameError("dense flow", name, DENSE_FLOWS)
    known = [field.name for field in fields(DENSE_FLOWS[name])]
    for parameter in parameters:
        if parameter not in known:
            raise UnknownNameError(f"parameter of the flow {name}", parameter, known)
    return DENSE_FLOWS[name](**parameters)  # type: ignore[arg-type]


def check_grey(images: Sequence[NDArray[np.uint8]], what: str) -> None:
    """Refuse images, of which something is computed, that are not grey or not of one size.

    Raises:
        ShapeError: such images.
    """
    first = images[0]
    for image in images:
        if image.ndim != 2 or image.shape != first.shape or image.dtype != np.uint8:
            got = f"{image.dtype} {image.shape} beside {first.dtype} {first.shape}"
            raise ShapeError(f"{what}: expected grey uint8 images of one size, got {got}")


def cell_mean(values: NDArray[np.float32], cell_size_px: int) -> NDArray[np.float32]:
    """Mean over square cells that tile the image from its first pixel.

    Where the image's size is no multiple of the cell, the border pixels are repeated to fill the last cells.

    Args:
        values: (H, W) or (H, W, C) float32.
        cell_size_px: side of a cell, px.

    Returns:
        (ceil(H / cell), ceil(W / cell)[, C]) float32.

    Raises:
        ShapeError: a cell size that is no whole number, below 1, or larger than the image.

    Source:
        Mariotti and Eising 2020, section III-A: flow averaged on a 5 x 5 pixel grid.
    """
    height, width = values.shape[:2]
    if not (isinstance(cell_size_px, int) and 1 <= cell_size_px <= max(height, width)):
        raise ShapeError(f"cell_size_px: expected a whole number from 1 to {max(height, width)}, got {cell_size_px}")
    rows, columns = -(-height // cell_size_px), -(-width // cell_size_px)
    below, right = rows * cell_size_px - height, columns * cell_size_px - width
    if below or right:
        values = np.asarray(cv2.copyMakeBorder(values, 0, below, 0, right, cv2.BORDER_REPLICATE), dtype=np.float32)
    return np.asarray(cv2.resize(values, (columns, rows), interpolation=cv2.INTER_AREA), dtype=np.float32)


_memory: Memory | None = None
CACHE_BYTES = 8 << 30


@contextmanager
def memoise_flow(folder: Path | None) -> Iterator[None]:
    """Have `flow_on_cells` store what it computes inside of the block, and find what was stored before.

    Args:
        folder: of the cache, made where it is not there; None to compute everything.
    """
    global _memory
    before, _memory = _memory, None if folder is None else _opened(folder)
    try:
        yield
    finally:
        _memory = before


def evict_flow(folder: Path, limit_bytes: int = CACHE_BYTES) -> None:
    """Remove the flow that was used longest ago until the rest takes no more than a limit."""
    _opened(folder).reduce_size(bytes_limit=limit_bytes)


def _opened(folder: Path) -> Memory:
    from joblib import Memory  # 0.1 s, and most commands need no cache

    return Memory(folder, verbose=0)


def flow_on_cells(
    start: NDArray[np.uint8],
    end: NDArray[np.uint8],
    *,
    flow: str,
    parameters: Mapping[str, object],
    cell_size_px: int,
) -> NDArray[np.float32]:
    """Mean flow of each cell: (ceil(H / cell), ceil(W / cell), 2) float32, px; from a cache inside of `memoise_flow`.

    Args:
        start: (H, W) uint8, grey.
        end: (H, W) uint8, grey.
        flow: name of `DENSE_FLOWS`.
        parameters: what it takes.
        cell_size_px: side of a cell.
    """
    compute = _flow_on_cells if _memory is None else _memory.cache(_flow_on_cells)
    return np.asarray(compute(start, end, flow, dict(parameters), cell_size_px, cv2.__version__))


def _flow_on_cells(
    start: NDArray[np.uint8],
    end: NDArray[np.uint8],
    flow: str,
    parameters: Mapping[str, object],
    cell_size_px: int,
    _opencv: str,
) -> NDArray[np.float32]:
    return cell_mean(dense_flow(flow, **parameters)(start, end), cell_size_px)
