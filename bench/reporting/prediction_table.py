"""What is wrong with a folder of predictions, as a table for the terminal."""

from __future__ import annotations

from rich.table import Table

from bench.harness import PredictionReport
from bench.reporting.formats import shortened, terminal_table

SHOWN = 5  # faults of a kind
LONGEST = 160  # letters of a reason


def prediction_table(report: PredictionReport) -> Table | None:
    """The first few faults of each kind, with the number of all; None where there is none."""
    table = terminal_table("Predictions that do not fit")
    table.add_column("", no_wrap=True)
    table.add_column("how many", justify="right")
    table.add_column("file or image", overflow="fold")
    table.add_column("why", overflow="fold")
    for kind, faults in report.faults.items():
        for number, fault in enumerate(faults[:SHOWN]):
            head = (kind, str(len(faults))) if number == 0 else ("", "")
            table.add_row(*head, fault.place, shortened(fault.reason, LONGEST))
        if len(faults) > SHOWN:
            table.add_row("", "", "...", "")
    return table if table.row_count else None


def prediction_line(report: PredictionReport) -> str:
    """For example "12 of 16 images have a mask; 2 files are of images that are not scored"."""
    parts = [f"{report.usable} of {report.expected} images have a usable {report.form}"]
    if report.unscored:
        parts.append(f"{report.unscored} predictions are of images that are not scored")
    if report.elsewhere:
        parts.append(f"{report.elsewhere} files are of recordings that are not scored")
    return "; ".join(parts)
