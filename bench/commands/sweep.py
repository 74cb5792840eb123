"""`sweep`: a run for each of several values of one setting, with one table and one chart."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bench.commands import options
from bench.commands.command import PATH, Place, Words
from bench.commands.console import FAILURES, note, note_files, print_blocks, print_failures
from bench.commands.progress import Report, progress_bar, resumable
from bench.commands.runs import Run
from bench.errors import UsageError
from bench.plain_text import counted

if TYPE_CHECKING:
    from bench.reporting.document import Table

SWEEPS = Path("reports/sweeps")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sweep:
    """Runs for several values of one setting.

    Attributes:
        folder: where they are, each in a folder named after its value.
        runs: by value.
        table: the headline metrics, a row for each value.
        files: of the sweep: table and chart.
    """

    folder: Path
    runs: Mapping[str, Run]
    table: Table
    files: tuple[Path, ...]


def _values(option: str) -> Words:
    """Assignments of an option; several values of one, commas in between, are a list."""

    def parse(texts: list[str] | None) -> dict[str, object]:
        from bench.methods.settings import flat_settings, parse_settings, split_values

        chosen: dict[str, object] = {}
        for text in texts or ():
            name, equals, written = text.partition("=")
            texts_of = split_values(name, written).values() if equals else ()
            values = [parse_settings([f"value={value}"], option=option)["value"] for value in texts_of]
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
        Mapping[str, object] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE,...",
            help="A parameter of the method, as YAML; one with several values, separated by commas; repeatable.",
        ),
        _values("--set"),
    ] = None,
    input_errors: Annotated[
        Mapping[str, object] | None,
        typer.Option(
            "--input-error",
            metavar="NAME=VALUE,...",
            help="As in `run`; one may have several values instead of a parameter.",
        ),
        _values("--input-error"),
    ] = None,
    protocol: options.ProtocolName = "paper-v1",
    split: options.Split = None,
    out: Annotated[
        Place, typer.Option(help="Folder of the sweep; default: reports/sweeps/<data set>-<method>-<setting>."), PATH
    ] = None,
    overwrite: options.Overwrite = False,
    workers: options.Workers = 1,
    progress: Report | None = None,
) -> Sweep:
    """Score a method for several values of one setting; write a table and a chart.

    Each value is a run in the sweep's folder. An interrupted sweep continues with the same command.

    Args:
        dataset: card, by path or by a name that `fisheye-bench list` shows.
        method: by name, or as "module:Class".
        settings: parameters of the method, one of them, or of `input_errors`, with a list of values; a part of one
            behind a dot, as in "weights.epipolar".
        input_errors: errors of what the method is given, for example "pitch_deg".
        protocol: by name or file.
        split: of the data set; None for all of it.
        out: folder of the sweep; None for `reports/sweeps/<data set>-<method>-<setting>`.
        overwrite: replace other runs in the folders.
        workers: processes, or an executor.
        progress: called with the values done, fractions allowed, and their number.

    Raises:
        UnknownNameError: no data set, method, protocol, split or input error of this name.
        UsageError: no values, or one that the method does not take.
        DataError: nothing of the data set could be used, or a folder holds another run.
    """
    from bench.atomic import output_folder
    from bench.commands.data import as_executor, rendered_card
    from bench.commands.runs import default_folder, run_request
    from bench.harness import run_benchmark
    from bench.harness.references import cache_folder
    from bench.harness.stages import part_of
    from bench.methods.settings import flat_settings
    from bench.reporting.run_tables import METHOD_ONLY, sweep_table, write_report_files, write_sweep

    if "," in str(protocol):
        raise UsageError(f"sweep: expected one protocol, got {protocol!r}")
    setting, choices = _combinations(settings or {}, input_errors or {})
    requests = {
        shown: run_request(
            dataset, method, settings=chosen, protocol=protocol, split=split, input_errors=errors,
            out=None if out is None else Path(out) / _folder_name(shown), overwrite=overwrite,
        )
        for shown, (chosen, errors) in choices.items()
    }  # fmt: skip
    first = next(iter(requests.values()))
    card, name, (rules,) = first.card, first.method.name, first.protocols
    fixed = [
        item for given in (settings, input_errors) for item in flat_settings(given or {}).items() if item[0] != setting
    ]
    folder = SWEEPS / f"{default_folder(card, name, fixed, split).name}-{setting}" if out is None else Path(out)
    runs = dict[str, Run]()
    with output_folder(folder), as_executor(workers) as executor:  # of all values, so that workers start once
        rendered_card(card, split, executor=executor)
        title = f"scoring {len(requests)} values of {setting}"
        with resumable(folder), progress_bar(title, "values", progress) as report:
            for number, (value, request) in enumerate(requests.items()):
                asked = replace(
                    request,
                    folder=folder / _folder_name(value),
                    flow_cache=cache_folder() / "flow",
                )
                part = part_of(report, number=number, total=len(requests))
                (stored,) = run_benchmark(asked, executor=executor, progress=part, finish=write_report_files)
                runs[value] = Run(folder=stored.folder)
    shown = {
        "title": f"{setting} of {name} on {card.name} by {rules.name}",
        "note": METHOD_ONLY if any(request.input_errors.named for request in requests.values()) else "",
    }
    summaries = {value: run.summary for value, run in runs.items()}
    files = write_sweep(folder, setting, summaries, **shown)
    return Sweep(folder=folder, runs=runs, table=sweep_table(setting, summaries, **shown), files=files)


def _folder_name(value: str) -> str:
    """Name of the folder of a value's run."""
    from bench.reporting.formats import file_name

    return file_name(value).lstrip(".") or "_"


def show(swept: Sweep) -> int:
    """Print the table, what failed, and the files."""
    print_blocks([swept.table])
    failures = [f"{value}: {failure}" for value, run in swept.runs.items() for failure in run.summary.failures]
    print_failures(failures, all_in=f"the summary.json of each value in {swept.folder}")
    asked = sum(run.summary.provenance.images_asked for run in swept.runs.values())
    note(f"{len(swept.runs)} values; {counted(asked, 'image')} answered, the others were there")
    note_files(swept.files)
    return FAILURES if failures else 0


def _combinations(
    settings: Mapping[str, object], input_errors: Mapping[str, object]
) -> tuple[str, dict[str, tuple[dict[str, object], dict[str, object]]]]:
    """The name that has several values, and for each of them, as it is shown, all settings and all input errors.

    Raises:
        UsageError: none or two have several values, or a group of settings is a value, too.
    """
    from bench.methods.settings import flat_settings, nested_settings

    given = flat_settings(settings), flat_settings(input_errors)
    several = [(side, name) for side in (0, 1) for name, value in given[side].items() if isinstance(value, list)]
    if len(several) != 1:
        expected = "one --set or --input-error with several values, as --set threshold=3e-4,6e-4,1e-3"
        raise UsageError(f"sweep: expected {expected}, got {len(several)}")
    ((side, name),) = several
    values: Any = given[side].pop(name)
    if not values:
        raise UsageError(f"sweep: expected values of {name}, got none")
    choices = {}
    for value in values:
        chosen = [nested_settings(of | ({name: value} if number == side else {})) for number, of in enumerate(given)]
        choices[value if isinstance(value, str) else json.dumps(value, default=str)] = chosen[0], chosen[1]
    return name, choices
