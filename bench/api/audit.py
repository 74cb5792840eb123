"""Audit a rendered data set: how good the lidar reference is, and why a method misses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from bench.api.datasets import as_card, as_executor, rendered_card
from bench.api.runs import DEFAULT_PROTOCOL
from bench.atomic import output_folder
from bench.audit import AuditSummary, audit_sources, run_audit
from bench.errors import UsageError
from bench.evaluation import load_protocol
from bench.execution import TaskExecutor
from bench.harness.stages import Progress
from bench.methods import FlowMethod, Method, build_method
from bench.recordings import DatasetCard
from bench.reporting.audit_pictures import write_audit_files, write_cause_pictures, write_examples
from bench.reporting.audit_tables import audit_tables
from bench.reporting.document import Table

AUDITS = Path("reports/audit")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Audit:
    """An audit of a data set.

    Attributes:
        folder: where it is stored.
        summary: all that was found, as it is stored in JSON; `failures` says what could not be used.
        tables: of it, for people.
        files: that were written, pictures included.
        remarks: what was left out, and why.
    """

    folder: Path
    summary: AuditSummary
    tables: tuple[Table, ...]
    files: tuple[Path, ...]
    remarks: tuple[str, ...] = ()


def audit_reference(
    dataset: str | Path | DatasetCard,
    method: str | Method = "spherical",
    *,
    settings: Mapping[str, object] | None = None,
    protocol: str | Path = DEFAULT_PROTOCOL,
    split: str | None = None,
    recordings: int | None = None,
    out: str | Path | None = None,
    pictures: bool = True,
    workers: int | TaskExecutor = 1,
    progress: Progress | None = None,
) -> Audit:
    """Compare the lidar reference with exact masks, and say why a method misses, as `fisheye-bench audit` does.

    Args:
        dataset: rendered; card, by path or by a name that `fisheye-bench list` shows.
        method: whose detections are scored and explained; by name, as "module:Class", or an object.
        settings: parameters of a method that is given by name.
        protocol: of the reference, by name or file.
        split: of the data set; None for all of it.
        recordings: how many of them, spread over the split; None for all.
        out: folder of the audit; None for `reports/audit/<data set>`.
        pictures: draw median and worst examples of every class.
        workers: processes, or an executor.
        progress: called with the recordings done and their number.

    Raises:
        UnknownNameError: no data set, method, protocol or split of this name.
        UsageError: settings that the method does not take, or beside an object; fewer than one recording.
        DataError: nothing of the data set could be audited, above all where it has no rendered masks.
    """
    if settings and not isinstance(method, str):
        raise UsageError("settings: expected none beside a method that is built already")
    built = build_method(method, settings) if isinstance(method, str) else method
    rules = load_protocol(protocol)
    executor, folder = as_executor(workers), audit_folder(dataset, out)
    with output_folder(folder):
        card = rendered_card(dataset, split, executor=executor)
        found, rows = run_audit(
            card,
            method=built,
            protocol=rules,
            out=folder,
            split=split,
            recordings=recordings,
            executor=executor,
            progress=progress,
        )
    polygons, misses = rows.tables["polygons"], rows.tables["misses"]
    files = list(write_audit_files(folder, found, polygons))
    if pictures:
        sources = {source.recorded.name: source for source in audit_sources(card, split=split, recordings=recordings)}
        handles = {name: source.recorded for name, source in sources.items()}
        files += write_examples(folder, found, polygons, handles=handles, protocol=rules)
        if isinstance(built, FlowMethod):
            files += write_cause_pictures(folder, misses, sources=sources, method=built, protocol=rules)
    remarks = (f"without exact flow: {found.left_out}",) if found.left_out else ()
    return Audit(folder=folder, summary=found, tables=audit_tables(found), files=tuple(files), remarks=remarks)


def audit_folder(dataset: str | Path | DatasetCard, out: str | Path | None) -> Path:
    """The folder that is named, or the usual one of a data set."""
    return AUDITS / as_card(dataset).name if out is None else Path(out)
