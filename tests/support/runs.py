"""Runs of the small data set by the paper's protocol, and their results as bytes."""

import json
from pathlib import Path

from bench.evaluation.protocol import Protocol, load_protocol
from bench.harness.exact import build_scorable
from bench.harness.manifest import MANIFEST
from bench.harness.run import RunRequest, run_benchmark
from bench.harness.stored import SUMS, RunSummary
from bench.recordings import load_card

PAPER = load_protocol("paper-v1")
IMAGES = 12  # of the small data set that are scored


def run_one(*, protocol: Protocol, out: Path, **options) -> RunSummary:
    """The summary of the run by one protocol."""
    how = {name: options.pop(name) for name in ("executor", "progress") if name in options}
    (run,) = run_benchmark(RunRequest(folder=out, protocols=[protocol], **options), **how).results
    return run.summary


def score(card: Path, out: Path, *, method="spherical", settings=None, protocol=PAPER, **options) -> RunSummary:
    """The summary of a run of a method, by name or built."""
    chosen = build_scorable(method, settings or {}) if isinstance(method, str) else method
    return run_one(card=load_card(str(card)), method=chosen, protocol=protocol, out=out, **options)


def bytes_of(run: Path, protocol: str = "paper-v1") -> dict[str, bytes]:
    """The whole result but for where it comes from, and how long it took."""
    results = run / protocol
    summary = json.loads((results / "summary.json").read_text())
    del summary["provenance"]
    files = [*sorted((results / "counts").rglob("*.*")), results / SUMS, results / MANIFEST]
    found = {file.relative_to(results).as_posix(): file.read_bytes() for file in files if file.is_file()}
    return found | {"summary": json.dumps(summary).encode()}
