"""The program: its commands, its own options, how it starts and how it ends."""

from __future__ import annotations

import atexit
import errno
import gc
import os
import platform
import sys
import warnings
from collections.abc import Iterator
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated

import typer

import bench
from bench.commands.command import Commands, add_command, print_nothing
from bench.commands.console import QUIET, VERBOSE, Verbosity, be_silent, say, take_verbosity, verbosity
from bench.errors import DISK_FULL, BenchError, UsageError

EXIT_USER = 2  # usage or data error
EXIT_INTERNAL = 70  # EX_SOFTWARE of sysexits.h; 1, Python's own, would be a verdict of the gate

# Panels of the help; each command is in the module of its name.
COMMANDS = {
    "Score": ("run", "evaluate", "sweep", "gate", "verify"),
    "Look": ("report", "compare", "leaderboard", "view", "list"),
    "Your data and methods": ("validate", "annotate", "reference", "new"),
    "Laboratory": ("audit", "synthesize"),
}

DOCUMENTATION = "https://github.com/fisheye-bench/fisheye-bench/tree/main/docs"
OFFLINE = Path(bench.__file__).parent / "shipped" / "docs"  # of an installed package

# What a report of a problem names: variables of the environment, and packages that may be missing or stand in the way.
SETTINGS = ("FISHEYE_BENCH_", "OMP_", "OPENBLAS_", "MKL_", "NUMBA_", "OPENCV_", "PYTHON")
OPTIONAL = ("distributed", "rerun-sdk", "onnxruntime", "torch", "opencv-python", "opencv-contrib-python")

app = typer.Typer(
    name="fisheye-bench",
    cls=Commands,
    help="Score moving-object segmentation in automotive fisheye images against lidar reference polygons.",
    epilog=f"Documentation: {DOCUMENTATION}" + (f", offline in {OFFLINE}" if OFFLINE.is_dir() else ""),
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for panel, names in COMMANDS.items():
    for name in names:
        module = import_module(f"bench.commands.{name}")
        if hasattr(module, "app"):
            app.add_typer(module.app, name=name, rich_help_panel=panel)
        else:
            function = getattr(module, "command", None) or getattr(module, name)
            add_command(app, name, function, getattr(module, "show", print_nothing), panel=panel)


def main() -> None:
    """Run the command line and exit."""
    atexit.register(gc.freeze)  # or the end takes half a second of looking through all libraries for garbage
    warnings.showwarning = _warn
    try:
        for argument in sys.argv[1:]:
            if not argument.isprintable() and any("\ud800" <= letter <= "\udfff" for letter in argument):
                raise UsageError(f"expected arguments in UTF-8, got {argument!r}; rename the file or folder")
        if not sys.flags.safe_path and str(Path.cwd()) not in sys.path:
            sys.path.append(str(Path.cwd()))  # a method or adapter beside the user, named as MODULE:CLASS
        app(args=take_verbosity(sys.argv[1:]))
    except Exception as error:  # noqa: BLE001 - the last of all handlers
        message = user_message(error)
        if message is None or (verbosity() is Verbosity.VERBOSE and error.__cause__ is not None):
            sys.excepthook(*sys.exc_info())
        if message is None:
            sys.exit(EXIT_INTERNAL)
        say(f"error: {message}", to_errors=True)
        sys.exit(EXIT_USER)
    finally:
        be_silent()


def user_message(error: Exception) -> str | None:
    """The line about a mistake that the user can correct; None for a fault of ours, which keeps its traceback."""
    if isinstance(error, BenchError):
        return str(error)
    if isinstance(error, MemoryError) or getattr(error, "errno", None) == errno.ENOMEM:
        got = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        return f"expected memory and threads, got {got}; give this process more, or take fewer --workers"
    full = isinstance(error, OSError) and error.errno in DISK_FULL
    if isinstance(error, OSError) and (full or error.filename is not None):  # not of our own writers
        hint = "; free some disk space, then run the same command again" if full else ""
        return f"{error.filename or 'this disk'}: {error.strerror or error}{hint}"
    return None


def _warn(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, *_: object, **__: object
) -> None:
    say(f"{filename}:{lineno}: {category.__name__}: {message}", to_errors=True)


def _print_version(wanted: bool) -> None:
    if not wanted:
        return
    say(f"fisheye-bench {bench.__version__}")
    if verbosity() is Verbosity.VERBOSE:
        for name, value in _installation():
            say(f"{name + ':':<13}{value}")
    raise typer.Exit


def _installation() -> Iterator[tuple[str, str]]:
    """Machine and installation, for a bug report."""
    from bench.execution import usable_cores
    from bench.harness.digests import library_versions
    from bench.harness.manifest import package_commit

    yield "commit", package_commit() or "unknown"
    yield "system", f"{platform.platform()}, {usable_cores()} of {os.cpu_count()} cores"
    yield "Python", f"{platform.python_version()} ({platform.python_implementation()})"
    yield "libraries", ", ".join(f"{name} {number}" for name, number in library_versions().items())
    yield "optional", ", ".join(f"{name} {_version(name)}" for name in OPTIONAL)
    chosen = sorted(name for name in os.environ if name.startswith(SETTINGS))
    yield "environment", ", ".join(f"{name}={os.environ[name]}" for name in chosen) or "no variable of ours is set"


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


@app.callback()
def global_options(
    *,
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            is_eager=True,
            callback=_print_version,
            help="Print the version and exit; with -v also libraries, cores, optional parts and settings.",
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
