"""The reference as data, for other programs."""

from __future__ import annotations

from pathlib import Path

from bench.api.datasets import as_executor, rendered_card
from bench.evaluation import load_protocol
from bench.execution import TaskExecutor
from bench.harness.reference_export import ReferenceExport, export_references
from bench.harness.stages import Progress
from bench.recordings import DatasetCard


def export_reference(
    dataset: str | Path | DatasetCard,
    out: str | Path,
    *,
    protocol: str | Path = "surface-v1",
    split: str | None = None,
    recording: str | None = None,
    workers: int | TaskExecutor = 1,
    progress: Progress | None = None,
) -> ReferenceExport:
    """Write what a protocol counts in each image of a data set; see `bench.harness.reference_export` for the files.

    Args:
        dataset: card, by path or by a name that `fisheye-bench list` shows.
        out: a folder that is new or empty; it is written whole or not at all.
        protocol: of the reference, by name or file.
        split: of the data set; None for all of it.
        recording: name of the only one to export; None for all.
        workers: processes, or an executor, that compute the recordings.
        progress: called with the recordings done and their number.

    Returns:
        The export, with one line for each image that has no reference.

    Raises:
        UnknownNameError: no data set, protocol, split or recording of this name.
        DataError: the folder holds something, or a recording cannot be opened.
    """
    executor, rules = as_executor(workers), load_protocol(protocol)
    card = rendered_card(dataset, split, executor=executor)
    return export_references(
        card,
        protocol=rules,
        out=Path(out),
        split=split,
        recording=recording,
        executor=executor,
        progress=progress,
    )
