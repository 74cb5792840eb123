"""Does a run hold what its masks score?"""

from __future__ import annotations

from pathlib import Path

from bench.api.datasets import as_card, as_executor, rendered_card
from bench.api.runs import Run, load_run, run_folder
from bench.errors import UsageError
from bench.execution import TaskExecutor
from bench.harness.stages import Progress
from bench.harness.verify import Verification, verify_run
from bench.recordings import DatasetCard, list_cards
from bench.recordings.cards import shipped_folder


def verify(
    run: str | Path | Run,
    dataset: str | Path | DatasetCard | None = None,
    *,
    workers: int | TaskExecutor = 1,
    progress: Progress | None = None,
) -> Verification:
    """Count a run again from its stored answers and the data, without its method, as `fisheye-bench verify` does.

    Args:
        run: stored, or its folder; leaderboards of this user call it verified where nothing differs.
        dataset: that it is of, by card or name; None for the card of its name that ships with the package.
        workers: processes, or an executor, that count.
        progress: called with the images done and their number.

    Returns:
        `differences`, one line each, none of a run that holds what its answers score; and `images`, how many were
        counted.

    Raises:
        UnknownNameError: no data set of this name.
        UsageError: no `dataset`, and the run is of none that ships.
        DataError: a file of the run or of the data is missing or damaged.
    """
    folder, executor = run_folder(run), as_executor(workers)
    split = load_run(folder).manifest.dataset.split
    card = rendered_card(card_to_verify(folder, dataset), split, executor=executor)
    return verify_run(folder, card, executor=executor, progress=progress)


def card_to_verify(run: Path, dataset: str | Path | DatasetCard | None) -> DatasetCard:
    """The card by which a run is counted again; never one that only the run names.

    Args:
        run: its folder.
        dataset: as of `verify`.

    Raises:
        UnknownNameError: no data set of this name.
        UsageError: no `dataset`, and the run is of none that ships.
        DataError: the card cannot be read.
    """
    if dataset is not None:
        return as_card(dataset)
    name = load_run(run).manifest.dataset.name
    shipped = {card.name: card for card in list_cards(shipped_folder())}
    if name not in shipped:
        raise UsageError(
            f"{run}: expected a run of a data set that ships with the package, got {name!r}; "
            f"name the card of your own copy with --data"
        )
    return shipped[name]
