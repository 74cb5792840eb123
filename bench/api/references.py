"""The reference as data: written once, read without the data set."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from bench.api.datasets import as_executor, rendered_card
from bench.errors import UsageError
from bench.evaluation import Protocol, load_protocol
from bench.exchange.reference_export import export_references
from bench.execution import TaskExecutor
from bench.harness.reference_files import Form, ReferenceFolder
from bench.harness.stages import Progress
from bench.recordings import DatasetCard
from bench.reference import ReferenceFrame


def export_reference(
    dataset: str | Path | DatasetCard,
    out: str | Path,
    *,
    form: Form = "png",
    protocol: str | Path = "surface-v1",
    split: str | None = None,
    recording: str | None = None,
    workers: int | TaskExecutor = 1,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """Write what a protocol counts in each image of a data set; see `bench.harness.reference_files` for the files.

    Args:
        dataset: card, by path or by a name that `fisheye-bench datasets` lists.
        out: a folder that is new or empty; it is written whole or not at all.
        form: "png" for label images, "coco" for run lengths.
        protocol: of the reference, by name or file.
        split: of the data set; None for all of it.
        recording: name of the only one to export; None for all.
        workers: processes, or an executor, that compute the recordings.
        progress: called with the recordings done and their number.

    Returns:
        One line for each image that has no reference, with the reason.

    Raises:
        UnknownNameError: no data set, protocol, split or recording of this name.
        DataError: the folder holds something, or a recording cannot be opened.
    """
    executor, rules = as_executor(workers), load_protocol(protocol)
    card = rendered_card(dataset, split, executor=executor)
    _, problems = export_references(
        card,
        protocol=rules,
        form=form,
        out=Path(out),
        split=split,
        recording=recording,
        executor=executor,
        progress=progress,
    )
    return problems


def read_reference(folder: str | Path) -> Iterator[ReferenceFrame]:
    """The reference of every image of an export that has one, for `bench.score` or for training.

    Args:
        folder: written by `export_reference`.

    Raises:
        DataError: not an export, or a file of it is missing or damaged; names file and field.
    """
    return ReferenceFolder.open(Path(folder)).frames()


def open_reference(folder: str | Path, *, rules: Protocol) -> ReferenceFolder:
    """Open an export to score a run by a protocol.

    Raises:
        DataError: not an export.
        UsageError: it is by another protocol.
    """
    found = ReferenceFolder.open(Path(folder))
    if found.head.protocol.digest != rules.digest:
        name = found.head.protocol.name
        raise UsageError(f"{folder}: expected a reference by {rules.name}, got one by {name}; say --protocol {name}")
    return found
