"""A command line made of a function: what typer reads, what the function is given, what `show` prints and ends with."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import pytest
import typer
from typer.testing import CliRunner

from bench.commands.command import PATH, TEXT, Words, command_line

if TYPE_CHECKING:
    from nowhere import Thing


def total(
    *numbers: Annotated[int | Thing, typer.Argument(help="To add."), Words(int)],
    times: Annotated[float, typer.Option("--by", metavar="N"), Words(str, float, default="2")] = 1.0,
    name: Annotated[str | Thing | None, typer.Option(), TEXT] = None,
    out: Annotated[str | Path | None, typer.Option(), PATH] = None,
    progress: Thing | None = None,
) -> Thing:
    """Add numbers.

    All of them.

    Args:
        numbers: to add.

    Returns:
        All that was given.
    """
    return sum(numbers) * times, name, out, progress


def show(record, *, loud: Annotated[bool, typer.Option("--loud")] = False) -> int:
    print(record, "!" if loud else "")  # noqa: T201
    return 3 if record[0] > 10 else 0


@pytest.fixture(scope="module")
def program():
    app = typer.Typer(rich_markup_mode=None)
    app.command()(command_line(total, show))
    return lambda *words: CliRunner().invoke(app, words)


def test_words_become_what_the_function_takes_and_show_gives_the_status(program):
    done = program("1", "2", "--name", "x", "--out", "a/b", "--loud")
    assert (done.exit_code, done.output) == (0, f"{(6.0, 'x', Path('a/b'), None)} !\n"), (
        "twice, as the command's default"
    )
    assert program("4", "--by", "3").exit_code == 3


def test_from_python_it_is_the_function_alone(capsys):
    assert total(1, 2) == (3.0, None, None, None)
    assert capsys.readouterr().out == ""


def test_the_help_ends_where_the_docstring_turns_to_python(program):
    told = program("--help").output
    assert "All of them." in told
    assert "To add." in told
    assert "Args" not in told
    assert "progress" not in told
