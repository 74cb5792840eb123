"""What is printed of long work and of many files, and that nothing is where nobody watches."""

import io
import re
from pathlib import Path

import pytest
from rich.console import Console

from bench.commands import console, progress
from bench.reporting.document import Table


@pytest.fixture(autouse=True)
def _program_runs():
    console.take_verbosity([])
    yield
    console.be_silent()


def watched(monkeypatch, *, terminal: bool) -> io.StringIO:
    """Where a bar is drawn."""
    shown = io.StringIO()
    there = Console(file=shown, force_terminal=terminal, width=140, color_system=None)
    monkeypatch.setattr(progress, "Console", lambda **_: there)
    return shown


def test_a_bar_tells_how_far_it_is(monkeypatch):
    shown = watched(monkeypatch, terminal=True)
    with progress.progress_bar("scoring", "images") as report:
        report(0, 0)
        report(50.5, 100)
    assert "scoring" in shown.getvalue()
    assert re.search("50/100 +images", shown.getvalue())


def test_a_log_has_no_bar_but_a_line_now_and_then_of_what_takes_long(monkeypatch, capsys):
    shown = watched(monkeypatch, terminal=False)
    now = [0.0]
    monkeypatch.setattr(progress, "monotonic", lambda: now[0])
    with progress.progress_bar("scoring", "images") as report:
        report(5, 10)
    assert (shown.getvalue(), capsys.readouterr().err) == ("", "")
    with progress.progress_bar("scoring", "images") as report:
        for second in range(0, 1000, 5):
            now[0] = float(second)
            report(second, 1000)
    lines = capsys.readouterr().err.splitlines()
    assert lines[:2] == ["scoring: 10/1000 images after 10 s", "scoring: 20/1000 images after 20 s"]
    assert 20 < len(lines) < 50, "ever fewer"


def test_no_number_of_a_wide_table_is_cut_where_there_is_no_terminal(capsys):
    numbers = [f"{k}.123456789" for k in range(9)]
    rows = [["a slice with a long name", "false_positive_coverage_valid", *numbers]]
    columns = ["Slice", "Metric", "95 %", *(f"{k} of all" for k in range(8))]
    console.print_blocks([Table(columns=columns, rows=rows, words=2)])
    heading, *_, row = capsys.readouterr().out.splitlines()
    assert row.split()[-9:] == numbers
    assert "95 %" in heading


def test_of_many_files_a_few_are_named(capsys):
    console.note_files([Path(f"runs/a/{k}.png") for k in range(3)])
    assert capsys.readouterr().out.split() == ["runs/a/0.png", "runs/a/1.png", "runs/a/2.png"]
    console.note_files(map(Path, ["runs/a/index.html", *(f"runs/a/figures-{k % 2}/{k}.pdf" for k in range(9))]))
    *_, fourth, more = capsys.readouterr().out.splitlines()
    assert fourth == "runs/a/figures-0/2.pdf"
    assert more == "and 6 more files in runs/a"


def test_functions_print_nothing_where_no_program_runs(monkeypatch, capsys):
    console.be_silent()
    console.note("cost")
    with progress.interruptible("what is done"), progress.progress_bar("scoring", "images") as report:
        report(1, 2)
    assert capsys.readouterr() == ("", "")
    with pytest.raises(KeyboardInterrupt), progress.interruptible("what is done"):
        raise KeyboardInterrupt
