"""Stored runs that may stand beside each other, and a clear word about those that may not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.errors import UsageError
from bench.evaluation import Protocol
from bench.evaluation.row_source import RowSource
from bench.harness import RunSummary, open_tables, read_protocol, read_run

SHOWN_DIGEST = 12  # characters of a digest that are shown


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StoredRun:
    """A run as it lies on disk.

    Attributes:
        folder: of the run.
        label: what tables call it: the folder's name, with a number where two are the same.
        summary: `summary.json`.
        rules: its protocol.
        objects: of `OBJECTS_SCHEMA`, on disk, of all images or those that are compared.
        frames: of `FRAMES_SCHEMA`, the same.
    """

    folder: Path
    label: str
    summary: RunSummary
    rules: Protocol
    objects: RowSource
    frames: RowSource


def read_stored_run(folder: Path, *, label: str | None = None) -> StoredRun:
    """Read a run.

    Raises:
        DataError: a file of it is missing or damaged, or the files are not of one run.
    """
    summary = read_run(folder)
    rules = read_protocol(folder, summary)
    objects, frames = open_tables(folder)
    name = label or folder.resolve().name
    return StoredRun(folder=folder, label=name, summary=summary, rules=rules, objects=objects, frames=frames)


def read_comparable(folders: Sequence[Path]) -> list[StoredRun]:
    """Read runs of the same data and protocol.

    Raises:
        DataError: a run is damaged.
        UsageError: fewer than two runs, or runs of different data, split or protocol.
    """
    if len(folders) < 2:
        raise UsageError(f"compare: expected at least two runs, got {len(folders)}")
    labels = _labels(folders)
    runs = [read_stored_run(folder, label=label) for folder, label in zip(folders, labels, strict=True)]
    for other in runs[1:]:
        _refuse_different(runs[0], other)
    return runs


def settings_of(summary: RunSummary) -> dict[str, object]:
    """The method's settings with dots for what lies deeper, for example "weights.epipolar"."""
    return _flat(summary.method.settings)


def differing_settings(summaries: Sequence[RunSummary]) -> list[dict[str, object]]:
    """For each run its settings that are not the same in all runs of its method."""
    flat = [settings_of(summary) for summary in summaries]
    found = []
    for summary, own in zip(summaries, flat, strict=True):
        peers = [f for s, f in zip(summaries, flat, strict=True) if s.method.name == summary.method.name]
        found.append({name: value for name, value in own.items() if any(peer.get(name) != value for peer in peers)})
    return found


def settings_text(settings: dict[str, object]) -> str:
    """For example "flow=dis, weights.anti_parallel=0", as `--set` takes them."""
    return ", ".join(f"{name}={value}" for name, value in sorted(settings.items()))


def _refuse_different(first: StoredRun, other: StoredRun) -> None:
    one, two = first.summary, other.summary
    facts = {
        "data set": (one.dataset, two.dataset),
        "split": (one.split or "none", two.split or "none"),
        "protocol": (f"{one.protocol.name} {one.protocol.digest}", f"{two.protocol.name} {two.protocol.digest}"),
    }
    for fact, (before, after) in facts.items():
        if before != after:
            raise UsageError(
                f"{first.folder} and {other.folder} do not compare: "
                f"{fact} {_short(before)} in the first, {_short(after)} in the second"
            )


def _short(fact: str) -> str:
    """Words as they are, digests by their first characters."""
    return " ".join(word[:SHOWN_DIGEST] if len(word) == 64 else word for word in fact.split(" "))


def _labels(folders: Sequence[Path]) -> list[str]:
    names = [folder.resolve().name for folder in folders]
    seen: Counter[str] = Counter()
    labels = []
    for name in names:
        seen[name] += 1
        labels.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return labels


def _flat(settings: dict[str, object], parent: str = "") -> dict[str, object]:
    flat: dict[str, object] = {}
    for name, value in settings.items():
        if isinstance(value, dict) and value:
            flat |= _flat(value, f"{parent}{name}.")
        else:
            flat[f"{parent}{name}"] = value
    return flat
