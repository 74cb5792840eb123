"""Predictions from disk, checked before they are scored: what was paired, what was not, whether they may be scored."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from bench.atomic import write_text
from bench.errors import DataError
from bench.methods.predictions.files import FaultKind
from bench.methods.predictions.method import PredictedMotion
from bench.methods.predictions.pairing import PredictionIndex, index_predictions
from bench.recordings import DatasetCard

SCHEMA_VERSION = 1


def check_predictions(
    card: DatasetCard, *, method: PredictedMotion, progress: Callable[[float, int], None] | None = None
) -> PredictionIndex:
    """Go through the method's folder; the method then uses what was found.

    Args:
        card: the data set.
        method: with the folder.
        progress: called with the recordings done and their number.

    Raises:
        DataError: the folder is missing, or what is in it is no set of predictions.
        UsageError: ambiguous names, or a threshold for masks.
    """
    found = index_predictions(
        Path(method.folder),
        card,
        split=method.split,
        naming=method.naming,
        history=method.history,
        progress=progress,
    )
    method.use(found)
    return found


def refusal(method: PredictedMotion, found: PredictionIndex) -> str | None:
    """Reason to score nothing: any fault where every prediction is required, else a file of unknown images only."""
    if method.missing != "error":
        unread = ", ".join(found.unread)
        return f"{unread}, which cannot be read, so that nobody knows of which images" if unread else None
    counts = {kind.value: len(found.of_kind(kind)) for kind in FaultKind}
    return ", ".join(f"{count} {kind}" for kind, count in counts.items() if count) or None


def refused(method: PredictedMotion, found: PredictionIndex, *, listed_in: Path) -> DataError:
    """The error of a folder that is not scored.

    Args:
        method: with the folder.
        found: in it.
        listed_in: the report of all that is wrong.
    """
    hint = "fix these files"
    if method.missing == "error":
        hint = "fix them; --missing skip leaves images without one out, --missing empty counts them, and neither "
        hint += "looks at what is extra"
    expected = f"a prediction of each of {found.expected} images, and nothing else"
    got = f"{refusal(method, found)}; all of them in {listed_in}"
    return DataError(method.folder, expected=expected, got=got, hint=hint)


def write_report(file: Path, card: DatasetCard, method: PredictedMotion, found: PredictionIndex) -> None:
    """Write how a folder of predictions fits a data set, as `predictions.json`: counts, and all faults by kind."""
    faults = {
        kind.value: [{"place": fault.place, "reason": fault.reason} for fault in found.of_kind(kind)]
        for kind in FaultKind
    }
    content = {
        "schema_version": SCHEMA_VERSION,
        "dataset": card.name,
        "split": method.split,
        "folder": method.folder,
        "form": found.form,
        "digest": found.digest,
        "expected": found.expected,
        "usable": len(found.usable),
        "unscored": found.unscored,
        "elsewhere": found.elsewhere,
        "unread": found.unread,
        "largest": found.largest,
        "threshold": method.threshold,
        "doubts": found.doubts,
        "missing_policy": method.missing,
        "faults": faults,
    }
    write_text(file, json.dumps(content, indent=1, ensure_ascii=False) + "\n")
