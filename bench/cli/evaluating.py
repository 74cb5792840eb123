"""`evaluate`: masks or scores of any program, scored."""

from __future__ import annotations

from pathlib import Path

from bench.api.runs import default_folder, run_folder
from bench.cli.computing import Computing, render_if_synthetic
from bench.cli.console import note, progress_bar, show
from bench.cli.interrupts import resumable
from bench.cli.running import RunReport
from bench.errors import UsageError
from bench.evaluation import load_protocol
from bench.harness import PredictionReport, RunRequest, check_predictions, evaluate_predictions
from bench.harness.predicted import write_report
from bench.methods import known_methods
from bench.methods.predictions import MissingPolicy, Naming, PredictedMotion
from bench.recordings import load_card
from bench.reporting.prediction_table import prediction_line, prediction_table


def evaluate(
    dataset: str,
    *,
    predictions: Path,
    name: str | None,
    missing: MissingPolicy,
    naming: Naming,
    threshold: float | None,
    history: int,
    protocol: str,
    split: str | None,
    out: str | None,
    overwrite: bool,
    pictures: bool,
    computing: Computing,
) -> int:
    """Check a folder of predictions, score it, write the report; return the number of failures.

    Raises:
        DataError: the predictions do not fit; what does not is printed and listed in a file.
    """
    card, rules = load_card(dataset), load_protocol(protocol)
    called = name or f"predictions-{predictions.resolve().name}"
    if called in known_methods():
        raise UsageError(f"--name: expected another name than those of methods, got {called!r}")
    method = PredictedMotion(
        name=called,
        folder=str(predictions),
        dataset=str(card.file),
        split=split,
        threshold=threshold,
        missing=missing,
        naming=naming,
        history=history,
    )
    usual = {"missing": "error", "naming": "auto", "history": 1, "threshold": None}
    chosen = [(option, value) for option, value in method.settings().items() if value != usual.get(option, value)]
    folder = default_folder(card, called, chosen, rules, split) if out is None else run_folder(out)
    listed = folder.with_name(f"{folder.name}-predictions.json")
    if card.remote_root is None and not card.root.is_dir():
        render_if_synthetic(card)  # what is there stays as it was when the predictions were made
    with progress_bar(f"reading {predictions}", "recordings") as report:
        checked = check_predictions(card, method=method, progress=report)
    _print_check(checked)
    if checked.refusal is not None:
        write_report(listed, checked)
        raise checked.refuse(listed)
    listed.unlink(missing_ok=True)  # of an earlier refusal
    finished = RunReport(card=card, protocol=rules, pictures=pictures)
    with resumable(folder):
        with progress_bar(f"scoring {called} on {card.name}", "images") as report:
            request = RunRequest(
                card=card,
                method=method,
                protocol=rules,
                out=folder,
                split=split,
                overwrite=overwrite,
                executor=computing.executor(card, method, reads=[predictions]),
                cache=computing.cache_folder,
                progress=report,
            )
            summary = evaluate_predictions(request, checked, finish=finished.write)
        finished.print(summary, folder)
    return len(summary.failures)


def _print_check(report: PredictionReport) -> None:
    table = prediction_table(report)
    if table is not None:
        show([table])
    note(prediction_line(report))
