"""Input of the gate: the sums of a run and its manifest. The same two files, committed, are a baseline."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from bench.errors import DataError, UsageError
from bench.evaluation import read_sums, write_sums
from bench.harness import read_run
from bench.harness.digests import short_digest
from bench.harness.manifest import MANIFEST, Manifest, read_manifest, write_manifest
from bench.harness.stored import SUMMARY, SUMS, refuse_unscored, results_folder
from bench.recordings.cards import shipped_folder

BASELINES = Path("reports/baselines")
USUAL_PROTOCOL = "paper-v1"


class MissingBaselineError(UsageError):
    """There is no baseline to judge by, which is never a pass."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        super().__init__(f"{folder}: no baseline there, so nothing was judged; make one with --update")

    def __reduce__(self) -> tuple[object, ...]:
        return MissingBaselineError, (self.folder,)


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
    refuse_unscored(stored.summary, run)
    return RunSums(
        manifest=stored.manifest,
        sums=stored.sums,
        failures=stored.summary.failures,
        unreviewed=stored.summary.unreviewed,
    )


def own_baseline(run: Manifest) -> Path:
    """Folder of a run's own baseline unless another folder is named, below the working folder."""
    words = [run.dataset.name, *([] if run.protocol.name == USUAL_PROTOCOL else [run.protocol.name])]
    return BASELINES / "-".join(words)


def find_baseline(run: Manifest) -> Path:
    """Folder that a run is judged by unless another is named: its own baseline, else one that the package ships."""
    own = own_baseline(run)
    shipped = shipped_folder("baselines") / own.name
    return shipped if shipped.is_dir() and not own.is_dir() else own


def read_baseline(folder: Path) -> RunSums:
    """Read a baseline, which may be the folder of a run.

    Raises:
        MissingBaselineError: no such folder.
        DataError: not a baseline; names file and field.
    """
    if not folder.exists():
        raise MissingBaselineError(folder)
    if any(folder.glob(f"*/{SUMMARY}")):
        folder = results_folder(folder)
    manifest = read_manifest(folder)
    if manifest is None:
        hint = "name the folder of a baseline or of a run"
        raise DataError(folder, expected=f"a folder with {SUMS} and {MANIFEST}", got=f"no {MANIFEST}", hint=hint)
    return RunSums(manifest=manifest, sums=read_sums(folder / SUMS))


def write_baseline(run: RunSums, folder: Path, *, allow_dirty: bool = False) -> None:
    """Store the sums of a run as the baseline.

    Raises:
        UsageError: the folder is that of a run, the run has failures, or it was made by code that no commit holds and
            `allow_dirty` is not set.
    """
    if (folder / SUMMARY).exists():
        raise UsageError(f"{folder}: expected a folder for a baseline, got that of a run, which would be overwritten")
    if run.failures:
        count = len(run.failures)
        raise UsageError(f"a run with failures makes no baseline; this one has {count}, the first: {run.failures[0]}")
    for whose, commit in (("", run.manifest.code.commit), ("the method's ", run.manifest.method.commit)):
        if commit is not None and commit.endswith("+") and not allow_dirty:
            raise UsageError(
                f"when it ran, {whose}files were changed on top of commit {short_digest(commit.rstrip('+'))}, which "
                "nobody can repeat; commit them and run again, or say --allow-dirty"
            )
    if not (run.manifest.method.is_own or run.manifest.method.commit or allow_dirty):
        raise UsageError(
            f"the code of method {run.manifest.method.name!r} is in no commit, so that nobody can repeat the run; "
            "commit it and run again, or say --allow-dirty"
        )
    write_sums(run.sums, folder / SUMS)
    write_manifest(folder / MANIFEST, run.manifest)
