"""Answers of a method as a run stores them: enough to draw what was scored without the method.

A row of `masks.parquet` holds an image's mask on the method's cells, one bit each, and for pictures and reasons alone
where the method could not say, what can mark a cell, the threshold, and the likelihood, rounded: the upper eight bits
of a half-precision number (relative error at most 1/16), on at most `LIKELIHOOD_CELLS` cells.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from bench.errors import DataError
from bench.methods import Segmentation

MASKS = "masks.parquet"
LIKELIHOOD_CELLS = 20_000
LARGEST_HALF, LARGEST_FINITE = 65504.0, 0xF7  # as a number, and as its upper eight bits

MASKS_SCHEMA = pa.schema(
    [
        ("recording", pa.string()),
        ("camera", pa.string()),
        ("timestamp_ns", pa.int64()),
        ("cell_size_px", pa.int32()),
        ("rows", pa.int32()),
        ("columns", pa.int32()),
        ("mask", pa.binary()),
        ("undefined", pa.binary()),
        ("likelihood", pa.binary()),
        ("likelihood_step", pa.int32()),
        ("likelihood_is_score", pa.bool_()),
        ("threshold", pa.float64()),
        ("causes", pa.list_(pa.string())),
    ]
)


def mask_row(segmentation: Segmentation, *, recording: str, camera: str, timestamp_ns: int) -> dict[str, object]:
    """The row of `MASKS_SCHEMA` of an image that was scored."""
    rows, columns = segmentation.mask.shape
    step = max(1, ceil(sqrt(rows * columns / LIKELIHOOD_CELLS)))
    likelihood = segmentation.likelihood
    return {
        "recording": recording,
        "camera": camera,
        "timestamp_ns": timestamp_ns,
        "cell_size_px": int(segmentation.cell_size_px),
        "rows": rows,
        "columns": columns,
        "mask": _bits(segmentation.mask),
        "undefined": None if segmentation.undefined is None else _bits(segmentation.undefined),
        "likelihood": None if likelihood is None else _rounded(likelihood[::step, ::step]).tobytes(),
        "likelihood_step": step,
        "likelihood_is_score": segmentation.likelihood_is_score,
        "threshold": None if segmentation.threshold is None else float(segmentation.threshold),
        "causes": list(segmentation.causes),
    }


def read_mask(file: Path, *, recording: str, camera: str, timestamp_ns: int) -> Segmentation | None:
    """Read the segmentation that was scored on an image; None where none was.

    Args:
        file: masks of a run.
        recording: name.
        camera: name.
        timestamp_ns: exposure.

    Raises:
        DataError: the file is missing or damaged.
    """
    key = ("recording", recording), ("camera", camera), ("timestamp_ns", timestamp_ns)
    try:
        found = pq.read_table(file, schema=MASKS_SCHEMA, filters=[(name, "=", value) for name, value in key])
    except (OSError, pa.ArrowException) as error:
        raise DataError(file, expected="the masks of a run", got=" ".join(str(error).split())) from error
    if not len(found):
        return None
    if len(found) > 1:
        got = f"{len(found)} of {recording!r}, {camera!r} at {timestamp_ns} ns"
        raise DataError(file, expected="one mask of each image that was scored", got=got)
    try:
        return _segmentation(found.to_pylist()[0])
    except (TypeError, ValueError, OverflowError) as error:
        raise DataError(file, expected="a mask of rows x columns cells", got=str(error)) from error


def _segmentation(row: Mapping[str, Any]) -> Segmentation:
    shape = int(row["rows"]), int(row["columns"])
    undefined, likelihood, step = row["undefined"], row["likelihood"], int(row["likelihood_step"])
    return Segmentation(
        cell_size_px=int(row["cell_size_px"]),
        mask=_from_bits(row["mask"], shape),
        undefined=None if undefined is None else _from_bits(undefined, shape),
        likelihood=None if likelihood is None else _spread(likelihood, shape, step),
        likelihood_is_score=bool(row["likelihood_is_score"]),
        threshold=row["threshold"],
        causes=tuple(row["causes"]),
    )


def _bits(cells: NDArray[np.bool_]) -> bytes:
    return np.packbits(cells).tobytes()


def _from_bits(content: bytes, shape: tuple[int, int]) -> NDArray[np.bool_]:
    cells = shape[0] * shape[1]
    if min(shape) < 1 or len(content) != -(-cells // 8):
        raise ValueError(f"{len(content)} bytes for {shape[0]} x {shape[1]} cells")
    return np.unpackbits(np.frombuffer(content, dtype=np.uint8), count=cells).reshape(shape).view(np.bool_)


def _rounded(values: NDArray[np.floating]) -> NDArray[np.uint8]:
    halves = np.minimum(values, LARGEST_HALF).astype(np.float16).view(np.uint16)
    rounded: NDArray[np.uint8] = np.minimum((halves.astype(np.uint32) + 0x40) >> 7, LARGEST_FINITE).astype(np.uint8)
    return rounded


def _spread(content: bytes, shape: tuple[int, int], step: int) -> NDArray[np.float32]:
    if step < 1:
        raise ValueError(f"a likelihood_step of {step}")
    coarse = -(-shape[0] // step), -(-shape[1] // step)
    halves = (np.frombuffer(content, dtype=np.uint8).astype(np.uint16) << 7).view(np.float16)
    values = halves.astype(np.float32).reshape(coarse)
    return np.repeat(np.repeat(values, step, axis=0), step, axis=1)[: shape[0], : shape[1]]
