"""Counts of runs that tests write and change by hand."""

from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from bench.harness.answers import Answer, Key, safe_name, write_answers
from bench.harness.counts import FRAMES, OBJECTS, TaskCounts, counts_folder

TASK = "front-00000000"


def write_counts(results: Path, objects: pa.Table, frames: pa.Table) -> None:
    """Store tables as the counts of a run, each camera of a recording in files of its own."""
    for row in frames.group_by(["recording", "camera"]).aggregate([]).to_pylist():
        chosen = (pc.field("recording") == row["recording"]) & (pc.field("camera") == row["camera"])
        own = [table.filter(chosen) for table in (objects, frames)]
        counted = TaskCounts(objects=own[0], frames=own[1], image_map=None)
        counted.write(counts_folder(results, row["recording"]), f"{safe_name(row['camera'])}-00000000")


def write_seconds(run: Path, seconds: float) -> None:
    """Store an answer that took so long."""
    key = Key("drive", "front", 0)
    row = dict(Answer.none(key, "skipped", "").row) | {"seconds": seconds}
    write_answers(run / "answers" / "drive" / f"{TASK}.parquet", [Answer(row)])


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
