"""Commands, called as a user calls them."""

import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import pytest

from bench.commands.app import main


def call(monkeypatch, *words) -> int:
    monkeypatch.setattr(sys, "argv", ["fisheye-bench", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    return 0 if ended.value.code is None else int(ended.value.code)


def error_line(monkeypatch, capsys, *words) -> str:
    """The one line in which a command refuses what it is given, with status 2."""
    assert call(monkeypatch, *words) == 2
    shown = capsys.readouterr().err
    assert shown.startswith("error: ")
    assert shown.count("\n") == 1
    return shown


def called_here(*words: object, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    """What a command ends with and prints; in this process, which spares the start of another."""
    with (
        pytest.MonkeyPatch.context() as patched,
        redirect_stdout(StringIO()) as out,
        redirect_stderr(StringIO()) as err,
    ):
        patched.setenv("COLUMNS", "1000")
        # A busy machine changes nothing that is printed.
        patched.setattr("bench.commands.console.FIRST_LINE_S", float("inf"))
        patched.setattr(sys, "path", [*sys.path])
        if folder is not None:
            patched.chdir(folder)
        status = call(patched, *words)
    return subprocess.CompletedProcess(words, status, out.getvalue(), err.getvalue())


def output_of(*words: object, status: int = 0) -> str:
    """What a command prints that ends with a status."""
    done = called_here(*words)
    assert done.returncode == status, done.stderr
    return done.stdout
