"""A sweep: a run for each of several values of one setting, each in a folder of its own."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bench.api.datasets import as_executor, rendered_card
from bench.api.runs import DEFAULT_PROTOCOL, Run, default_folder, run_request
from bench.atomic import output_folder
from bench.errors import UsageError
from bench.execution import TaskExecutor
from bench.harness import RunRequest, run_benchmark
from bench.harness.references import cache_folder
from bench.harness.stages import Progress, part_of
from bench.recordings import DatasetCard
from bench.reporting.document import Table
from bench.reporting.formats import file_name
from bench.reporting.sweep import METHOD_ONLY, table, write_sweep
from bench.reporting.table_files import write_report_files

SWEEPS = Path("reports/sweeps")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SweepRequest:
    """Runs that are asked for.

    Attributes:
        folder: of the sweep.
        setting: that has several values.
        runs: by value, each one run; their folders are not used.
    """

    folder: Path
    setting: str
    runs: Mapping[str, RunRequest]


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
    protocol: str | Path = DEFAULT_PROTOCOL,
    split: str | None = None,
    input_errors: Mapping[str, object] | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    workers: int | TaskExecutor = 1,
    flow_cache: str | Path | None = None,
    progress: Progress | None = None,
) -> Sweep:
    """Score a method once for each of several values of one setting, as `fisheye-bench sweep` does.

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
    request = sweep_request(
        dataset,
        setting,
        values,
        method,
        of_input=of_input,
        settings=settings,
        protocol=protocol,
        split=split,
        input_errors=input_errors,
        out=out,
        overwrite=overwrite,
    )
    return run_sweep(request, workers=workers, flow_cache=flow_cache, progress=progress)


def sweep_request(
    dataset: str | Path | DatasetCard,
    setting: str,
    values: Iterable[object] | Mapping[str, object],
    method: str,
    *,
    of_input: bool,
    settings: Mapping[str, object] | None,
    protocol: str | Path,
    split: str | None,
    input_errors: Mapping[str, object] | None,
    out: str | Path | None,
    overwrite: bool,
) -> SweepRequest:
    """Assemble the runs of a sweep; nothing is rendered or computed yet. Arguments and errors are those of `sweep`."""
    named = values if isinstance(values, Mapping) else {str(value): value for value in values}
    if not named:
        raise UsageError(f"sweep: expected values of {setting}, got none")
    runs = {
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
    first = next(iter(runs.values()))
    fixed = [*(settings or {}).items(), *(input_errors or {}).items()]
    usual = f"{default_folder(first.card, first.method.name, fixed, split).name}-{setting}"
    return SweepRequest(folder=SWEEPS / usual if out is None else Path(out), setting=setting, runs=runs)


def run_sweep(
    request: SweepRequest,
    *,
    workers: int | TaskExecutor = 1,
    flow_cache: str | Path | None = None,
    progress: Progress | None = None,
) -> Sweep:
    """Score a method for each value, and write table and chart; arguments and errors are those of `sweep`."""
    first, folder, runs = next(iter(request.runs.values())), request.folder, dict[str, Run]()
    (rules,) = first.protocols
    with output_folder(folder), as_executor(workers) as executor:  # of all values, so that workers start once
        rendered_card(first.card, first.split, executor=executor)
        for number, (value, run) in enumerate(request.runs.items()):
            part = part_of(progress, number=number, total=len(request.runs))
            place = folder / (file_name(value).lstrip(".") or "_")
            cache = cache_folder() / "flow" if flow_cache is None else Path(flow_cache)
            run = replace(run, folder=place, executor=executor, flow_cache=cache, progress=part)
            (stored,) = run_benchmark(run, finish=write_report_files)
            runs[value] = Run(stored=stored)
    shown = {
        "title": f"{request.setting} of {first.method.name} on {first.card.name} by {rules.name}",
        "note": METHOD_ONLY if any(run.input_errors.named for run in request.runs.values()) else "",
    }
    summaries = {value: run.summary for value, run in runs.items()}
    files = write_sweep(folder, request.setting, summaries, **shown)
    return Sweep(folder=folder, runs=runs, table=table(request.setting, summaries, **shown), files=files)


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
