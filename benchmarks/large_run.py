"""Time and memory of everything that reads a whole run, on drawn rows: `python -m benchmarks.large_run`.

Each step runs in a process of its own, so that its peak of resident memory is its own.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from bench.evaluation import load_protocol, rows, sum_run, summary_of, write_sums
from bench.evaluation.summary import ProtocolOfRun
from bench.gate import judge, load_tolerances, read_run_sums
from bench.harness import Provenance, open_tables, read_run
from bench.harness.manifest import CodeOfRun, DatasetOfRun, Manifest, MethodOfRun
from bench.harness.stored import SUMS, write_run
from bench.methods import build_method
from bench.reporting.compare import write_comparison
from bench.reporting.run_page import write_page
from bench.reporting.run_tables import write_report_files
from benchmarks.drawn_tables import write_run_tables

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
    rules = load_protocol("paper-v1")
    sums = sum_run(*open_tables(one), protocol=rules)
    write_sums(sums, one / SUMS)
    metrics = summary_of(sums, protocol=rules)
    manifest = Manifest(
        dataset=DatasetOfRun(name="drawn", card="drawn.yaml", split=None),
        method=MethodOfRun.of(build_method("nothing")),
        protocol=ProtocolOfRun(name=rules.name, version=rules.version, digest=rules.digest),
        code=CodeOfRun.here(),
    )
    provenance = Provenance(
        started_utc="2026-01-02T03:04", seconds=1.0, images=metrics.images.evaluated,
        images_asked=0, workers=1, peak_memory_mb=1.0,
    )  # fmt: skip
    write_run(one, metrics, manifest=manifest, protocol=rules, provenance=provenance, vehicle_outline_m=OUTLINE_M)


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


def measure(step: str, runs: tuple[Path, Path], *, rows_at_once: int = rows.ROWS_AT_ONCE) -> Spent:
    """Run a step in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.large_run", "--step", step, "--rows-at-once", str(rows_at_once)]
    done = subprocess.run([*command, *map(str, runs)], check=True, capture_output=True, text=True, timeout=3600)
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
    """Measure all steps and print them, or run one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="*", type=Path, help="two runs that are there; drawn without them")
    parser.add_argument("--object-frames", type=int, default=10_000_000)
    parser.add_argument("--rows-at-once", type=int, default=rows.ROWS_AT_ONCE)
    parser.add_argument("--step", choices=sorted(STEPS))
    asked = parser.parse_args()
    rows.ROWS_AT_ONCE = asked.rows_at_once
    if asked.step:
        spent = _run_step(asked.step, tuple(asked.runs))
        sys.stdout.write(json.dumps(asdict(spent)))
        return
    with tempfile.TemporaryDirectory() as folder:
        runs = tuple(asked.runs) or write_runs(Path(folder), object_frames=asked.object_frames)
        objects, frames = open_tables(runs[0])
        told = f"{len(objects):,} object-frames, {len(frames):,} images, {len(frames.recordings()):,} recordings\n"
        sys.stdout.write(told)
        for step in STEPS:
            sys.stdout.write(f"{step}: {measure(step, runs, rows_at_once=asked.rows_at_once)}\n")


if __name__ == "__main__":
    main()
