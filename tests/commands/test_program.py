"""What the program prints, its help and examples, and how it ends where it cannot work."""

import errno
import io
import json
import os
import re
import sys
from pathlib import Path
from queue import Queue

import pytest
import typer.main
from rich.console import Console

from bench.commands import console
from bench.commands.app import app, user_message
from bench.methods.settings import parse_values
from bench.recordings import load_card
from bench.reporting.document import Table
from tests.support import tiny
from tests.support.cards import write_card
from tests.support.commands import call, called_here, error_line, output_of


def test_the_help_ends_where_the_docstring_turns_to_python_and_takes_that_of_options_from_there():
    told = " ".join(output_of("sweep", "--help").split())
    assert "Each value is a run in the sweep's folder." in told
    assert "Set a parameter of the method, as YAML; one parameter has several values" in told
    assert "separated by commas (from Python a list); weights.epipolar names" in told
    assert not re.search("Args|Returns|progress|no-overwrite", told)


@pytest.fixture
def _program_runs():
    console.take_verbosity([])
    yield
    console.be_silent()


def watched(monkeypatch, *, terminal: bool) -> io.StringIO:
    """Where a bar is drawn."""
    shown = io.StringIO()
    there = Console(file=shown, force_terminal=terminal, width=140, color_system=None)
    monkeypatch.setattr(console, "Console", lambda **_: there)
    return shown


@pytest.mark.usefixtures("_program_runs")
def test_a_bar_tells_how_far_it_is_and_a_log_has_a_line_now_and_then_of_what_takes_long(monkeypatch):
    shown = watched(monkeypatch, terminal=True)
    with console.progress_bar("scoring", "images") as report:
        report(0, 0)
        report(50.5, 100)
    assert re.search("scoring .* 50/100 +images", shown.getvalue())
    shown = watched(monkeypatch, terminal=False)
    monkeypatch.setattr(console, "FIRST_LINE_S", 0.01)
    told = Queue()
    monkeypatch.setattr(console, "say", lambda line, **_: told.put(line))
    with console.progress_bar("scoring", "images") as report:
        assert re.fullmatch(r"scoring: 0/\? images after \d+ s", told.get()), "nothing is reported yet"
        report(500, 1000)
        line = next(line for line in iter(told.get, None) if "500" in line)
    assert re.fullmatch(r"scoring: 500/1000 images after \d+ s, about \d+ s left", line)
    assert shown.getvalue() == ""


@pytest.mark.usefixtures("_program_runs")
def test_no_number_of_a_wide_table_is_cut_where_there_is_no_terminal(capsys):
    numbers = [f"{k}.123456789" for k in range(9)]
    rows = [["a slice with a long name", "false_positive_coverage_valid", *numbers]]
    columns = ["Slice", "Metric", "95 %", *(f"{k} of all" for k in range(8))]
    console.print_blocks([Table(columns=columns, rows=rows, words=2)])
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[-9:] for line in lines].count(numbers) == 1, "words are wrapped instead"
    assert "95 %" in lines[0]


@pytest.mark.usefixtures("_program_runs")
def test_of_many_files_a_few_are_named(capsys):
    console.note_files([Path(f"runs/a/{k}.png") for k in range(3)])
    assert capsys.readouterr().out.split() == ["runs/a/0.png", "runs/a/1.png", "runs/a/2.png"]
    console.note_files(map(Path, ["runs/a/index.html", *(f"runs/a/figures-{k % 2}/{k}.pdf" for k in range(9))]))
    *_, fourth, more = capsys.readouterr().out.splitlines()
    assert (fourth, more) == ("runs/a/figures-0/2.pdf", "and 6 more files in runs/a")


def test_functions_print_nothing_where_no_program_runs(capsys):
    console.be_silent()
    console.note("cost")
    with console.interruptible("what is done"), console.progress_bar("scoring", "images") as report:
        report(1, 2)
    assert capsys.readouterr() == ("", "")
    with pytest.raises(KeyboardInterrupt), console.interruptible("what is done"):
        raise KeyboardInterrupt


