"""Input of the gate: the sums of a run and its manifest. The same two files, committed, are a baseline."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from bench.errors import DataError, UsageError
from bench.evaluation.protocol import known_protocols
from bench.evaluation.sums import read_sums, write_sums
from bench.harness.manifest import ANSWERS_MANIFEST, MANIFEST, Manifest, read_manifest, write_manifest
from bench.harness.stored import SUMMARY, SUMS, read_run, refuse_unscored, results_folder
from bench.recordings.cards import shipped_folder

BASELINES = Path("reports/baselines")
UNNAMED_PROTOCOL = "paper-v1"  # its baselines bear the name of the data set alone
BASELINE_RUN = "reports/runs/baseline"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunSums:
    """The sums of a run, or of a baseline.

    Attributes:
        manifest: what they are of.
        sums: table of sums.
        failures: of the run; none in a baseline.
        unreviewed: a sentence where annotations were proposed and nobody reviewed them; "" elsewhere.
    """

    manifest: Manifest
    sums: pd.DataFrame
    failures: tuple[str, ...] = ()
    unreviewed: str = ""


def read_run_sums(run: Path) -> RunSums:
    """Read the sums of a stored run.

    Raises:
        DataError: a file of the run is missing or damaged, or they are not of one run.
        UsageError: its data are not annotated.
    """
    stored = read_run(run)
    summary = stored.summary
    refuse_unscored(summary, run)
    return RunSums(manifest=stored.manifest, sums=stored.sums, failures=summary.failures, unreviewed=summary.unreviewed)


def find_baseline(run: Manifest, *, own: bool = False) -> Path:
    """Folder of the baseline of a run unless another is named.

    Args:
        run: its manifest.
        own: only below the working folder; else the one that the package ships where there is none.
    """
    name = run.dataset.name if run.protocol.name == UNNAMED_PROTOCOL else f"{run.dataset.name}-{run.protocol.name}"
    here, shipped = BASELINES / name, shipped_folder("baselines") / name
    return here if own or here.is_dir() or not shipped.is_dir() else shipped


def read_baseline(folder: Path) -> RunSums:
    """Read a baseline, which may be the folder of a run.

    Raises:
        DataError: not a baseline; names file and field.
    """
    if any(folder.glob(f"*/{SUMMARY}")):
        folder = results_folder(folder)
    manifest = read_manifest(folder)
    if manifest is None:
        hint = "name the folder of a baseline or of a run"
        raise DataError(folder, expected=f"a folder with {SUMS} and {MANIFEST}", got=f"no {MANIFEST}", hint=hint)
    return RunSums(manifest=manifest, sums=read_sums(folder / SUMS))


def write_baseline(run: RunSums, folder: Path) -> None:
    """Store the sums of a run as the baseline.

    Raises:
        UsageError: the folder is that of a run, or the run has failures.
    """
    if any((folder / name).exists() for name in (SUMMARY, ANSWERS_MANIFEST)):
        raise UsageError(f"{folder}: expected a folder for a baseline, got that of a run; name another with --baseline")
    if run.failures:
        count = len(run.failures)
        raise UsageError(f"a run with failures makes no baseline; this one has {count}, the first: {run.failures[0]}")
    write_sums(run.sums, folder / SUMS)
    write_manifest(folder / MANIFEST, run.manifest)


def how_to_compare(baseline: Manifest, run: Manifest, *, folder: Path) -> tuple[str, ...]:
    """Lines that tell how to make the baseline's run again and compare it with a run, with pictures of what changed.

    Args:
        baseline: which is sums only, without images.
        run: that was judged.
        folder: of that run.

    Returns:
        What to do, and two commands; none where the run is of other data.
    """
    if baseline.dataset.recordings != run.dataset.recordings:
        return ()
    was, method = baseline.code, baseline.method
    with_code = [f"the benchmark of {was.text}"] if was.text != run.code.text else []
    if not method.is_own and method.name == run.method.name and method.code_digest != run.method.code_digest:
        with_code.append(f"the code that {method.name!r} had then")
    place = f", with {' and '.join(with_code)}" if with_code else ""
    protocol = baseline.protocol.name
    rules = protocol if protocol in known_protocols() else str(folder / "protocol.json")
    words = ["run", run.dataset.card, *method.options(), "--protocol", rules]
    words += ["--split", baseline.dataset.split] if baseline.dataset.split is not None else []
    again = shlex.join(["fisheye-bench", *words, "--out", BASELINE_RUN, "--no-pictures", "--overwrite"])
    compare = shlex.join(["fisheye-bench", "compare", BASELINE_RUN, str(folder)])
    return f"to compare image by image, repeat the baseline's run{place}:", f"  {again}", f"  {compare}"
