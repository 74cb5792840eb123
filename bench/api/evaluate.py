"""Masks or scores of any program, scored."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import mkdtemp

from bench.api.datasets import as_card, as_executor, rendered_card
from bench.api.run_report import score_with_reports
from bench.api.runs import DEFAULT_PROTOCOL, Run, run_request
from bench.errors import UsageError
from bench.execution import TaskExecutor
from bench.harness import RunRequest
from bench.harness.run import Finish
from bench.harness.stages import Progress
from bench.harness.stored import PREDICTIONS
from bench.methods import known_methods
from bench.methods.predictions import MissingPolicy, Naming, PredictedMotion, PredictionIndex
from bench.methods.predictions.report import check_predictions, refusal, refused, write_report
from bench.recordings import DatasetCard


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evaluation:
    """Predictions from disk, scored.

    Attributes:
        run: as it is stored.
        found: which predictions are there, and what is wrong with others.
    """

    run: Run
    found: PredictionIndex


def evaluate(
    dataset: str | Path | DatasetCard,
    predictions: str | Path,
    *,
    name: str | None = None,
    missing: MissingPolicy = "error",
    names: Naming = "auto",
    threshold: float | None = None,
    history: int = 1,
    protocol: str | Path = DEFAULT_PROTOCOL,
    split: str | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    pictures: bool = False,
    workers: int | TaskExecutor = 1,
    progress: Progress | None = None,
) -> Evaluation:
    """Score masks or scores that any other program wrote, as `fisheye-bench evaluate` does.

    Args:
        dataset: card, by path or by a name that `fisheye-bench list` shows.
        predictions: folder of masks or scores, paired with the images by name: [recording/]camera/<name>.png, ...
        name: what results call them; None for predictions-<folder>.
        missing: what becomes of images without a prediction: "error" to score nothing, "skip" to leave them unscored,
            "empty" to count them as empty.
        names: what files are named by: "timestamp", "frame" or "image"; "auto" to find it out.
        threshold: score above which a pixel moves; None for 0.5.
        history: score images with this many before them; 1 as methods that compare two.
        protocol: by name or file.
        split: of the data set; None for all of it.
        out: folder of the run; None for `reports/runs/<data set>-<name>`.
        overwrite: replace another run in the folder.
        pictures: also draw an example frame of every category.
        workers: processes, or an executor.
        progress: called with the images done and their number.

    Raises:
        UnknownNameError: no data set, protocol or split of this name.
        UsageError: the name of a method, ambiguous names of files, or a threshold for masks.
        DataError: a prediction is missing, damaged or extra where all are asked for; the error names a file that lists
            all of them; or `out` holds another run.
    """
    request, method = evaluate_request(
        dataset,
        predictions,
        name=name,
        missing=missing,
        names=names,
        threshold=threshold,
        history=history,
        protocol=protocol,
        split=split,
        out=out,
        overwrite=overwrite,
    )
    executor = as_executor(workers)
    rendered_card(request.card, split, executor=executor, as_it_is=True)
    found = check_predictions(request.card, method=method)
    refuse_unfit(request.card, method, found)
    asked = replace(request, executor=executor, progress=progress)
    ((stored, _),) = score_with_reports(
        asked, pictures=pictures, finish=predictions_report(request.card, method, found)
    )
    return Evaluation(run=Run(stored=stored), found=found)


def evaluate_request(
    dataset: str | Path | DatasetCard,
    predictions: str | Path,
    *,
    name: str | None,
    missing: MissingPolicy,
    names: Naming,
    threshold: float | None,
    history: int,
    protocol: str | Path,
    split: str | None,
    out: str | Path | None,
    overwrite: bool,
) -> tuple[RunRequest, PredictedMotion]:
    """Assemble the run of predictions, and the method that gives them out; their folder is not looked at yet.

    Arguments and errors are those of `evaluate`.
    """
    card, called = as_card(dataset), name or f"predictions-{Path(predictions).resolve().name}"
    if called in known_methods():
        raise UsageError(f"--name: expected another name than those of methods, got {called!r}")
    named = partial(PredictedMotion, name=called, folder=str(predictions), dataset=str(card.file), split=split)
    usual = named().settings()
    method = named(threshold=threshold, missing=missing, naming=names, history=history)
    chosen = [(option, value) for option, value in method.settings().items() if value != usual[option]]
    request = run_request(
        card, method, protocols=[protocol], split=split, out=out, overwrite=overwrite, named_by=chosen
    )
    return request, method


def refuse_unfit(card: DatasetCard, method: PredictedMotion, found: PredictionIndex) -> None:
    """Refuse a folder that is not to be scored.

    Raises:
        DataError: something is missing, damaged or extra; the error names a file that lists all of it.
    """
    if refusal(method, found) is not None:
        listed = Path(mkdtemp(prefix="fisheye-bench-")) / PREDICTIONS  # a new folder: no file of the user's is replaced
        write_report(listed, card, method, found)
        raise refused(method, found, listed_in=listed)


def predictions_report(card: DatasetCard, method: PredictedMotion, found: PredictionIndex) -> Finish:
    """Writes how the predictions fit the data set beside the results of a run."""
    return lambda run: write_report(run.folder / PREDICTIONS, card, method, found)
