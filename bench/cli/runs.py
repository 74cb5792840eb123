"""Report of a run that a command scores: the files beside its tables of counts, and what is printed."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from bench.cli.console import note, note_files, print_failures, say, show, stage_times
from bench.cli.progress import progress_bar
from bench.evaluation import Protocol
from bench.harness import Provenance, RunSummary
from bench.recordings import DatasetCard
from bench.reference import IgnoreReason
from bench.reporting.frame_pictures import write_example_pictures
from bench.reporting.table_files import write_report_files
from bench.reporting.tables import TableRow, terminal_report, threshold_free_line

READ_FIRST = ("summary.json", "table.md", "range_map.png")


@dataclass(kw_only=True)
class RunReport:
    """Report of a run: the files written beside its tables of counts, and what is printed of them.

    Attributes:
        card: the data set.
        protocol: the rules.
        pictures: also draw an example frame of every category.
    """

    card: DatasetCard
    protocol: Protocol
    pictures: bool
    _rows: tuple[TableRow, ...] = ()
    _files: list[Path] = field(default_factory=list)
    _remarks: list[str] = field(default_factory=list)

    def write(self, results: Path, summary: RunSummary) -> None:
        """Write the report of new results and draw their pictures."""
        rows, files = write_report_files(results)
        drawn: list[Path] = []
        if self.pictures:
            with progress_bar("drawing", "pictures") as progress:
                drawn, self._remarks = write_example_pictures(
                    results, summary, card=self.card, protocol=self.protocol, progress=progress
                )
        self._rows = tuple(rows)
        every = (results / "summary.json", *files, *drawn)
        names = [file.relative_to(results) for file in every]
        self._files = sorted(names, key=lambda name: str(name) not in READ_FIRST)  # the first few are printed

    def print(self, summary: RunSummary, folder: Path) -> None:
        """Print the table, what became of the images, the cost, and where everything is."""
        show(terminal_report(self._rows))
        _print_totals(summary, self.protocol)
        note_files(folder / file for file in self._files)
        for remark in self._remarks:
            say(f"no picture: {remark}", style="yellow")


def _print_totals(summary: RunSummary, protocol: Protocol) -> None:
    ledger, images = summary.objects, summary.images
    limits: dict[str, str] = {IgnoreReason.RANGE: f" (beyond {protocol.reference.range_limit_m:g} m)"}
    reasons = [f"{count} {reason}{limits.get(reason, '')}" for reason, count in ledger.ignored.items() if count]
    ignored = ", ".join(reasons) or "none"
    note(
        f"{ledger.annotated} annotated object-frames: {ledger.evaluated} evaluated, {ledger.static} static, "
        f"ignored: {ignored}"
    )
    if summary.threshold_free is not None:
        note(threshold_free_line(summary.threshold_free))
    note(f"{images.images} images: {images.evaluated} scored, {images.skipped} skipped, {images.failed} failed")
    print_cost(summary.provenance)
    print_failures(summary.failures, all_in="summary.json")


def print_cost(made: Provenance) -> None:
    """Print what a run had to compute, and the time and memory that it took."""
    stages = stage_times(made.stage_seconds)
    work = made.work
    images = made.images if work is None else work.images_computed
    rate = f", {images / made.seconds:.1f} images per second" if images and made.seconds else ""
    note(
        f"{made.seconds:.1f} s{rate}, peak memory of a process {made.peak_memory_mb:.0f} MB; "
        f"seconds by stage, over all processes: {stages}"
    )
    if work is not None:
        steps = sorted({*work.steps_found, *work.steps_computed})
        cached = "; ".join(
            f"{step} found {work.steps_found.get(step, 0)}, computed {work.steps_computed.get(step, 0)}"
            for step in steps
        )
        note(
            f"{work.workers} processes; units computed {work.units_computed}, found done {work.units_reused}"
            + (f"; cache: {cached}" if cached else "")
        )
