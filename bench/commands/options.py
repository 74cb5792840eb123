"""Options and arguments that several commands share, as typer reads them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from bench.commands.command import TEXT, Words
from bench.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from concurrent.futures import Executor

    from bench.commands.runs import Run
    from bench.execution import TaskExecutor
    from bench.methods import Method
    from bench.recordings import DatasetCard


class Commands(TyperGroup):
    """A group whose help says in whole sentences what each command does."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the commands by panels, each with the first paragraph of its help."""
        panels: dict[str, list[tuple[str, str]]] = {}
        for name in self.list_commands(ctx):
            command: Any = self.get_command(ctx, name)
            text = " ".join((command.help or "").split("\n\n")[0].split())
            panels.setdefault(command.rich_help_panel or "Commands", []).append((name, text))
        for panel, rows in panels.items():
            with formatter.section(panel):
                formatter.write_dl(rows)


def group(help_text: str) -> typer.Typer:
    """A group of commands, without commands."""
    return typer.Typer(cls=Commands, help=help_text, no_args_is_help=True, rich_markup_mode=None)


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
    from bench.execution import DaskExecutor

    return DaskExecutor.connect(workers)


def _settings(option: str) -> Words:
    """Assignments of an option, which may be given several times."""

    def parse(texts: list[str] | None) -> Mapping[str, object]:
        from bench.methods.settings import parse_settings

        return parse_settings(texts, option=option)

    return Words(list[str] | None, parse)


Dataset = Annotated[
    "str | Path | DatasetCard",
    typer.Argument(help="Data-set card: a path, or a name of `list datasets`."),
    TEXT,
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
        help="Disturb the method's input, for example pitch_deg=0.5; the reference keeps the truth; repeatable.",
    ),
    _settings("--input-error"),
]
ProtocolName = Annotated[
    "str | Path",
    typer.Option("--protocol", help="paper-v1, surface-v1, extended-v1, masks-v1, or a YAML file."),
    TEXT,
]
Protocols = Annotated[
    "str | Path",
    typer.Option(
        "--protocol",
        help="paper-v1, surface-v1, extended-v1, masks-v1, or a YAML file; several, separated by commas, "
        "run the method once.",
    ),
    TEXT,
]
Split = Annotated[
    str | None,
    typer.Option(
        "--split",
        help="A split of the data set, or recordings separated by commas; append [:50] for the first 50 images "
        "of each camera; default: everything.",
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
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace a different run in the folder.")]
Pictures = Annotated[bool, typer.Option(help="Draw an example image of every category.")]
StoredRun = Annotated["str | Path | Run", typer.Argument(help="Folder of a run, or of one protocol in it."), TEXT]
