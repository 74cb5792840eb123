"""`audit`: how good the lidar reference is, and why a method misses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.commands import console, options
from bench.commands.command import Place
from bench.commands.console import Report
from bench.errors import UsageError
from bench.plain_text import counted

if TYPE_CHECKING:
    from bench.audit.run import AuditSummary
    from bench.recordings import DatasetCard

AUDITS = Path("reports/audit")
LEFT = "nothing of the audit is stored, and the same command begins it again"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Audit:
    """An audit of a data set.

    Attributes:
        folder: where it is stored.
        summary: all that was found, as it is stored in JSON; `failures` says what could not be used.
        files: that were written.
    """

    folder: Path
    summary: AuditSummary
    files: tuple[Path, ...]


def audit_reference(
    dataset: options.Dataset,
    method: options.MethodName = "spherical",
    *,
    settings: options.Settings = None,
    protocol: options.Protocol = "surface-v1",
    split: options.Split = None,
    out: Place = None,
    recordings: Annotated[int | None, typer.Option()] = None,
    workers: options.Workers = 1,
    progress: Report | None = None,
) -> Audit:
    """Compare lidar polygons with exact masks of a rendered data set, and find why a method errs.

    An interrupted audit starts again.

    Args:
        dataset: rendered; card, by path or by name.
        method: whose detections are scored and explained; by name, as "module:Class", or an object.
        settings: parameters of a method that is given by name.
        protocol: of the reference, by name or file.
        split: of the data set.
        out: folder of the audit; default: reports/audit/<data set>.
        recordings: number of recordings, spread over the split; default: all.
        workers: processes, or an executor.
        progress: called with the recordings done and their number.

    Raises:
        UnknownNameError: no data set, method, protocol or split of this name.
        UsageError: settings that the method does not take, or beside an object; fewer than one recording.
        DataError: nothing of the data set could be audited, above all where it has no rendered masks.

    Examples:
        fisheye-bench audit demo
    """
    from bench.atomic import make_folder
    from bench.audit.run import AUDIT, run_audit
    from bench.evaluation.protocol import load_protocol
    from bench.methods import build_method
    from bench.reporting.audit import write_tables

    if recordings is not None and recordings < 1:
        raise UsageError(f"--recordings: expected at least 1, got {recordings}")
    if settings and not isinstance(method, str):
        raise UsageError("settings: expected none beside a method that is built already")
    card, executor = options.as_card(dataset), options.as_executor(workers)
    built = build_method(method, settings) if isinstance(method, str) else method
    rules, folder = load_protocol(protocol), audit_folder(card, out)
    options.rendered_card(card, split, executor=executor)
    make_folder(folder)
    with console.interruptible(LEFT), console.progress_bar(f"auditing {card.name}", "recordings", progress) as report:
        found, _ = run_audit(
            card,
            method=built,
            protocol=rules,
            out=folder,
            split=split,
            recordings=recordings,
            executor=executor,
            progress=report,
        )
    return Audit(folder=folder, summary=found, files=(folder / AUDIT, write_tables(folder, found)))


def audit_folder(card: DatasetCard, out: str | Path | None) -> Path:
    """The folder that is named, or the usual one of a data set."""
    return AUDITS / card.name if out is None else Path(out)


def show(audit: Audit) -> int:
    """Print the tables, the cost, failures and files."""
    from bench.reporting.audit import audit_tables

    summary, made = audit.summary, audit.summary.provenance
    console.print_blocks(audit_tables(summary))
    images, recordings = counted(made.images, "image"), counted(summary.recordings, "recording")
    console.say(f"{images} of {recordings} in {made.seconds:.1f} s")
    if summary.left_out:
        console.say(f"without exact flow: {summary.left_out}")
    console.print_failures(summary.failures, all_in="audit.json")
    console.note_files(audit.files)
    return console.FAILURES if summary.failures else 0


command = audit_reference  # `bench.audit` is a package
