"""What is wrong with a folder of predictions, as a table for the terminal."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.table import Table

from bench.harness import PredictionReport

SHOWN = 5  # faults of a kind
LONGEST = 160  # letters of a reason


def prediction_table(report: PredictionReport) -> Table | None:
    """The first few faults of each kind, with the number of all; None where there is none."""
    table = Table(box=SIMPLE_HEAD, show_edge=False, title="Predictions that do not fit", title_justify="left")
    table.add_column("", no_wrap=True)
    table.add_column("how many", justify="right")
    table.add_column("file or image", overflow="fold")
    table.add_column("why", overflow="fold")
    for kind, faults in report.faults.items():
        for place, fault in enumerate(faults[:SHOWN]):
            head = (kind, str(len(faults))) if place == 0 else ("", "")
            table.add_row(*head, fault.place, _shortened(fault.reason))
        if len(faults) > SHOWN:
            table.add_row("", "", "...", "")
    return table if table.row_count else None


def prediction_line(report: PredictionReport) -> str:
    """For example "12 of 16 images have a mask; 2 files are of images that are not scored"."""
    told = [f"{report.usable} of {report.expected} images have a usable {report.form}"]
    if report.unscored:
        told.append(f"{report.unscored} predictions are of images that are not scored")
    if report.elsewhere:
        told.append(f"{report.elsewhere} files are of recordings that are not scored")
    return "; ".join(told)


def _shortened(text: str) -> str:
    return text if len(text) <= LONGEST else text[: LONGEST - 4] + " ..."
