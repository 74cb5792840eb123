"""`evaluate`: masks or scores of any program, scored."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from bench.cli import options
from bench.cli.console import note, show
from bench.cli.progress import progress_bar
from bench.errors import UsageError

if TYPE_CHECKING:
    from bench.methods.predictions import PredictionIndex


def evaluate(
    dataset: options.Dataset,
    predictions: Annotated[Path, typer.Option(help="Folder of masks or scores: [recording/]camera/<name>.png ...")],
    name: Annotated[str | None, typer.Option(help="What results call them; default: predictions-<folder>.")] = None,
    missing: Annotated[
        Literal["error", "skip", "empty"],
        typer.Option(help="Images without a prediction: refuse, leave unscored, or count as empty."),
    ] = "error",
    names: Annotated[
        Literal["auto", "timestamp", "frame", "image"],
        typer.Option(help="What files are named by; default: found out."),
    ] = "auto",
    threshold: Annotated[float | None, typer.Option(help="Score above which a pixel moves; default: 0.5.")] = None,
    history: Annotated[
        int, typer.Option(help="Score images with this many before them; 1 as methods that compare two.")
    ] = 1,
    reference: Annotated[
        Path | None, typer.Option(help="Folder of `reference export`, to score by what it holds; default: the data.")
    ] = None,
    protocol: options.ProtocolName = "paper-v1",
    split: options.Split = None,
    out: Annotated[
        str | None,
        typer.Option(
            metavar="FOLDER",
            help="Folder of the run; default: reports/runs/<data set>-NAME.",
        ),
    ] = None,
    overwrite: options.Overwrite = False,
    pictures: options.Pictures = True,
    workers: options.Workers = None,
    cache: options.Cache = None,
    no_cache: options.NoCache = False,
    scheduler: options.Scheduler = None,
) -> None:
    """Score masks or scores that any other program wrote, paired with the images by name."""
    from bench.api.references import open_reference
    from bench.api.runs import run_request
    from bench.cli.request import Computing, render_if_synthetic
    from bench.cli.runs import score
    from bench.harness.predicted import check_predictions, refusal, refused, write_report
    from bench.harness.stored import PREDICTIONS
    from bench.methods import known_methods
    from bench.methods.predictions import PredictedMotion
    from bench.recordings import load_card

    card = load_card(dataset)
    computing = Computing(workers=workers, cache=cache, no_cache=no_cache, scheduler=scheduler)
    called = name or f"predictions-{predictions.resolve().name}"
    if called in known_methods():
        raise UsageError(f"--name: expected another name than those of methods, got {called!r}")
    usual = PredictedMotion(name=called, folder=str(predictions), dataset=str(card.file), split=split)
    method = PredictedMotion(
        name=called,
        folder=str(predictions),
        dataset=str(card.file),
        split=split,
        threshold=threshold,
        missing=missing,
        naming=names,
        history=history,
    )
    chosen = [(option, value) for option, value in method.settings().items() if value != usual.settings()[option]]
    request = run_request(
        card, method, protocols=[protocol], split=split, out=out, overwrite=overwrite, named_by=chosen
    )
    (rules,) = request.runs.values()
    if reference is not None:
        request = replace(request, exported=open_reference(reference, rules=rules))
    if card.remote_root is None and not card.root.is_dir():
        render_if_synthetic(card, split)  # what is there stays as it was when the predictions were made
    with progress_bar(f"reading {predictions}", "recordings") as report:
        found = check_predictions(card, method=method, progress=report)
    _print_check(found)
    if refusal(method, found) is not None:
        listed = Path(mkdtemp(prefix="fisheye-bench-")) / PREDICTIONS  # a new folder: no file of the user's is replaced
        write_report(listed, card, method, found)
        raise refused(method, found, listed_in=listed)
    reads = [predictions, *([] if reference is None else [reference])]
    request = replace(request, executor=computing.executor(card, method, reads=reads), cache=computing.cache_folder)
    (run,) = score(
        request,
        title=f"scoring {called} on {card.name}",
        pictures=pictures,
        finish=lambda run: write_report(run.folder / PREDICTIONS, card, method, found),
    ).values()
    if run.summary.failures:
        raise typer.Exit(options.FAILURES)


def _print_check(found: PredictionIndex) -> None:
    from bench.reporting.findings import prediction_line, prediction_table

    table = prediction_table(found)
    if table is not None:
        show([table])
    note(prediction_line(found))
