"""`evaluate`: masks or scores of any program, scored."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from bench.commands import options
from bench.commands.command import PATH, TEXT, Place
from bench.commands.console import Verbosity, note, note_blocks, verbosity
from bench.commands.progress import Report, progress_bar
from bench.commands.runs import PROTOCOLS, Run, print_runs, score
from bench.errors import UsageError

if TYPE_CHECKING:
    from bench.methods.predictions import PredictionIndex


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evaluation:
    """Predictions from disk, scored.

    Attributes:
        run: the results by the first protocol.
        found: which predictions are there, and what is wrong with others.
    """

    run: Run
    found: PredictionIndex


def evaluate(
    dataset: options.Dataset,
    predictions: Annotated[
        str | Path, typer.Option(help="Folder of masks or scores: [recording/]camera/<name>.png"), PATH
    ],
    *,
    name: Annotated[str | None, typer.Option(help="Name in results; default: predictions-<folder>.")] = None,
    missing: Annotated[
        Literal["error", "skip", "empty"],
        typer.Option(help="Images without a prediction: refuse, leave unscored, or count as empty."),
    ] = "error",
    threshold: Annotated[
        float | None, typer.Option(help="Score above which a pixel counts as moving; default: 0.5.")
    ] = None,
    protocol: options.Protocols = PROTOCOLS,
    split: options.Split = None,
    out: Annotated[
        Place, typer.Option(metavar="FOLDER", help="Folder of the run; default: reports/runs/<data set>-NAME."), TEXT
    ] = None,
    overwrite: options.Overwrite = False,
    pictures: options.Pictures = True,
    workers: options.Workers = 1,
    progress: Report | None = None,
) -> Evaluation:
    """Score masks or scores that another program wrote; files are paired with images by name.

    Args:
        dataset: card, by path or by name.
        predictions: folder.
        name: None for predictions-<folder>.
        missing: "error" to score nothing, "skip" to leave these images unscored, "empty" to count them as empty.
        threshold: None for 0.5.
        protocol: names or files with commas in between.
        split: of the data set.
        out: folder of the run.
        overwrite: replace another run in the folder.
        pictures: also draw an example frame of every category.
        workers: processes, or an executor.
        progress: called with the images done and their number.

    Raises:
        UnknownNameError: no data set, protocol or split of this name.
        UsageError: the name of a method, or a threshold for masks.
        DataError: a prediction is missing, damaged or extra where all are asked for; or `out` holds another run.
    """
    from bench.commands.data import as_card, as_executor, rendered_card
    from bench.commands.runs import default_folder, run_request
    from bench.harness.stored import PREDICTIONS
    from bench.methods import known_methods
    from bench.methods.predictions import PredictedMotion
    from bench.methods.predictions.method import check_predictions, refuse_faults, write_report
    from bench.reporting.findings import prediction_line, prediction_table

    if not Path(predictions).is_dir():
        raise UsageError(f"--predictions: expected a folder of masks or scores, got {predictions}, which is none")
    card, called = as_card(dataset), name or f"predictions-{Path(predictions).resolve().name}"
    if called in known_methods():
        raise UsageError(f"--name: expected another name than those of methods, got {called!r}")
    method = PredictedMotion(
        name=called,
        folder=str(predictions),
        dataset=str(card.file),
        split=split,
        threshold=threshold,
        missing=missing,
    )
    given = (("threshold", threshold, None), ("missing", missing, "error"))
    chosen = [(option, value) for option, value, usual in given if value != usual]
    place = default_folder(card, called, chosen, split) if out is None else out
    request = run_request(card, method, protocol=protocol, split=split, out=place, overwrite=overwrite)
    executor = as_executor(workers)
    rendered_card(card, split, executor=executor, as_it_is=True)
    with progress_bar(f"reading {predictions}", "recordings") as report:
        found = check_predictions(card, method=method, progress=report)
    if (table := prediction_table(found, whole=verbosity() is Verbosity.VERBOSE)) is not None:
        note_blocks([table])
    note(prediction_line(found, threshold=method.threshold))
    refuse_faults(method, found)
    scored = score(
        request,
        executor=executor,
        pictures=pictures,
        finish=lambda run: write_report(run.folder / PREDICTIONS, card, method, found),
        progress=progress,
    )
    return Evaluation(run=scored, found=found)


def show(evaluation: Evaluation) -> int:
    """Print the run."""
    return print_runs(evaluation.run)
