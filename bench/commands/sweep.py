"""`sweep`: a run for each of several values of one setting, with one table and one chart."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bench.commands import console, options
from bench.commands.command import Flag, Place, Words
from bench.commands.console import Report
from bench.commands.run import Run, default_folder, run_request
from bench.errors import UsageError
from bench.plain_text import counted

if TYPE_CHECKING:
    from bench.reporting import document

SWEEPS = Path("reports/sweeps")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sweep:
    """Runs for several values of one setting.

    Attributes:
        folder: where they are, each in a folder named after its value.
        runs: by value.
        report: the headline metrics; `numbers` has a row for each value, as a table of pandas.
        files: of the report.
    """

    folder: Path
    runs: Mapping[str, Run]
    report: document.Report
    files: tuple[Path, ...]


def _values(option: str) -> Words:
    """Assignments of an option; several values of one, commas in between, are a list."""

    def parse(texts: list[str] | None) -> dict[str, object]:
        from bench.methods.settings import flat_settings, parse_settings, parse_values

        chosen: dict[str, object] = {}
        for text in texts or ():
            name, equals, written = text.partition("=")
            values = parse_values(name, written) if equals else []
            if len(values) > 1:
                chosen[name] = values
            else:
                chosen |= flat_settings(parse_settings([text], option=option))
        return chosen

    return Words(list[str] | None, parse)


def sweep(
    dataset: options.Dataset,
    method: options.MethodName = "spherical",
    *,
    settings: Annotated[
        Mapping[str, object] | None, typer.Option("--set", metavar="NAME=VALUE,..."), _values("--set")
    ] = None,
    input_errors: Annotated[
        Mapping[str, object] | None, typer.Option("--input-error", metavar="NAME=VALUE,..."), _values("--input-error")
    ] = None,
    protocol: options.Protocol = "surface-v1",
    split: options.Split = None,
    out: Place = None,
    overwrite: Flag = False,
    workers: options.Workers = 1,
    progress: Report | None = None,
) -> Sweep:
    """Score a method for several values of one setting; write a table and a chart.

    Each value is a run in the sweep's folder. An interrupted sweep continues with the same command.

    Args:
        dataset: card, by path or by a name that `fisheye-bench list` shows.
        method: by name, or as "module:Class".
        settings: set a parameter of the method, as YAML; one parameter has several values, separated by commas (from
            Python a list); weights.epipolar names a part of a parameter; repeatable.
        input_errors: as in `run`; one may have several values instead of a parameter.
        protocol: by name or file.
        split: of the data set; None for all of it.
        out: folder of the sweep; default: reports/sweeps/<data set>-<method>-<setting>.
        overwrite: replace different runs in the folders.
        workers: processes, or an executor.
        progress: called with the values done, fractions allowed, and their number.

    Raises:
        UnknownNameError: no data set, method, protocol, split or input error of this name.
        UsageError: no values, or one that the method does not take.
        DataError: nothing of the data set could be used, or a folder holds another run.

    Examples:
        fisheye-bench sweep demo --set threshold=3e-4,6e-4,1e-3
        fisheye-bench sweep demo --input-error pitch_deg=0,0.5,1
    """
    from bench.harness.references import cache_folder
    from bench.harness.run import run_benchmark
    from bench.reporting.run_tables import METHOD_ONLY, sweep_report, write_report_files

    if "," in str(protocol):
        raise UsageError(f"sweep: expected one protocol, got {protocol!r}")
    setting, fixed, choices = _combinations(settings or {}, input_errors or {})
    requests = {
        shown: run_request(
            dataset, method, settings=chosen, protocol=protocol, split=split, input_errors=errors,
            out=None if out is None else Path(out) / _folder_name(shown), overwrite=overwrite,
        )
        for shown, (chosen, errors) in choices.items()
    }  # fmt: skip
    first = next(iter(requests.values()))
    card, name, (rules,) = first.card, first.method.name, first.protocols
    usual = SWEEPS / f"{default_folder(card, name, fixed.items(), split).name}-{setting}"
    folder = usual if out is None else Path(out)
    runs = dict[str, Run]()
    with options.as_executor(workers) as executor:  # of all values, so that workers start once
        options.rendered_card(card, split, executor=executor)
        title = f"scoring {counted(len(requests), 'value')} of {setting}"
        with console.resumable(folder), console.progress_bar(title, "values", progress) as report:
            for number, (value, request) in enumerate(requests.items()):
                asked = replace(request, folder=folder / _folder_name(value), flow_cache=cache_folder() / "flow")

                def share(done: float, of: int, before: int = number) -> None:
                    report(before + done / max(of, 1), len(requests))

                (stored,) = run_benchmark(asked, executor=executor, progress=share).results
                write_report_files(stored)
                runs[value] = Run(folder=stored.folder)
    told = sweep_report(
        setting,
        {value: run.summary for value, run in runs.items()},
        title=f"{setting} of {name} on {card.name} by {rules.name}",
        note=METHOD_ONLY if any(request.input_errors.named for request in requests.values()) else "",
    )
    return Sweep(folder=folder, runs=runs, report=told, files=told.write(folder, "sweep"))


def _combinations(
    settings: Mapping[str, object], input_errors: Mapping[str, object]
) -> tuple[str, dict[str, object], dict[str, tuple[dict[str, object], dict[str, object]]]]:
    """The name that has several values, what is fixed beside it, and settings and input errors for each of the values.

    Raises:
        UsageError: none or two have several values, or a group of settings is a value, too.
    """
    from bench.methods.settings import flat_settings, nested_settings

    given = flat_settings(settings), flat_settings(input_errors)
    several = [(side, name) for side in given for name, value in side.items() if isinstance(value, list)]
    if len(several) != 1:
        expected = "one --set or --input-error with several values, as --set threshold=3e-4,6e-4,1e-3"
        raise UsageError(f"sweep: expected {expected}, got {len(several)}")
    ((swept, name),) = several
    values: Any = swept.pop(name)
    if not values:
        raise UsageError(f"sweep: expected values of {name}, got none")
    fixed = given[0] | given[1]
    choices = {}
    for value in values:
        chosen, errors = (nested_settings(side | ({name: value} if side is swept else {})) for side in given)
        choices[value if isinstance(value, str) else json.dumps(value, default=str)] = chosen, errors
    return name, fixed, choices


def _folder_name(value: str) -> str:
    """Name of the folder of a value's run."""
    from bench.reporting.formats import file_name

    return file_name(value).lstrip(".") or "_"


def show(swept: Sweep) -> int:
    """Print the table, what failed, and the files."""
    console.say(swept.report.title, style="bold")
    console.print_blocks(swept.report.blocks)
    failures = [f"{value}: {failure}" for value, run in swept.runs.items() for failure in run.summary.failures]
    console.print_failures(failures, all_in=f"the summary.json of each value in {swept.folder}")
    asked = sum(run.summary.provenance.images_asked for run in swept.runs.values())
    console.note(f"{counted(len(swept.runs), 'value')}; {counted(asked, 'image')} answered, the others were there")
    console.note_files(swept.files)
    return console.FAILURES if failures else 0
