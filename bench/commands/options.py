"""Options and arguments that several commands share, and what the names in them stand for.

What a scenario renders is rendered first, with a bar.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.commands.command import TEXT, Words
from bench.commands.console import Report, detail, interruptible, note, progress_bar
from bench.errors import UsageError
from bench.plain_text import counted

if TYPE_CHECKING:
    from collections.abc import Mapping
    from concurrent.futures import Executor

    from bench.execution import TaskExecutor
    from bench.methods import Method
    from bench.recordings import DatasetCard


def worker_processes(count: int | None) -> TaskExecutor:
    """Processes of this machine beside that of the command, so that no method ends it without a word.

    Args:
        count: how many; None for one per core.
    """
    from bench.execution import ProcessExecutor, usable_cores

    return ProcessExecutor(workers=count or usable_cores())


def _executor(workers: str | None) -> TaskExecutor:
    """The executor of `--workers`.

    Raises:
        UsageError: neither a positive number nor an address or file.
        DataError: no such cluster.
    """
    if workers is None:
        return worker_processes(None)
    if re.fullmatch(r"0*[1-9][0-9]{0,5}", workers):
        return worker_processes(int(workers))
    if "://" not in workers and not Path(workers).is_file():  # for which Dask would wait
        expected = "a number from 1 on, tcp://HOST:PORT, or the file of a scheduler"
        raise UsageError(f"--workers: expected {expected}, got {workers!r}")
    from bench.execution import dask_executor

    return dask_executor(workers)


def _settings(option: str) -> Words:
    """Assignments of an option, which may be given several times."""

    def parse(texts: list[str] | None) -> Mapping[str, object]:
        from bench.methods.settings import parse_settings

        return parse_settings(texts, option=option)

    return Words(list[str] | None, parse)


Dataset = Annotated[
    "str | Path | DatasetCard", typer.Argument(help="Data-set card: a path, or a name of `list datasets`."), TEXT
]
MethodName = Annotated[
    "str | Method", typer.Option("--method", help="Method: a name of `list methods`, or module:Class."), TEXT
]
Settings = Annotated[
    "Mapping[str, object] | None",
    typer.Option("--set", metavar="NAME=VALUE", help="Set a parameter of the method, as YAML; repeatable."),
    _settings("--set"),
]
InputErrors = Annotated[
    "Mapping[str, object] | None",
    typer.Option(
        "--input-error",
        metavar="NAME=VALUE",
        help="Disturb the method's input, for example pitch_deg=0.5; the reference does not change; repeatable.",
    ),
    _settings("--input-error"),
]
RULES = "surface-v1, paper-v1, extended-v1, masks-v1, or a YAML file"
Protocol = Annotated["str | Path", typer.Option(help=f"{RULES}."), TEXT]
Protocols = Annotated["str | Path", typer.Option("--protocol", help=f"{RULES}; separate several by commas."), TEXT]
Split = Annotated[
    str | None,
    typer.Option(
        help="A split of the data set, or recordings separated by commas; append [:50] for the first 50 images "
        "of each camera; default: everything."
    ),
]
Workers = Annotated[
    "int | Executor | TaskExecutor",
    typer.Option(
        metavar="N",
        help="Worker processes; default: one per core. Or a Dask cluster: tcp://HOST:PORT, or its scheduler file.",
    ),
    Words(str | None, _executor, default=None),
]


def as_card(dataset: str | Path | DatasetCard) -> DatasetCard:
    """The card of a data set, read where it is not given itself.

    Raises:
        UnknownNameError: no card of this name.
        DataError: it cannot be read.
    """
    from bench.recordings import DatasetCard, load_card

    return dataset if isinstance(dataset, DatasetCard) else load_card(dataset)


def as_executor(workers: int | Executor | TaskExecutor) -> TaskExecutor:
    """The executor of so many processes: one computes in this process; or the one that is given."""
    from concurrent.futures import Executor

    from bench.execution import FuturesExecutor, local_executor

    if isinstance(workers, Executor):
        return FuturesExecutor(pool=workers, workers=getattr(workers, "_max_workers", 0))
    return local_executor(workers) if isinstance(workers, int) else workers


@contextmanager
def rendering(scenario: Path, out: Path) -> Iterator[Report]:
    """A progress bar for rendering, and what is left when that is interrupted."""
    left = f"the recordings that are done are in {out}, and the same command goes on from there"
    title = f"rendering {scenario.name.partition('.')[0]} (compiling on first use)"
    with interruptible(left), progress_bar(title, "recordings") as report:
        yield report


def rendered_card(
    dataset: str | Path | DatasetCard,
    split: str | None = None,
    *,
    executor: TaskExecutor | None = None,
    as_it_is: bool = False,
) -> DatasetCard:
    """The card of a data set, of which what its scenario asks for in a split is rendered where it is not there yet.

    Args:
        dataset: card, by path or by a name that `fisheye-bench list` shows.
        split: of the data set; None for all of it.
        executor: of what is done with the data; as many of its workers render. None for one process per core.
        as_it_is: render nothing where the data have a folder, however much of them is in it.

    Raises:
        UnknownNameError: no card or split of this name.
        DataError: the card or its scenario cannot be used.
    """
    from bench.harness.datasets import render_if_missing

    card = as_card(dataset)
    detail(f"card {card.file}, root {card.content.root}")
    if card.scenario is not None and not (as_it_is and card.root.is_dir()):
        with rendering(card.scenario, card.root) as report:
            workers = 0 if executor is None else executor.workers
            count = render_if_missing(card, split, workers=workers or None, progress=report)
        if count:
            note(f"{counted(count, 'recording')} in {card.root}")
    return card
