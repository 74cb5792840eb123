"""Answers as files: what a method, or anybody else, said of each image; all that scores reads them.

`answers/<recording>/<camera>-<first image>.parquet` has a row for each image of a task, `ANSWERS_SCHEMA`: the mask on
the method's cells, one bit each, or the reason why there is none. A likelihood is stored as its bin of
`bench.evaluation.counts`, one byte: histograms, and with them every curve, come out exactly; pictures show the
middle of the bin.

Parquet files are opened here, as pyarrow by name waits for pipes and asks for UTF-8.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from bench.atomic import open_regular, replacing
from bench.errors import DataError
from bench.evaluation.counts import BINS, EDGES, SCORE_EDGES, find_bins
from bench.records.segmentation import Segmentation, segmentation_fault

ANSWERS = "answers"
ANSWERED, SKIPPED, FAILED = "answered", "skipped", "failed"
LARGEST_SIDE_PX = 1 << 16
ROUNDED_SHARE = 0.001  # of an image's cells: sums on a GPU come in another order each time

ANSWERS_SCHEMA = pa.schema(
    [
        ("recording", pa.string()),
        ("camera", pa.string()),
        ("timestamp_ns", pa.int64()),
        ("status", pa.string()),  # answered, skipped or failed
        ("problem", pa.string()),  # why it is not answered
        ("seconds", pa.float64()),  # that the method took
        ("cell_size_px", pa.int32()),
        ("rows", pa.int32()),
        ("columns", pa.int32()),
        ("mask", pa.binary()),  # bits
        ("undefined", pa.binary()),  # bits
        ("cause", pa.binary()),  # bytes
        ("causes", pa.list_(pa.string())),
        ("likelihood", pa.binary()),  # bytes, bins
        ("likelihood_is_score", pa.bool_()),
        ("threshold", pa.float64()),
    ]
)
Answer = Mapping[str, Any]  # a row of `ANSWERS_SCHEMA`; what is missing is null


def safe_name(name: str) -> str:
    """Name of a recording or camera as that of a file or folder."""
    quoted = quote(name, safe=" ")
    return f"%2E{quoted[1:]}" if quoted.startswith(".") else quoted


def name_of(safe: str) -> str:
    """Name of a recording or camera whose file or folder it is."""
    return unquote(safe)


def write_table(file: Path, table: pa.Table, *, rows_at_once: int | None = None) -> None:
    """Write a whole table.

    Args:
        file: to write.
        table: the rows.
        rows_at_once: that a reader of some of them unpacks together; None for all.

    Raises:
        OutputError: the disk is full, or may not be written.
    """
    with replacing(file) as temporary, temporary.open("wb") as out:
        pq.write_table(table, out, compression="zstd", row_group_size=rows_at_once)


def read_table(file: Path, **chosen: Any) -> pa.Table:
    """Read a table, or the columns, rows or schema of it that `pyarrow.parquet.read_table` is asked for.

    Raises:
        OSError: it cannot be opened, or is no regular file.
        ArrowException: it is no such table.
    """
    with open_regular(file) as content:
        return pq.read_table(content, use_threads=False, **chosen)


def answer_row(image: Mapping[str, object], segmentation: Segmentation, *, seconds: float) -> Answer:
    """The answer of a method, copied: what it changes afterwards changes nothing.

    Args:
        image: recording, camera and timestamp_ns.
        segmentation: checked.
        seconds: that the method took.
    """
    said, bins = segmentation, None
    if said.likelihood is not None:
        edges = SCORE_EDGES if said.likelihood_is_score else EDGES
        bins = find_bins(said.likelihood, edges).astype(np.uint8).tobytes()
    return {
        **image,
        "status": ANSWERED,
        "problem": "",
        "seconds": seconds,
        "cell_size_px": int(said.cell_size_px),
        "rows": said.mask.shape[0],
        "columns": said.mask.shape[1],
        "mask": np.packbits(said.mask).tobytes(),
        "undefined": None if said.undefined is None else np.packbits(said.undefined).tobytes(),
        "cause": None if said.cause is None else said.cause.tobytes(),
        "causes": list(said.causes),
        "likelihood": bins,
        "likelihood_is_score": said.likelihood_is_score,
        "threshold": None if said.threshold is None else float(said.threshold),
    }


def no_answer(image: Mapping[str, object], status: str, problem: str) -> Answer:
    """No answer.

    Args:
        image: recording, camera and timestamp_ns.
        status: `SKIPPED` where nothing is wrong, or `FAILED`.
        problem: why there is none.
    """
    return {**image, "status": status, "problem": problem}


def is_answered(row: Answer) -> bool:
    """True where an answer is a segmentation."""
    return bool(row["status"] == ANSWERED)


def answers_agree(one: Answer, other: Answer) -> bool:
    """Return whether both say the same of an image; masks may differ by what rounding on a GPU changes.

    Raises:
        DataError: a segmentation is damaged.
    """
    if not (is_answered(one) and is_answered(other)):
        return (one["status"], one["problem"]) == (other["status"], other["problem"])
    here, there = segmentation_of(one).mask, segmentation_of(other).mask
    return here.shape == there.shape and float(np.mean(here != there)) <= ROUNDED_SHARE


def segmentation_of(row: Answer) -> Segmentation:
    """Unpack the segmentation of an answer; it is checked as a method's own is.

    Raises:
        DataError: it is damaged.
    """
    try:
        return _segmentation(row)
    except (TypeError, ValueError, OverflowError) as error:
        place = "{recording}, {camera}, {timestamp_ns} ns".format_map(row)
        raise DataError(f"answer of {place}", expected="a mask of rows x columns cells", got=str(error)) from error


def write_answers(file: Path, answers: Sequence[Answer]) -> None:
    """Write the answers of a task, by one rename.

    Raises:
        OutputError: the disk is full, or may not be written.
    """
    write_table(file, pa.Table.from_pylist(list(answers), schema=ANSWERS_SCHEMA), rows_at_once=16)


def read_answers(file: Path, *, timestamp_ns: int | None = None) -> list[Answer]:
    """Read the answers of a task.

    Args:
        file: of the task.
        timestamp_ns: of the only image that is wanted; None for all.

    Raises:
        DataError: missing or damaged.
    """
    wanted = None if timestamp_ns is None else [("timestamp_ns", "=", timestamp_ns)]
    try:
        rows: list[Answer] = read_table(file, schema=ANSWERS_SCHEMA, filters=wanted).to_pylist()
    except (OSError, pa.ArrowException) as error:
        got, hint = " ".join(str(error).split()), "remove the file, and run again"
        raise DataError(file, expected="answers of a run", got=got, hint=hint) from error
    return rows


def read_seconds(answers: Path) -> NDArray[np.float64]:
    """Seconds that each answer of a run took.

    Args:
        answers: folder.
    """
    files = sorted(answers.glob("*/*.parquet"))
    seconds = [read_table(file, columns=["seconds"])["seconds"].to_numpy() for file in files]
    return np.concatenate([np.empty(0), *seconds])


def _segmentation(row: Answer) -> Segmentation:
    size_px, shape, is_score = row["cell_size_px"], (row["rows"], row["columns"]), row["likelihood_is_score"]
    if not (min(shape) > 0 and max(shape) <= LARGEST_SIDE_PX and 0 < size_px <= LARGEST_SIDE_PX):
        raise ValueError(f"{shape[0]} x {shape[1]} cells of {size_px} px")
    bins, cause = (_plane(row[name], shape) for name in ("likelihood", "cause"))
    if bins is not None and bins.max() >= BINS:
        raise ValueError(f"likelihood: bin {bins.max()} of {BINS}")
    said = Segmentation(
        cell_size_px=size_px,
        mask=_bits(row["mask"], shape),
        undefined=None if row["undefined"] is None else _bits(row["undefined"], shape),
        cause=cause,
        causes=tuple(row["causes"]),
        likelihood=None if bins is None else _middles(is_score=is_score)[bins],
        likelihood_is_score=is_score,
        threshold=row["threshold"],
    )
    if fault := segmentation_fault(said, width=shape[1] * size_px, height=shape[0] * size_px):
        raise ValueError(fault)
    return said


def _bits(content: bytes, shape: tuple[int, int]) -> NDArray[np.bool_]:
    cells = shape[0] * shape[1]
    if len(content) != -(-cells // 8):
        raise ValueError(f"{len(content)} bytes for {shape[0]} x {shape[1]} cells")
    return np.unpackbits(np.frombuffer(content, dtype=np.uint8), count=cells).reshape(shape).view(np.bool_)


def _plane(content: bytes | None, shape: tuple[int, int]) -> NDArray[np.uint8] | None:
    return None if content is None else np.frombuffer(content, dtype=np.uint8).reshape(shape)


def _middles(*, is_score: bool) -> NDArray[np.float32]:
    """A value within each bin: 0 for the first, else the middle by ratio."""
    edges, last = (SCORE_EDGES, 1.0) if is_score else (EDGES, 2 * EDGES[-2])
    return np.concatenate([[0.0], np.sqrt(edges[1:-2] * edges[2:-1]), [last]]).astype(np.float32)
