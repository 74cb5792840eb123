"""`sweep`: a run for each of several values of one setting, with one table and one chart."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bench.commands import options
from bench.commands.console import note, note_files, print_blocks, print_failures
from bench.commands.progress import Report, progress_bar, resumable
from bench.errors import UsageError

if TYPE_CHECKING:
    from bench.api.runs import Run
    from bench.execution import TaskExecutor
    from bench.recordings import DatasetCard
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


def sweep(
    dataset: str | Path | DatasetCard,
    setting: str,
    values: Iterable[object] | Mapping[str, object],
    method: str = "spherical",
    *,
    of_input: bool = False,
    settings: Mapping[str, object] | None = None,
    protocol: str | Path = "paper-v1",
    split: str | None = None,
    input_errors: Mapping[str, object] | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    workers: int | TaskExecutor = 1,
    flow_cache: str | Path | None = None,
    progress: Report | None = None,
) -> Sweep:
    """Score a method once for each of several values of one setting.

    Values that are done are not computed again.

    Args:
        dataset: card, by path or by a name that `fisheye-bench list` shows.
        setting: parameter of the method; a part of one behind a dot, as in "weights.epipolar".
        values: of it; by the names that tables show where it is a mapping.
        method: by name, or as "module:Class".
        of_input: `setting` is an error of what the method is given instead, for example "pitch_deg".
        settings: other parameters of the method.
        protocol: by name or file.
        split: of the data set; None for all of it.
        input_errors: other errors of what the method is given.
        out: folder of the sweep; None for `reports/sweeps/<data set>-<method>-<setting>`.
        overwrite: replace other runs in the folders.
        workers: processes, or an executor.
        flow_cache: folder where dense flow is stored for the other values; None for that of the user.
        progress: called with the values done, fractions allowed, and their number.

    Raises:
        UnknownNameError: no data set, method, protocol, split or input error of this name.
        UsageError: no values, or one that the method does not take.
        DataError: nothing of the data set could be used, or a folder holds another run.
    """
    from bench.api.datasets import as_executor
    from bench.api.runs import Run, default_folder, run_request
    from bench.atomic import output_folder
    from bench.commands.request import rendered_card
    from bench.harness import run_benchmark
    from bench.harness.references import cache_folder
    from bench.harness.stages import part_of
    from bench.reporting.formats import file_name
    from bench.reporting.run_tables import write_report_files
    from bench.reporting.sweep import METHOD_ONLY, table, write_sweep

    named = values if isinstance(values, Mapping) else {str(value): value for value in values}
    if not named:
        raise UsageError(f"sweep: expected values of {setting}, got none")
    requests = {
        shown: run_request(
            dataset,
            method,
            settings=settings if of_input else _assigned(settings or {}, setting, value),
            protocols=[protocol],
            split=split,
            input_errors=_assigned(input_errors or {}, setting, value) if of_input else input_errors,
            out=out,
            overwrite=overwrite,
        )
        for shown, value in named.items()
    }
    first = next(iter(requests.values()))
    card, name, (rules,) = first.card, first.method.name, first.protocols
    fixed = [*(settings or {}).items(), *(input_errors or {}).items()]
    folder = SWEEPS / f"{default_folder(card, name, fixed, split).name}-{setting}" if out is None else Path(out)
    cache = cache_folder() / "flow" if flow_cache is None else Path(flow_cache)
    runs = dict[str, Run]()
    with output_folder(folder), as_executor(workers) as executor:  # of all values, so that workers start once
        rendered_card(card, split, executor=executor)
        title = f"scoring {len(requests)} values of {setting}"
        with resumable(folder), progress_bar(title, "values", progress) as report:
            for number, (value, request) in enumerate(requests.items()):
                place = folder / (file_name(value).lstrip(".") or "_")
                part = part_of(report, number=number, total=len(requests))
                asked = replace(request, folder=place, executor=executor, flow_cache=cache, progress=part)
                (stored,) = run_benchmark(asked, finish=write_report_files)
                runs[value] = Run(stored=stored)
    shown = {
        "title": f"{setting} of {name} on {card.name} by {rules.name}",
        "note": METHOD_ONLY if any(request.input_errors.named for request in requests.values()) else "",
    }
    summaries = {value: run.summary for value, run in runs.items()}
    files = write_sweep(folder, setting, summaries, **shown)
    return Sweep(folder=folder, runs=runs, table=table(setting, summaries, **shown), files=files)


def command(
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
    workers: options.Workers = 1,
) -> int:
    """Score a method once for each of several values of one setting: a table and a chart.

    Each value is a run in a folder of the sweep. A sweep that was interrupted continues where it stopped, by the same
    command.
    """
    from bench.methods.settings import parse_settings

    if "," in str(protocol):
        raise UsageError(f"sweep: expected one protocol, got {protocol!r}")
    fixed, fixed_errors, (setting, values, of_input) = split_assigned(set_ or [], input_error or [])
    swept = sweep(
        dataset,
        setting,
        values,
        str(method),
        of_input=of_input,
        settings=parse_settings(fixed),
        protocol=protocol,
        split=split,
        input_errors=parse_settings(fixed_errors, option="--input-error"),
        out=out,
        overwrite=overwrite,
        workers=workers,
    )
    print_blocks([swept.table])
    failures = [f"{value}: {failure}" for value, run in swept.runs.items() for failure in run.summary.failures]
    print_failures(failures, all_in=f"the summary.json of each value in {swept.folder}")
    asked = sum(run.summary.provenance.images_asked for run in swept.runs.values())
    note(f"{len(swept.runs)} values; {asked} images answered, the others were there")
    note_files(swept.files)
    return options.FAILURES if failures else 0


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


def _assigned(settings: Mapping[str, object], name: str, value: object) -> dict[str, object]:
    """Settings with one more.

    Raises:
        UsageError: what is before a dot is no group.
    """
    assigned = deepcopy(dict(settings))
    group: dict[str, Any] = assigned
    *parents, leaf = name.split(".")
    for parent in parents:
        group = group.setdefault(parent, {})
        if not isinstance(group, dict):
            raise UsageError(f"{name}: {parent!r} already has the value {group!r}")
    group[leaf] = value
    return assigned
