"""`sweep`: a run for each of several values of one setting, with one table and one chart."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from bench.cli import options
from bench.cli.console import note, note_files, print_failures, show
from bench.cli.progress import progress_bar, resumable
from bench.errors import UsageError


def sweep(
    dataset: options.Dataset,
    method: options.MethodName = "spherical",
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE,...",
            help="A parameter of the method, as YAML; one of them with several values, commas in between; repeatable.",
        ),
    ] = None,
    input_error: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE,...", help="As of `run`; one may have several values in place of a parameter."
        ),
    ] = None,
    protocol: options.ProtocolName = "paper-v1",
    split: options.Split = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of the sweep; default: reports/sweeps/<data set>-<method>-<setting>."),
    ] = None,
    overwrite: options.Overwrite = False,
    workers: options.Workers = None,
) -> None:
    """Score a method once for each of several values of one setting: a table and a chart.

    Each value is a run in a folder of the sweep. A sweep that was interrupted continues where it stopped, by the same
    command.
    """
    from bench.api.sweep import run_sweep, sweep_request
    from bench.atomic import output_folder
    from bench.cli.request import rendered_card, worker_processes
    from bench.methods.settings import parse_settings

    if "," in protocol:
        raise UsageError(f"sweep: expected one protocol, got {protocol!r}")
    fixed, fixed_errors, (setting, values, of_input) = split_assigned(set_ or [], input_error or [])
    request = sweep_request(
        dataset,
        setting,
        values,
        method,
        of_input=of_input,
        settings=parse_settings(fixed),
        protocol=protocol,
        split=split,
        input_errors=parse_settings(fixed_errors, option="--input-error"),
        out=out,
        overwrite=overwrite,
    )
    card = next(iter(request.runs.values())).card
    with output_folder(request.folder):
        rendered_card(card, split)
        title = f"scoring {len(request.runs)} values of {setting}"
        with resumable(request.folder), progress_bar(title, "values") as progress:
            executor = worker_processes(workers)
            swept = run_sweep(request, workers=executor, progress=progress)
    show([swept.table])
    failures = [f"{value}: {failure}" for value, run in swept.runs.items() for failure in run.summary.failures]
    print_failures(failures, all_in=f"the summary.json of each value in {swept.folder}")
    asked = sum(run.summary.provenance.images_asked for run in swept.runs.values())
    note(f"{len(swept.runs)} values; {asked} images answered, the others were there")
    note_files(swept.files)
    if failures:
        raise typer.Exit(options.FAILURES)


def split_assigned(
    settings: Sequence[str], input_errors: Sequence[str]
) -> tuple[list[str], list[str], tuple[str, dict[str, object], bool]]:
    """Split assignments into those of one value and the one with several.

    Returns:
        The settings and the input errors with one value; then name and values of the other, by what is shown of them,
        and True for an input error.

    Raises:
        UsageError: none or two with several values, or values that are no YAML.
    """
    from bench.methods.settings import parse_settings, split_values

    fixed: tuple[list[str], list[str]] = ([], [])
    several: list[tuple[str, dict[str, object], bool]] = []
    for of_input, texts in enumerate((settings, input_errors)):
        for text in texts:
            name, _, written = text.partition("=")
            chosen = split_values(name, written)
            if len(chosen) > 1:
                values = {shown: parse_settings([f"value={value}"])["value"] for shown, value in chosen.items()}
                several.append((name, values, bool(of_input)))
            else:
                fixed[of_input].append(text)
    if len(several) != 1:
        expected = "one --set or --input-error with several values, as --set threshold=3e-4,6e-4,1e-3"
        raise UsageError(f"sweep: expected {expected}, got {len(several)}")
    return *fixed, several[0]
