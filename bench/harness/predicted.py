"""Predictions from disk, scored: what was paired, what was not, and whether it may be scored."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict

from bench.atomic import write_text
from bench.errors import DataError
from bench.harness.run import Finish, RunRequest, run_benchmark
from bench.harness.stored import PREDICTIONS, RunSummary
from bench.methods.predictions import FaultKind, PredictedMotion, PredictionIndex, index_predictions
from bench.recordings import DatasetCard

SCHEMA_VERSION = 1


class StoredFault(BaseModel):
    """A fault: the file or image, and the reason."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    place: str
    reason: str


class PredictionReport(BaseModel):
    """`predictions.json`: how a folder of predictions fits a data set.

    Attributes:
        schema_version: of this file.
        dataset: name of the data set.
        split: of it; None for all.
        folder: of the predictions, as it was named.
        form: masks or scores.
        digest: SHA-256 over the usable predictions' images and the content of their files.
        expected: images that will be scored.
        usable: predictions of these that can be read.
        unscored: predictions of images that are not scored.
        elsewhere: files of recordings that are not scored.
        unread: files of many images that cannot be read.
        missing_policy: what becomes of images without a prediction.
        faults: by kind, all that is wrong.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    schema_version: int
    dataset: str
    split: str | None
    folder: str
    form: Literal["mask", "score"]
    digest: str
    expected: int
    usable: int
    unscored: int
    elsewhere: int
    unread: tuple[str, ...]
    missing_policy: str
    faults: dict[str, tuple[StoredFault, ...]]

    def count(self, kind: FaultKind) -> int:
        """Return the number of faults of a kind."""
        return len(self.faults[kind.value])

    @property
    def refusal(self) -> str | None:
        """Reason to score nothing: any fault where every prediction is required, else a file of unknown images only."""
        if self.missing_policy != "error":
            return (
                f"{', '.join(self.unread)}, which cannot be read, so that nobody knows of which images"
                if self.unread
                else None
            )
        return ", ".join(f"{self.count(kind)} {kind.value}" for kind in FaultKind if self.count(kind)) or None

    def refuse(self, listed_in: Path) -> DataError:
        """The error of a folder that is not scored."""
        hint = "fix these files"
        if self.missing_policy == "error":
            hint = "fix them; --missing skip leaves images without one out, --missing empty counts them, and neither "
            hint += "looks at what is extra"
        got = f"{self.refusal}; all of them in {listed_in}"
        return DataError(
            self.folder,
            expected=f"a prediction of each of {self.expected} images, and nothing else",
            got=got,
            hint=hint,
        )


def check_predictions(
    card: DatasetCard, *, method: PredictedMotion, progress: Callable[[float, int], None] | None = None
) -> PredictionReport:
    """Go through the method's folder; the method then uses what was found.

    Args:
        card: the data set.
        method: with the folder.
        progress: called with the recordings done and their number.

    Raises:
        DataError: the folder is missing, or what is in it is no set of predictions.
        UsageError: ambiguous names, or a threshold for masks.
    """
    found = index_predictions(
        Path(method.folder),
        card,
        split=method.split,
        naming=method.naming,
        history=method.history,
        progress=progress,
    )
    method.use(found)
    return _report(card, method, found)


def evaluate_predictions(request: RunRequest, report: PredictionReport, *, finish: Finish | None = None) -> RunSummary:
    """Score predictions and store the run, with the report as `predictions.json` in it.

    Args:
        request: one run; its method is the one whose folder was gone through.
        report: of that folder.
        finish: see `run_benchmark`.

    Raises:
        DataError: the data set is not there, nothing of it could be used, or the folder holds something that is no run.
    """

    def finished(results: Path, summary: RunSummary) -> None:
        write_report(results / PREDICTIONS, report)
        if finish is not None:
            finish(results, summary)

    (summary,) = run_benchmark(request, finish=finished).values()
    return summary


def write_report(file: Path, report: PredictionReport) -> None:
    """Write the report, atomically."""
    write_text(file, report.model_dump_json(indent=1) + "\n")


def _report(card: DatasetCard, method: PredictedMotion, found: PredictionIndex) -> PredictionReport:
    return PredictionReport(
        schema_version=SCHEMA_VERSION,
        dataset=card.name,
        split=method.split,
        folder=method.folder,
        form=found.form,
        digest=found.digest,
        expected=found.expected,
        usable=len(found.usable),
        unscored=found.unscored,
        elsewhere=found.elsewhere,
        unread=found.unread,
        missing_policy=method.missing,
        faults={
            kind.value: tuple(StoredFault(place=one.place, reason=one.reason) for one in found.of_kind(kind))
            for kind in FaultKind
        },
    )
