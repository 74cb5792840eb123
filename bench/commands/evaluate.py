"""`evaluate`: masks or scores of any program, scored."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from bench.commands import options
from bench.commands.command import PATH, Flag
from bench.commands.console import Report, Verbosity, note, print_blocks, progress_bar, verbosity
from bench.commands.run import PROTOCOLS, Run, RunFolder, default_folder, print_runs, run_request, score
from bench.errors import UsageError


def evaluate(
    dataset: options.Dataset,
    predictions: Annotated[str | Path, typer.Option(), PATH],
    *,
    name: Annotated[str | None, typer.Option()] = None,
    missing: Annotated[Literal["error", "skip", "empty"], typer.Option()] = "error",
    threshold: Annotated[float | None, typer.Option()] = None,
    protocol: options.Protocols = PROTOCOLS,
    split: options.Split = None,
    out: RunFolder = None,
    overwrite: Flag = False,
    pictures: Flag = True,
    workers: options.Workers = 1,
    progress: Report | None = None,
) -> Run:
    """Score masks or scores that another program wrote; files are paired with images by name.

    Args:
        dataset: card, by path or by name.
        predictions: folder of masks or scores: [recording/]camera/<name>.png.
        name: name in results; default: predictions-<folder>.
        missing: images without a prediction: refuse, leave unscored, or count as empty.
        threshold: score above which a pixel counts as moving; default: 0.5.
        protocol: names or files with commas in between.
        split: of the data set.
        out: folder of the run; default: reports/runs/<data set>-NAME.
        overwrite: replace a different run in the folder.
        pictures: draw an example image of every category.
        workers: processes, or an executor.
        progress: called with the images done and their number.

    Returns:
        The results by the first protocol, as `bench.run`; how the predictions fit is in `predictions.json` beside them.

    Raises:
        UnknownNameError: no data set, protocol or split of this name.
        UsageError: the name of a method, or a threshold for masks.
        DataError: a prediction is missing, damaged or extra where all are asked for; or `out` holds another run.

    Examples:
        fisheye-bench evaluate demo --predictions my-scores --threshold 0.7 --missing empty --name my-network
    """
    from bench.harness.stored import PREDICTIONS
    from bench.methods import known_methods
    from bench.methods.predictions import PredictedMotion
    from bench.methods.predictions.method import refuse_faults, write_report
    from bench.methods.predictions.pairing import index_predictions
    from bench.reporting.findings import prediction_line, prediction_table

    if not Path(predictions).is_dir():
        raise UsageError(f"--predictions: expected a folder of masks or scores, got {predictions}, which is no folder")
    card, called = options.as_card(dataset), name or f"predictions-{Path(predictions).resolve().name}"
    if called in known_methods():
        raise UsageError(f"--name: expected another name than those of methods, got {called!r}")
    method = PredictedMotion(
        name=called, folder=str(predictions), dataset=str(card.file), split=split, threshold=threshold, missing=missing
    )
    given = (("threshold", threshold, None), ("missing", missing, "error"))
    chosen = [(option, value) for option, value, usual in given if value != usual]
    place = default_folder(card, called, chosen, split) if out is None else out
    request = run_request(card, method, protocol=protocol, split=split, out=place, overwrite=overwrite)
    executor = options.as_executor(workers)
    options.rendered_card(card, split, executor=executor, as_it_is=True)
    with progress_bar(f"reading {predictions}", "recordings") as report:
        found = index_predictions(Path(predictions), card, split=split, progress=report)
    method.use(found)
    if verbosity() > Verbosity.QUIET and (table := prediction_table(found, whole=verbosity() is Verbosity.VERBOSE)):
        print_blocks([table])
    note(prediction_line(found, threshold=method.threshold))
    refuse_faults(method, found)
    scored = score(request, executor=executor, pictures=pictures, progress=progress)
    for run in (scored, *scored.others):
        write_report(run.folder / PREDICTIONS, card, method, found)
    return scored


show = print_runs
