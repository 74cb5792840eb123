"""`evaluate`: masks or scores of any program, scored."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from bench.cli import options
from bench.cli.console import note, show
from bench.cli.progress import progress_bar


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
    scheduler: options.Scheduler = None,
) -> None:
    """Score masks or scores that any other program wrote, paired with the images by name."""
    from bench.api.evaluate import evaluate_request, predictions_report, refuse_unfit
    from bench.cli.request import equip, rendered_card
    from bench.cli.runs import score
    from bench.methods.predictions.report import check_predictions
    from bench.reporting.findings import prediction_line, prediction_table

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
    card = rendered_card(request.card, split, as_it_is=True)
    with progress_bar(f"reading {predictions}", "recordings") as report:
        found = check_predictions(card, method=method, progress=report)
    if (table := prediction_table(found)) is not None:
        show([table])
    note(prediction_line(found, threshold=method.threshold))
    for doubt in found.doubts:
        note(f"warning: {doubt}")
    refuse_unfit(card, method, found)
    request = equip(request, workers=workers, scheduler=scheduler)
    (run,) = score(
        request,
        title=f"scoring {method.name} on {card.name}",
        pictures=pictures,
        finish=predictions_report(card, method, found),
    )
    if run.summary.failures:
        raise typer.Exit(options.FAILURES)
