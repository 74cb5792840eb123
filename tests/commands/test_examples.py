"""The examples in the help of every command can be typed: options, values and names that they have are there."""

import pytest
import typer.main

from bench.commands.app import app
from bench.commands.examples import EXAMPLES
from bench.methods.settings import split_values
from bench.recordings import load_card
from tests.support.commands import called_here

PROGRAM = typer.main.get_command(app)
OURS = "my-"  # what a reader puts their own name in for


def commands(group, before=""):
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, f"{before}{name} ")
        elif not command.hidden:
            yield f"{before}{name}", command


def test_every_command_has_one_to_three():
    assert EXAMPLES.keys() == dict(commands(PROGRAM)).keys()
    assert all(1 <= len(examples) <= 3 for examples in EXAMPLES.values())


@pytest.mark.parametrize(("command", "example"), [(name, one) for name, all in EXAMPLES.items() for one in all])
def test_an_example_is_parsed(command, example):
    assert f"{example} ".startswith(f"{command} ")
    words = example.removeprefix(command).split()
    found = dict(commands(PROGRAM))[command].make_context(command, words).params
    dataset = found.get("dataset")
    assert dataset is None or dataset.startswith(OURS) or load_card(dataset).name == dataset
    for text in [*(found.get("set_") or ()), *(found.get("input_error") or ())]:
        name, _, values = text.partition("=")
        assert split_values(name, values)


def test_the_help_shows_them_line_by_line():
    for words in (("sweep",), ("annotate", "export")):
        shown = called_here(*words, "--help").stdout.splitlines()
        start = next(number for number, line in enumerate(shown) if line.strip() == "Examples:")
        lines = [line.strip() for line in shown[start + 1 :] if line.strip()]
        assert lines == [f"fisheye-bench {example}" for example in EXAMPLES[" ".join(words)]]


@pytest.mark.parametrize("example", EXAMPLES["list"])
def test_examples_that_need_no_data_run(example):
    done = called_here(*example.split())
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.count("\n") > 3
