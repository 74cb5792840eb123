"""Runs of the small data set by the paper's protocol, and their results as bytes."""

import json
from pathlib import Path

from bench.evaluation import Protocol, load_protocol
from bench.harness import RunRequest, RunSummary, build_scorable, run_benchmark
from bench.harness.cache import CacheFolder
from bench.harness.manifest import MANIFEST
from bench.harness.masks import MASKS
from bench.harness.stored import IMAGE_MAPS, SUMS
from bench.recordings import load_card

PAPER = load_protocol("paper-v1")
ONE, ALL, NONE = 1, 3, 0  # units of the small data set that are computed again


def run_one(*, protocol: Protocol, out: Path, finish=None, **options) -> RunSummary:
    """The summary of the run by one protocol."""
    (run,) = run_benchmark(RunRequest(runs={out: protocol}, **options), finish=finish).values()
    return run.summary


def score(
    card: Path, out: Path, *, method="spherical", settings=None, cache: Path | None = None, protocol=PAPER, **options
) -> RunSummary:
    """The summary of a run of a method, by name or built."""
    chosen = build_scorable(method, settings or {}) if isinstance(method, str) else method
    kept = None if cache is None else CacheFolder(folder=cache)
    return run_one(card=load_card(str(card)), method=chosen, protocol=protocol, out=out, cache=kept, **options)


def bytes_of(run: Path) -> dict[str, bytes]:
    """The whole result but for where it comes from."""
    summary = json.loads((run / "summary.json").read_text())
    del summary["provenance"], summary["sha256"]
    names = ("objects.parquet", "frames.parquet", SUMS, MASKS, IMAGE_MAPS, MANIFEST)
    tables = {name: (run / name).read_bytes() for name in names}
    return tables | {"summary": json.dumps(summary).encode()}
