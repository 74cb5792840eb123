"""Time and memory of a long log of 123D: `python -m benchmarks.large_log --images 20000`.

The log is that of the tests' small drive, its rows repeated with later times; images are of 64 x 48 px, so that what is
measured is the reading of tables, not of pixels. Opening and scoring run in processes of their own. Seconds are the
processor's, since both take one core.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pyarrow as pa
import yaml

from bench.commands.runs import run_request
from bench.harness import Part, score_part
from bench.harness.stages import largest_resident_mb
from bench.harness.tasks import TASK_IMAGES
from bench.recordings import load_card, open_dataset
from tests.support.log123d import OPTIONS, tiny_recording, write_log
from tests.support.tiny import STEP_NS, TIMES_NS

ROWS_A_BATCH = 64


def write_long_log(folder: Path, *, images: int) -> Path:
    """Write a log of about so many images; give back its card."""
    log = write_log(tiny_recording(folder / "small"), folder / "logs")
    for file in sorted(log.glob("*.arrow")):
        with pa.ipc.open_file(file) as reader:
            table = reader.read_all()
        copies = pa.concat_tables([_later(table, copy) for copy in range(-(-images // len(TIMES_NS)))])
        with pa.ipc.new_file(file, table.schema, options=pa.ipc.IpcWriteOptions(compression="lz4")) as writer:
            writer.write_table(copies.combine_chunks(), max_chunksize=ROWS_A_BATCH)
    card = folder / "long.yaml"
    keys = {"name": "long", "title": "long log", "adapter": "123d", "root": "logs", "licence": "none"}
    card.write_text(yaml.safe_dump(keys | {"options": {**OPTIONS, "ground_height_m": 0.0}}))
    return card


def _later(table: pa.Table, copy: int) -> pa.Table:
    """The rows with later times, and objects of their own."""
    shift_us = copy * len(TIMES_NS) * STEP_NS // 1000
    for place, name in enumerate(table.column_names):
        if name.endswith("timestamp_us"):
            table = table.set_column(place, name, pa.compute.add(table[name], shift_us))
        elif name.endswith("track_token"):
            tokens = [[f"{token}-{copy}" for token in row] for row in table[name].to_pylist()]
            table = table.set_column(place, name, pa.array(tokens, table.schema.field(name).type))
    return table


def open_log(card: Path, _: int) -> str:
    """Open the log."""
    start = time.process_time()
    (handle,) = open_dataset(load_card(card))
    recording = handle.open()
    seconds = time.process_time() - start
    (images,) = recording.images.values()
    return f"opening {len(images)} images, {len(recording.tracks)} tracks: {seconds:.1f} s"


def score(card: Path, parts: int) -> str:
    """Score one of so many parts of it by the paper's method."""
    request = run_request(load_card(card), "spherical", protocol="paper-v1", out=card.parent / "run")
    start = time.process_time()
    scored = score_part(request, Part(number=parts // 2 + 1, count=parts))
    seconds = time.process_time() - start
    assert not scored.failures, "all images are whole"
    images = sum(outcome.asked for outcome in scored.tasks.values())
    return (
        f"scoring {images} of the images, opening included: {seconds:.1f} s, {images / seconds:.0f} images per second"
    )


STEPS = {"open": open_log, "score": score}


def main() -> None:
    """Write the log and measure, or run one step."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=int, default=20_000)
    parser.add_argument("--parts", type=int, default=40)
    parser.add_argument("--step", choices=("start", *STEPS))
    parser.add_argument("--card", type=Path)
    asked = parser.parse_args()
    if asked.step:
        told = "start" if asked.step == "start" else STEPS[asked.step](asked.card, asked.parts)
        sys.stdout.write(f"{told}, peak {largest_resident_mb():.0f} MB\n")
        return
    with tempfile.TemporaryDirectory() as folder:
        card = write_long_log(Path(folder), images=asked.images)
        size = sum(file.stat().st_size for file in Path(folder).rglob("*.arrow")) / 1e6
        sys.stdout.write(f"{asked.images} images, {size:.0f} MB, tasks of {TASK_IMAGES}\n")
        for step in ("start", *STEPS):
            command = [sys.executable, "-m", "benchmarks.large_log", "--card", str(card), "--parts", str(asked.parts)]
            subprocess.run([*command, "--step", step], check=True)


if __name__ == "__main__":
    main()
