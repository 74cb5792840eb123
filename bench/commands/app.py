"""The program: its commands, its own options, how it starts and how it ends."""

from __future__ import annotations

import atexit
import errno
import gc
import sys
import warnings
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

import bench
from bench.commands.command import command_line, print_nothing
from bench.commands.console import QUIET, VERBOSE, Verbosity, be_silent, say, take_verbosity, verbosity
from bench.commands.examples import epilog
from bench.commands.options import Commands
from bench.errors import DISK_FULL, BenchError, UsageError

EXIT_USER = 2  # usage or data error
EXIT_UNFIT = 1  # something is wrong with the installation
EXIT_INTERNAL = 70  # EX_SOFTWARE of sysexits.h; 1, Python's own, would be a verdict of the gate

# Panels of the help; each command is in the module of its name.
COMMANDS = {
    "Score": ("run", "evaluate", "sweep", "gate", "verify"),
    "Look": ("report", "compare", "leaderboard", "view", "list"),
    "Your data and methods": ("validate", "annotate", "reference", "new"),
    "Laboratory": ("audit", "synthesize"),
}

LEAST_ADDRESSES_BYTES = 3_000_000_000  # a run takes 1.5 GB; with 2 GB a library now and then aborts the process
NO_MEMORY = ("failed to map segment", "cannot allocate memory", "can't start new thread", "bad_alloc")

DOCUMENTATION = "https://github.com/fisheye-bench/fisheye-bench/tree/main/docs"

app = typer.Typer(
    name="fisheye-bench",
    cls=Commands,
    help="Score moving-object segmentation in automotive fisheye images against lidar reference polygons.",
    epilog=f"Documentation: {DOCUMENTATION}",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for panel, names in COMMANDS.items():
    for name in names:
        module = import_module(f"bench.commands.{name}")
        if hasattr(module, "app"):
            for command in module.app.registered_commands:
                command.epilog = epilog(f"{name} {command.name}")
            app.add_typer(module.app, name=name, rich_help_panel=panel)
        else:
            function = getattr(module, "command", None) or getattr(module, name)
            called = command_line(function, getattr(module, "show", print_nothing))
            app.command(name, epilog=epilog(name), rich_help_panel=panel)(called)


def main() -> None:
    """Run the command line and exit."""
    atexit.register(gc.freeze)  # or the end takes half a second of looking through all libraries for garbage
    warnings.showwarning = _warn
    try:
        refuse_unfit(sys.argv[1:])
        if not sys.flags.safe_path and str(Path.cwd()) not in sys.path:
            sys.path.append(str(Path.cwd()))  # a method or adapter beside the user, named as MODULE:CLASS
        app(args=take_verbosity(sys.argv[1:]))
    except Exception as error:  # noqa: BLE001 - the last of all handlers
        message = user_message(error)
        if message is None or verbosity() is Verbosity.VERBOSE:
            sys.excepthook(*sys.exc_info())
        if message is None:
            sys.exit(EXIT_INTERNAL)
        say(f"error: {message}", to_errors=True)
        sys.exit(EXIT_USER)
    finally:
        be_silent()


def refuse_unfit(arguments: Sequence[str]) -> None:
    """Refuse a call that would end in a library's traceback.

    Args:
        arguments: of the command line.

    Raises:
        UsageError: a working folder that was removed, an argument that is not UTF-8, or a limit below which libraries
            cannot be loaded.
    """
    try:
        Path.cwd()
    except FileNotFoundError as error:
        raise UsageError("expected a working folder that exists, got one that was removed; go to another") from error
    for argument in arguments:
        if any("\ud800" <= letter <= "\udfff" for letter in argument):
            raise UsageError(f"expected arguments in UTF-8, got {argument!r}; rename the file or folder")
    limit = _address_limit_bytes()
    if "--help" not in arguments and limit is not None and limit < LEAST_ADDRESSES_BYTES:
        expected = f"a limit of at least {LEAST_ADDRESSES_BYTES // 1024} kB of addresses"
        raise UsageError(f"ulimit -v: expected {expected}, got {limit // 1024}; raise it, or limit the memory itself")


def user_message(error: Exception) -> str | None:
    """The line about a mistake that the user can correct; None for a fault of ours, which keeps its traceback."""
    if isinstance(error, BenchError):
        return str(error)
    if (lack := next((one for one in _chain(error) if _lacks_memory(one)), None)) is not None:
        got = " ".join(f"{type(lack).__name__}: {lack}".split())[:200]
        return f"expected memory and threads, got {got}; give this process more, or take fewer --workers"
    if isinstance(error, OSError) and (
        error.filename is not None or error.errno in DISK_FULL
    ):  # not of our own writers
        hint = "; free some disk space, then run the same command again" if error.errno in DISK_FULL else ""
        return f"{error.filename or 'this disk'}: {error.strerror or error}{hint}"
    return None


def _lacks_memory(error: BaseException) -> bool:
    text = str(error).lower()
    number = getattr(error, "errno", None)
    return isinstance(error, MemoryError) or number == errno.ENOMEM or any(part in text for part in NO_MEMORY)


def _chain(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def _address_limit_bytes() -> int | None:
    try:
        import resource
    except ImportError:  # not on Windows
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit


def _warn(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, *_: object, **__: object
) -> None:
    say(f"{filename}:{lineno}: {category.__name__}: {message}", to_errors=True)


def _print_version(wanted: bool) -> None:
    if not wanted:
        return
    say(f"fisheye-bench {bench.__version__}")
    if verbosity() is Verbosity.VERBOSE:
        from bench.commands.installation import print_installation

        raise typer.Exit(0 if print_installation() else EXIT_UNFIT)
    raise typer.Exit


@app.callback()
def global_options(
    *,
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            is_eager=True,
            callback=_print_version,
            help="Print the version and exit; with -v also libraries, cores, memory, optional parts and faults.",
        ),
    ] = False,
    verbose: Annotated[
        bool, typer.Option(*VERBOSE, help="Print which files are used, and tracebacks; works with every command.")
    ] = False,
    quiet: Annotated[
        bool, typer.Option(*QUIET, help="Print only tables, verdicts and errors; works with every command.")
    ] = False,
) -> None:
    """Hold the options of the program itself; its help is that of `app`."""
