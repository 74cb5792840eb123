"""The program: its commands, its own options, how it ends.

A module of a command imports what is heavy when the command runs, so that help and completion are quick.
"""

from __future__ import annotations

import atexit
import gc
import sys
import warnings
from pathlib import Path
from typing import Annotated, TextIO

import typer

import bench
from bench.cli.annotations import app as annotations_app
from bench.cli.audit import audit
from bench.cli.cache import cache
from bench.cli.cite import cite
from bench.cli.cluster_example import cluster_example
from bench.cli.compare import compare
from bench.cli.console import say
from bench.cli.datasets import datasets
from bench.cli.evaluate import evaluate
from bench.cli.gate import gate
from bench.cli.leaderboard import leaderboard
from bench.cli.merge import merge
from bench.cli.methods import methods
from bench.cli.new import app as new_app
from bench.cli.options import Commands
from bench.cli.perf import perf
from bench.cli.report import report
from bench.cli.run import run
from bench.cli.start import QUIET, VERBOSE, Verbosity, refuse_unfit, report_lack_of_memory, take_verbosity, verbosity
from bench.cli.sweep import sweep
from bench.cli.synthesize import synthesize
from bench.cli.validate import validate
from bench.cli.view import view
from bench.errors import DISK_FULL, BenchError

EXIT_USER = 2  # usage or data error
EXIT_INTERNAL = 70  # EX_SOFTWARE of sysexits.h; 1, Python's own, would be a verdict of the gate

COMMANDS = (
    run, cluster_example, cache, evaluate, view, validate, synthesize, perf, datasets, methods, report, cite,
    gate, sweep, audit, compare, leaderboard,
)  # fmt: skip

app = typer.Typer(
    name="fisheye-bench",
    cls=Commands,
    help="Score moving-object segmentation in automotive fisheye images against lidar reference polygons.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for command in COMMANDS:
    app.command()(command)
app.command(hidden=True, context_settings={"allow_extra_args": True, "ignore_unknown_options": True})(merge)
app.add_typer(annotations_app, name="annotations")
app.add_typer(new_app, name="new")


def main() -> None:
    """Run the command line and exit."""
    atexit.register(gc.freeze)  # or the end takes half a second of looking through all libraries for garbage
    if not sys.flags.safe_path and str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))  # a method or adapter beside the user, named as MODULE:CLASS
    warnings.showwarning = _warn
    try:
        refuse_unfit(sys.argv[1:])
        with report_lack_of_memory():
            app(args=take_verbosity(sys.argv[1:]))
    except Exception as error:  # noqa: BLE001 - the last of all handlers
        message = user_message(error)
        if message is None or verbosity() is Verbosity.VERBOSE:
            sys.excepthook(*sys.exc_info())
        if message is None:
            sys.exit(EXIT_INTERNAL)
        say(f"error: {message}", to_errors=True)
        sys.exit(EXIT_USER)


def user_message(error: Exception) -> str | None:
    """The line about a mistake that the user can correct; None for a fault of ours, which keeps its traceback."""
    if isinstance(error, BenchError):
        return str(error)
    if isinstance(error, OSError) and (
        error.filename is not None or error.errno in DISK_FULL
    ):  # not of our own writers
        hint = "; free some disk space, then run the same command again" if error.errno in DISK_FULL else ""
        return f"{error.filename or 'this disk'}: {error.strerror or error}{hint}"
    return None


def _warn(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,  # noqa: ARG001
    line: str | None = None,  # noqa: ARG001
) -> None:
    say(f"{filename}:{lineno}: {category.__name__}: {message}", to_errors=True)


def _print_version(asked: bool) -> None:
    if asked:
        say(f"fisheye-bench {bench.__version__}")
        raise typer.Exit


@app.callback()
def global_options(
    *,
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_print_version, help="Print the version and exit.")
    ] = False,
    verbose: Annotated[
        bool, typer.Option(*VERBOSE, help="Say which files are used, and the traceback of errors; of every command.")
    ] = False,
    quiet: Annotated[
        bool, typer.Option(*QUIET, help="Print tables, verdicts and errors alone; of every command.")
    ] = False,
) -> None:
    """Hold the options of the program itself; its help is that of `app`."""
