"""`sweep`: a run for each of several values of one setting, with one table and one chart."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.cli import options
from bench.cli.console import note, note_files, print_failures, show
from bench.cli.progress import progress_bar, resumable
from bench.errors import UsageError

if TYPE_CHECKING:
    from bench.harness import RunRequest

SWEEPS = Path("reports/sweeps")


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
    cache: options.Cache = None,
    no_cache: options.NoCache = False,
) -> None:
    """Score a method once for each of several values of one setting: a table and a chart.

    Each value is a run in a folder of the sweep. A sweep that was interrupted continues where it stopped, by the same
    command.
    """
    from bench.api.sweep import run_values
    from bench.atomic import output_folder
    from bench.cli.request import Computing, rendered_card, scoring_request
    from bench.reporting.sweep import METHOD_ONLY, table, write_sweep

    if "," in protocol:
        raise UsageError(f"sweep: expected one protocol, got {protocol!r}")
    setting, choices = one_for_each_value(set_ or [], input_error or [])
    computing = Computing(workers=workers, cache=cache, no_cache=no_cache)
    requests = {
        value: computing.equip(
            scoring_request(
                dataset,
                method,
                settings=settings,
                input_errors=input_errors,
                protocol=protocol,
                split=split,
                out=out,
                overwrite=overwrite,
            )
        )
        for value, (settings, input_errors) in choices.items()
    }
    first = next(iter(requests.values()))
    (rules,) = first.runs.values()
    folder = SWEEPS / _usual_name([*(set_ or []), *(input_error or [])], first, setting) if out is None else out
    title = f"{setting} of {first.method.name} on {first.card.name} by {rules.name}"
    about = METHOD_ONLY if any(request.input_errors.named for request in requests.values()) else ""
    with output_folder(folder):
        rendered_card(first.card, first.split)
        with resumable(folder), progress_bar(f"scoring {len(requests)} values of {setting}", "values") as progress:
            runs = run_values(requests, folder, progress=progress)
    files = write_sweep(folder, setting, runs, title=title, note=about)
    show([table(setting, runs, title=title, note=about)])
    failures = [f"{value}: {failure}" for value, summary in runs.items() for failure in summary.failures]
    print_failures(failures, all_in=f"the summary.json of each value in {folder}")
    works = [summary.provenance.work for summary in runs.values() if summary.provenance.work is not None]
    computed, reused = sum(work.units_computed for work in works), sum(work.units_reused for work in works)
    note(f"{len(runs)} values; units computed {computed}, found done {reused}")
    note_files(files)
    if failures:
        raise typer.Exit(options.FAILURES)


def one_for_each_value(
    settings: Sequence[str], input_errors: Sequence[str]
) -> tuple[str, dict[str, tuple[Sequence[str], Sequence[str]]]]:
    """Find the setting or input error with several values; its name, and by value the settings and errors of a run.

    Raises:
        UsageError: none or two of them, or values that are no YAML.
    """
    from bench.methods.settings import split_values

    assigned = [*settings, *input_errors]
    found = []
    for place, text in enumerate(assigned):
        name, _, values = text.partition("=")
        chosen = split_values(name, values)
        if len(chosen) > 1:
            found.append((place, name, chosen))
    if len(found) != 1:
        expected = "one --set or --input-error with several values, as --set threshold=3e-4,6e-4,1e-3"
        raise UsageError(f"sweep: expected {expected}, got {len(found)}")
    ((place, name, chosen),) = found
    of_values = {
        shown: [*assigned[:place], f"{name}={value}", *assigned[place + 1 :]] for shown, value in chosen.items()
    }
    return name, {shown: (one[: len(settings)], one[len(settings) :]) for shown, one in of_values.items()}


def _usual_name(assigned: Sequence[str], request: RunRequest, setting: str) -> str:
    """Data set, method, what else is not the default, and the setting that is swept."""
    from bench.api.runs import default_folder

    pairs = (text.partition("=") for text in assigned)
    fixed = [(name, value) for name, _, value in pairs if name != setting]
    (rules,) = request.runs.values()
    return f"{default_folder(request.card, request.method.name, fixed, rules, request.split).name}-{setting}"
