"""Counts of runs that tests write and change by hand."""

from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from bench.evaluation.rows import COLUMNS_OF_FRAMES, FRAMES_SCHEMA, OBJECTS_SCHEMA
from bench.harness import counts
from bench.harness.answers import no_answer, safe_name, write_answers
from bench.harness.counts import FRAMES, OBJECTS, read_counts, stored_recordings
from bench.harness.stored import results_folder

TASK = "front-00000000"


def write_counts(results: Path, objects: pa.Table, frames: pa.Table) -> None:
    """Store tables as the counts of a run, each camera of a recording in files of its own."""
    for row in frames.group_by(["recording", "camera"]).aggregate([]).to_pylist():
        chosen = (pc.field("recording") == row["recording"]) & (pc.field("camera") == row["camera"])
        own = [table.filter(chosen) for table in (objects, frames)]
        place = f"{safe_name(row['recording'])}/{safe_name(row['camera'])}-00000000"
        counts.write_counts(results, place, *own)


def write_seconds(run: Path, seconds: float) -> None:
    """Store an answer that took so long."""
    image = {"recording": "drive", "camera": "front", "timestamp_ns": 0, "seconds": seconds}
    write_answers(run / "answers" / "drive" / f"{TASK}.parquet", [no_answer(image, "skipped", "")])


def change_table(results: Path, table: str, change: Callable[[pa.Table], pa.Table], *, recording: str = "*") -> None:
    """Change the stored table "objects" or "frames" of a run, of one recording or each."""
    suffix = {"objects": OBJECTS, "frames": FRAMES}[table]
    files = sorted((results / "counts").glob(f"{recording}/*{suffix}"))
    assert files, f"{results} has counts"
    for file in files:
        pq.write_table(change(pq.read_table(file)), file)


def counts_file(results: Path, table: str, recording: str = "*") -> Path:
    """The first file of the stored table "objects" or "frames" of a recording."""
    return sorted((results / "counts").glob(f"{recording}/*.{table}.parquet"))[0]


def read_tables(run: Path, *, histograms: bool = True) -> tuple[pa.Table, pa.Table]:
    """The objects and frames of a run, or of its results by a protocol."""
    folder = results_folder(run)
    columns = {"objects": OBJECTS_SCHEMA.names, "frames": FRAMES_SCHEMA.names if histograms else COLUMNS_OF_FRAMES}
    for table in columns:
        for recording in stored_recordings(folder):
            read_counts(folder, table, recording, columns[table])
    return tuple(
        pa.concat_tables(
            pq.read_table(file, columns=columns[table])
            for file in sorted((folder / "counts").glob(f"*/*.{table}.parquet"))
        )
        for table in columns
    )
