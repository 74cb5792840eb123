"""Time and memory of everything that reads a whole run, on rows drawn at random; no image stands behind them.

Each step runs in a process of its own, so that its peak of resident memory is its own.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from bench.evaluation import rows
from bench.evaluation.counts import BINS
from bench.evaluation.protocol import load_protocol
from bench.evaluation.rows import FRAMES_SCHEMA, OBJECTS_SCHEMA
from bench.evaluation.summary import ProtocolOfRun
from bench.gate.baseline import read_run_sums
from bench.gate.judge import judge
from bench.gate.tolerances import load_tolerances
from bench.harness import counts
from bench.harness.counts import write_counts
from bench.harness.manifest import CodeOfRun, DatasetOfRun, Manifest, MethodOfRun
from bench.harness.stored import Provenance, read_run, write_results
from bench.methods import build_method
from bench.records.reference import Direction, IgnoreReason, Status
from bench.reporting.compare import write_comparison
from bench.reporting.run_page import write_page
from bench.reporting.run_tables import write_report_files

CAMERAS = ("front", "left", "rear", "right")
WIDTH, HEIGHT = 640, 480
PERIOD_NS = 66_000_000
PLACES_AN_IMAGE = 5  # annotated objects in every image
TRACK_IMAGES = 100  # images that an object is seen in
TEMPLATES = 64  # histograms to draw from: drawing two million of them would take the time of the whole test
IMAGES_A_RECORDING = 1011  # of which one in a hundred fails
PAPER = load_protocol("paper-v1")


def write_run_tables(folder: Path, *, object_frames: int, method_seed: int) -> None:
    """Write a run of about so many object-frames; runs that differ in the seed alone compare."""
    for number in range(round(object_frames / (0.99 * IMAGES_A_RECORDING * PLACES_AN_IMAGE)) or 1):
        reference, method = (np.random.default_rng([seed, number, k]) for k, seed in enumerate((1, method_seed)))
        name = f"drive-{number:05d}"
        frames = _frames(name, IMAGES_A_RECORDING, reference, method)
        tables = _objects(name, frames, reference, method), pa.table(frames, schema=FRAMES_SCHEMA)
        for camera in CAMERAS:
            own = [table.filter(pc.field("camera") == camera) for table in tables]
            write_counts(folder, f"{name}/{camera}-00000000", *own)


def _frames(name: str, images: int, reference: np.random.Generator, method: np.random.Generator) -> dict[str, object]:
    scored = reference.random(images) > 0.01
    counts = {column: method.integers(0, 60, images) for column in (*rows.FRAME_COUNTS, "undefined_px")}
    counts |= dict(zip(("width", "height", "valid_px"), np.full((images, 3), [WIDTH, HEIGHT, 250_746]).T, strict=True))
    counts |= {
        "reference_px": reference.integers(0, 40_000, images),
        "ignored_px": reference.integers(0, 3_000, images),
    }
    counts |= {"tp_px": _part(method, counts["reference_px"]), "fp_px": method.integers(0, 150_000, images)}
    counts |= {"fn_px": counts["reference_px"] - counts["tp_px"], "detected_px": counts["tp_px"] + counts["fp_px"]}
    counts = {column: np.where(scored, values, 0) for column, values in counts.items()}
    false_px, epipolar = counts["fp_px"].tolist(), _part(method, counts["fp_px"]).tolist()
    causes = [[("epipolar", e), ("positive_depth", fp - e)] for e, fp in zip(epipolar, false_px, strict=True)]
    found: dict[str, object] = {
        "recording": [name] * images,
        "camera": [CAMERAS[k % len(CAMERAS)] for k in range(images)],
        "timestamp_ns": np.arange(images) // len(CAMERAS) * PERIOD_NS,
        "ego_speed_mps": np.abs(np.cumsum(reference.normal(0, 0.1, images))),
        "status": np.where(scored, "evaluated", "failed").tolist(),
        "problem": [None if k else "truncated image" for k in scored.tolist()],
        **counts,
        "fp_by_cause": pa.array(causes, type=FRAMES_SCHEMA.field("fp_by_cause").type),
    }
    for column in ("likelihood_reference_px", "likelihood_outside_px"):
        kind = FRAMES_SCHEMA.field(column).type
        templates = method.integers(0, 400, (TEMPLATES, BINS)) * (method.random((TEMPLATES, BINS)) < 0.4)
        values = pa.array(templates[method.integers(0, TEMPLATES, images)].ravel())
        lists = pa.FixedSizeListArray.from_arrays(values, BINS).cast(kind)
        found[column] = pc.if_else(pa.array(scored), lists, pa.scalar(None, kind))
    return found


def _objects(
    name: str, frames: dict[str, object], reference: np.random.Generator, method: np.random.Generator
) -> pa.Table:
    scored = np.array(frames["status"]) == "evaluated"
    of_frame = np.repeat(np.flatnonzero(scored), PLACES_AN_IMAGE)
    count = len(of_frame)
    place = np.tile(np.arange(PLACES_AN_IMAGE), count // PLACES_AN_IMAGE)
    track = of_frame // TRACK_IMAGES * PLACES_AN_IMAGE + place
    tracks = int(track.max(initial=0)) + 1
    classes = _choice(reference, PAPER.reference.classes, tracks)
    categories = _choice(reference, [str(c) for c in PAPER.reference.categories], tracks)
    status = np.array([str(s) for s in (Status.EVALUATED, Status.IGNORED, Status.STATIC)])[
        reference.choice(3, count, p=[0.58, 0.35, 0.07])
    ]
    evaluated, ignored = status == str(Status.EVALUATED), status == str(Status.IGNORED)
    known = evaluated | (reference.random(count) < 0.5)
    region = np.where(evaluated, np.exp(reference.normal(7, 1.5, count)).astype(np.int64) + 20, 0)
    tp = _part(method, region) * (method.random(count) < 0.85)
    columns = {
        "recording": [name] * count,
        "camera": np.array(CAMERAS)[of_frame % len(CAMERAS)],
        "timestamp_ns": np.asarray(frames["timestamp_ns"])[of_frame],
        "track_id": [f"object-{k}" for k in track.tolist()],
        "object_class": classes[track],
        "status": status,
        "reason": pa.array(_choice(reference, [str(r) for r in IgnoreReason], count), mask=~ignored),
        "category": pa.array(categories[track], mask=status == str(Status.STATIC)),
        "direction": pa.array(_choice(reference, [str(d) for d in Direction], count), mask=~known),
        "range_m": np.where(known, reference.uniform(0.5, 12, count), np.nan),
        "x_m": np.where(known, reference.normal(4, 3, count), np.nan),
        "y_m": np.where(known, reference.normal(0, 3, count), np.nan),
        "speed_mps": np.abs(reference.normal(5, 3, count)),
        "ego_speed_mps": np.asarray(frames["ego_speed_mps"])[of_frame],
        "points": np.where(known, reference.integers(10, 4_000, count), 0),
        "polygon_px": region,
        "region_px": region,
        "tp": tp,
        "fn": region - tp,
        "fp": _part(method, np.where(evaluated, 100_000, 0)),
        "unknown_px": np.zeros(count, dtype=np.int64),
        "ceiling_tp": pa.nulls(count, pa.int64()),
        "ceiling_fp": pa.nulls(count, pa.int64()),
        "chance_tp": pa.array(_part(method, region), mask=~evaluated | (method.random(count) < 0.05)),
    }
    return pa.table(columns, schema=OBJECTS_SCHEMA)


def _part(draw: np.random.Generator, whole: NDArray[np.int64]) -> NDArray[np.int64]:
    """A random share of each count."""
    return np.floor(draw.random(len(whole)) * (whole + 1)).astype(np.int64)


def _choice(draw: np.random.Generator, words: Sequence[str], count: int) -> NDArray[np.str_]:
    return np.array([str(word) for word in words])[draw.integers(0, len(words), count)]


OUTLINE_M = ((-1.0, -0.9), (3.8, -0.9), (3.8, 0.9), (-1.0, 0.9))
MB = 1024 if sys.platform == "linux" else 1024 * 1024  # `ru_maxrss` counts kilobytes there, bytes on macOS


@dataclass(frozen=True, slots=True, kw_only=True)
class Spent:
    """Cost of a step.

    Attributes:
        seconds: on the clock.
        cpu_seconds: of the processor, over all cores.
        peak_mb: of resident memory.
        start_mb: the same before the step, with everything imported.
    """

    seconds: float
    cpu_seconds: float
    peak_mb: float
    start_mb: float


def summarise_run(one: Path, _: Path) -> None:
    """Steps that end a run: summary, digest of the reference, threshold-free metrics."""
    manifest = Manifest(
        dataset=DatasetOfRun(name="drawn", card="drawn.yaml", split=None),
        method=MethodOfRun.of(build_method("nothing")),
        protocol=ProtocolOfRun(name=PAPER.name, version=PAPER.version, digest=PAPER.digest),
        code=CodeOfRun.here(),
    )
    provenance = Provenance(
        started_utc="2026-01-02T03:04", seconds=1.0, images=0,
        images_asked=0, workers=1, peak_memory_mb=1.0,
    )  # fmt: skip
    write_results(one, manifest=manifest, protocol=PAPER, provenance=provenance, vehicle_outline_m=OUTLINE_M)


STEPS: dict[str, Callable[[Path, Path], object]] = {
    "summary": summarise_run,
    "tables": lambda one, _: write_report_files(read_run(one)),
    "page": lambda one, _: write_page(one, pictures=False),
    "gate": lambda one, other: judge(read_run_sums(one), read_run_sums(other), tolerances=load_tolerances()),
    "compare": lambda one, other: write_comparison([one, other], one / "comparison", pictures=False),
}


def write_runs(folder: Path, *, object_frames: int) -> tuple[Path, Path]:
    """Two runs over the same reference, with their summaries."""
    runs = folder / "one", folder / "other"
    for method, run in enumerate(runs):
        write_run_tables(run, object_frames=object_frames, method_seed=method)
        summarise_run(run, run)
    return runs


def measure(step: str, runs: tuple[Path, Path], *, rows_at_once: int = counts.ROWS_AT_ONCE) -> Spent:
    """Run a step in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.large_run", step, str(rows_at_once), *map(str, runs)]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=3600)
    return Spent(**json.loads(done.stdout.splitlines()[-1]))


def _run_step(step: str, runs: tuple[Path, Path]) -> Spent:
    before, start = resource.getrusage(resource.RUSAGE_SELF), time.perf_counter()
    STEPS[step](*runs)
    seconds, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_SELF)
    cpu = [usage.ru_utime + usage.ru_stime for usage in (before, after)]
    return Spent(
        seconds=seconds, cpu_seconds=cpu[1] - cpu[0], peak_mb=after.ru_maxrss / MB, start_mb=before.ru_maxrss / MB
    )


def main() -> None:
    """Run a step, and print what it took."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("step", choices=sorted(STEPS))
    parser.add_argument("rows_at_once", type=int)
    parser.add_argument("runs", nargs=2, type=Path)
    asked = parser.parse_args()
    counts.ROWS_AT_ONCE = asked.rows_at_once
    sys.stdout.write(json.dumps(asdict(_run_step(asked.step, tuple(asked.runs)))))


if __name__ == "__main__":
    main()
