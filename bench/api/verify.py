"""Does a run hold what its masks score?"""

from __future__ import annotations

from pathlib import Path

from bench.api.datasets import as_executor, rendered_card
from bench.api.runs import Run, load_run, run_folder
from bench.execution import TaskExecutor
from bench.harness.stages import Progress
from bench.harness.verify import Verification, verify_run
from bench.recordings import DatasetCard


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
        dataset: that it is of, by card or name; None for the card that the run names.
        workers: processes, or an executor, that count.
        progress: called with the images done and their number.

    Returns:
        `differences`, one line each, none of a run that holds what its answers score; and `images`, how many were
        counted.

    Raises:
        UnknownNameError: no data set of this name.
        DataError: a file of the run or of the data is missing or damaged.
    """
    folder, executor = run_folder(run), as_executor(workers)
    of_run = load_run(folder).manifest.dataset
    card = rendered_card(of_run.card if dataset is None else dataset, of_run.split, executor=executor)
    return verify_run(folder, card, executor=executor, progress=progress)
