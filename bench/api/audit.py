"""Audit a rendered data set: the lidar reference, the ranking of methods by it, and how many beams it needs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Generic, TypeVar

from bench.api.datasets import as_card, as_executor, rendered_card
from bench.api.runs import DEFAULT_PROTOCOL
from bench.atomic import output_folder
from bench.audit import AuditSummary, audit_sources, read_misses, read_polygons, run_audit
from bench.audit.beams import BeamsSummary, run_beams
from bench.audit.predictions import Prediction, parse_predictions
from bench.audit.ranking import RankingSummary, run_ranking
from bench.errors import UsageError
from bench.evaluation import load_protocol
from bench.execution import TaskExecutor
from bench.harness.stages import Progress
from bench.methods import FlowMethod, Method, build_method
from bench.recordings import DatasetCard
from bench.reporting.audit_beams import beams_tables, write_beams_files
from bench.reporting.audit_pictures import write_audit_files, write_cause_pictures, write_examples
from bench.reporting.audit_ranking import ranking_tables, write_ranking_files
from bench.reporting.audit_tables import audit_tables
from bench.reporting.document import Table

AUDITS = Path("reports/audit")

Summary = TypeVar("Summary", AuditSummary, RankingSummary, BeamsSummary)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Audit(Generic[Summary]):
    """An audit of a data set.

    Attributes:
        folder: where it is stored.
        summary: all that was found, as it is stored in JSON; `failures` says what could not be used.
        tables: of it, for people.
        files: that were written, pictures included.
        remarks: what was left out, and why.
    """

    folder: Path
    summary: Summary
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
) -> Audit[AuditSummary]:
    """Compare the lidar reference with exact masks, and say why a method misses, as `fisheye-bench audit` does.

    Args:
        dataset: rendered; card, by path or by a name that `fisheye-bench datasets` lists.
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
    work = partial(run_audit, method=built, protocol=rules)
    folder, card, found = _stored(
        work, dataset, out=out, split=split, recordings=recordings, workers=workers, progress=progress
    )
    files = list(write_audit_files(folder))
    if pictures:
        sources = {source.recorded.name: source for source in audit_sources(card, split=split, recordings=recordings)}
        handles = {name: source.recorded for name, source in sources.items()}
        files += write_examples(folder, found, read_polygons(folder), handles=handles, protocol=rules)
        if isinstance(built, FlowMethod):
            files += write_cause_pictures(folder, read_misses(folder), sources=sources, method=built, protocol=rules)
    remarks = (f"without exact flow: {found.left_out}",) if found.left_out else ()
    return Audit(folder=folder, summary=found, tables=audit_tables(found), files=tuple(files), remarks=remarks)


def audit_ranking(
    dataset: str | Path | DatasetCard,
    methods: str | Sequence[Prediction] = "all",
    *,
    split: str | None = None,
    recordings: int | None = None,
    out: str | Path | None = None,
    workers: int | TaskExecutor = 1,
    progress: Progress | None = None,
) -> Audit[RankingSummary]:
    """Rank methods by lidar references and by exact masks, as `fisheye-bench audit --methods` does.

    Args:
        dataset: as of `audit_reference`.
        methods: names with commas in between, settings behind colons, as in "spherical:flow=dis,truth:grow_px=4"; "all"
            for a list of good and bad ones.
        split: of the data set; None for all of it.
        recordings: how many of them, spread over the split; None for all.
        out: folder of the audit; None for `reports/audit/<data set>`.
        workers: processes, or an executor.
        progress: called with the recordings done and their number.

    Raises:
        UnknownNameError: no data set, split or method of this name.
        UsageError: fewer than two methods, or two of one name.
        DataError: no recording could be scored, above all where none has rendered masks.
    """
    predictions = parse_predictions(methods) if isinstance(methods, str) else methods
    work = partial(run_ranking, predictions=predictions)
    folder, _, found = _stored(
        work, dataset, out=out, split=split, recordings=recordings, workers=workers, progress=progress
    )
    return Audit(folder=folder, summary=found, tables=ranking_tables(found), files=write_ranking_files(folder))


def audit_beams(
    dataset: str | Path | DatasetCard,
    beams: Iterable[int],
    *,
    methods: str | Sequence[Prediction] = (),
    split: str | None = None,
    recordings: int | None = None,
    out: str | Path | None = None,
    workers: int | TaskExecutor = 1,
    progress: Progress | None = None,
) -> Audit[BeamsSummary]:
    """Tell how good the reference `surface-v1` is with fewer beams, as `fisheye-bench audit --beams` does.

    Args:
        dataset: as of `audit_reference`.
        beams: how many, for example `[64, 32, 16]`; all of the sensor's are always among them.
        methods: to be ranked by the references, as of `audit_ranking`.
        split: of the data set; None for all of it.
        recordings: how many of them, spread over the split; None for all.
        out: folder of the audit; None for `reports/audit/<data set>`.
        workers: processes, or an executor.
        progress: called with the recordings done and their number.

    Raises:
        UnknownNameError: no data set, split or method of this name.
        UsageError: two methods of one name.
        DataError: no recording could be used, above all where none has rendered masks or the lidar has fewer beams.
    """
    predictions = parse_predictions(methods) if isinstance(methods, str) else methods
    work = partial(run_beams, beams=tuple(beams), predictions=predictions)
    folder, _, found = _stored(
        work, dataset, out=out, split=split, recordings=recordings, workers=workers, progress=progress
    )
    return Audit(folder=folder, summary=found, tables=beams_tables(found), files=write_beams_files(folder))


def audit_folder(dataset: str | Path | DatasetCard, out: str | Path | None) -> Path:
    """The folder that is named, or the usual one of a data set."""
    return AUDITS / as_card(dataset).name if out is None else Path(out)


def _stored(
    work: Callable[..., Summary],
    dataset: str | Path | DatasetCard,
    *,
    out: str | Path | None,
    split: str | None,
    recordings: int | None,
    workers: int | TaskExecutor,
    progress: Progress | None,
) -> tuple[Path, DatasetCard, Summary]:
    """Audit a data set, which is rendered where it is missing; the folder, the card, and what was found."""
    executor, folder = as_executor(workers), audit_folder(dataset, out)
    with output_folder(folder):
        card = rendered_card(dataset, split, executor=executor)
        found = work(card, out=folder, split=split, recordings=recordings, executor=executor, progress=progress)
    return folder, card, found