def test_letters_that_the_output_has_no_code_for_are_shown(monkeypatch):
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding="ascii"))
    console.say("straße")
    assert written.getvalue() == b"stra\\xdfe\n"


OURS = "my-"  # what a reader puts their own name in for


def commands(group, before=""):
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, f"{before}{name} ")
        else:
            yield f"{before}{name}", command


COMMANDS = dict(commands(typer.main.get_command(app)))
EXAMPLES = [(name, line) for name, command in COMMANDS.items() for line in command.epilog.splitlines()[3:]]


def test_every_command_has_examples_which_its_help_shows_line_by_line():
    assert {name for name, _ in EXAMPLES} == COMMANDS.keys()
    for words in (("sweep",), ("annotate", "export")):
        shown = called_here(*words, "--help").stdout.splitlines()
        start = next(number for number, line in enumerate(shown) if line.strip() == "Examples:")
        lines = [line.strip() for line in shown[start + 1 :] if line.strip()]
        assert lines == [example for name, example in EXAMPLES if name == " ".join(words)]


def test_every_option_has_a_help():
    bare = {(name, one.name) for name, command in COMMANDS.items() for one in command.params if not one.help}
    assert not bare


@pytest.mark.parametrize(("command", "example"), EXAMPLES)
def test_an_example_is_parsed(command, example):
    assert f"{example} ".startswith(f"fisheye-bench {command} ")
    words = example.removeprefix(f"fisheye-bench {command}").split()
    found = COMMANDS[command].make_context(command, words).params
    dataset = found.get("dataset")
    assert dataset is None or dataset.startswith(OURS) or load_card(dataset).name == dataset
    for text in [*(found.get("set_") or ()), *(found.get("input_error") or ())]:
        name, _, values = text.partition("=")
        assert parse_values(name, values)


NOT_TEXT = b"caf\xe9"


def test_a_lack_of_memory_is_told_in_one_line_and_a_bug_keeps_its_traceback(monkeypatch, capsys):
    for lack in (MemoryError("12 GiB"), OSError(errno.ENOMEM, "no fork")):
        assert user_message(lack).startswith(f"expected memory and threads, got {type(lack).__name__}: ")

    def fail(_: object) -> None:
        raise OSError("no file is named")

    monkeypatch.setattr("bench.recordings.list_cards", fail)
    assert call(monkeypatch, "list", "datasets") == 70
    shown = capsys.readouterr().err
    assert "no file is named" in shown
    assert "Traceback" in shown


def test_names_that_are_not_utf_8_are_told(monkeypatch, capsys, tmp_path):
    told = error_line(monkeypatch, capsys, "run", os.fsdecode(NOT_TEXT))
    assert "expected arguments in UTF-8, got 'caf\\udce9'; rename the file or folder" in told
    drive = tiny.write_recording(tmp_path / "data" / "drive")
    write_card(tmp_path)
    image = drive / "images" / "front" / f"{tiny.TIMES_NS[1]}.png"
    image.rename(image.with_name(os.fsdecode(NOT_TEXT + b".png")))
    assert called_here("run", "x.yaml", "--out", "out", folder=tmp_path).returncode == 2
    done = called_here("validate", "x.yaml", "--json", "told.json", folder=tmp_path)
    assert (done.returncode, done.stderr) == (1, "")
    (recording,) = json.loads((tmp_path / "told.json").read_text())["recordings"]
    files = [finding["file"] for finding in recording["findings"]]
    assert f"data/drive/images/front/{os.fsdecode(NOT_TEXT)}.png" in files
    drive.rename(drive.with_name(os.fsdecode(NOT_TEXT)))
    for command in ("run", "validate"):
        done = called_here(command, "x.yaml", folder=tmp_path)
        told = "error: data: expected recordings with names in UTF-8, got 'caf\\udce9'; rename it\n"
        assert (done.returncode, done.stderr) == (2, told)
