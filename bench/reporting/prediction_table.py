"""Table of what is wrong with a folder of predictions."""

from __future__ import annotations

from bench.methods.predictions import FaultKind, PredictionIndex
from bench.reporting.document import Table
from bench.reporting.formats import shortened

SHOWN = 5  # faults of a kind
LONGEST = 160  # letters of a reason


def prediction_table(found: PredictionIndex) -> Table | None:
    """The first few faults of each kind, with the number of all; None where there is none."""
    rows = []
    for kind in FaultKind:
        faults = found.of_kind(kind)
        label = f"{kind.value}: {len(faults)}"
        rows += [(label, fault.place, shortened(fault.reason, LONGEST)) for fault in faults[:SHOWN]]
        rows += [(label, "...", "")] if len(faults) > SHOWN else []
    columns = ["fault: how many", "file or image", "why"]
    return Table(title="Predictions that do not fit", columns=columns, rows=rows, words=3) if rows else None


def prediction_line(found: PredictionIndex) -> str:
    """For example "12 of 16 images have a mask; 2 files are of images that are not scored"."""
    parts = [f"{len(found.usable)} of {found.expected} images have a usable {found.form}"]
    if found.unscored:
        parts.append(f"{found.unscored} predictions are of images that are not scored")
    if found.elsewhere:
        parts.append(f"{found.elsewhere} files are of recordings that are not scored")
    return "; ".join(parts)
