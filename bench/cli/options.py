"""Options and arguments that several commands share, as typer reads them."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.core import TyperGroup

FAILURES = 2  # exit status where single images, units or recordings could not be used, as for usage and data errors


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


Dataset = Annotated[str, typer.Argument(help="A data-set card: its path, or a name, see `list datasets`.")]
MethodName = Annotated[str, typer.Option("--method", help="The method; see `list methods`.")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="A parameter of the method, as YAML; repeatable."),
]
InputErrors = Annotated[
    list[str] | None,
    typer.Option(
        "--input-error",
        metavar="NAME=VALUE",
        help="An error of what the method is given, as pitch_deg=0.5; the reference keeps the truth; repeatable.",
    ),
]
ProtocolName = Annotated[
    str, typer.Option("--protocol", help="paper-v1, surface-v1, extended-v1, masks-v1, or a file.")
]
Protocols = Annotated[
    str,
    typer.Option(
        "--protocol",
        help="paper-v1, extended-v1, surface-v1, masks-v1, or a YAML file; several with commas in between; the "
        "method is asked once.",
    ),
]
Split = Annotated[
    str | None,
    typer.Option(
        "--split",
        help="A split of the data set, or recordings with commas in between; [:50] behind it: the first 50 images of "
        "each camera; default: everything.",
    ),
]
Recording = Annotated[str | None, typer.Option(help="Name of the recording; default: all.")]
Workers = Annotated[int | None, typer.Option(min=1, help="Worker processes; default: one per core.")]
Scheduler = Annotated[
    str | None,
    typer.Option("--scheduler", help="Compute on a Dask cluster: tcp://HOST:PORT, or the file of its scheduler."),
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace another run in the folder.")]
Pictures = Annotated[bool, typer.Option(help="Also draw an example frame of every category.")]
StoredRun = Annotated[str, typer.Argument(help="Folder of a run, or of its results by a protocol.")]
