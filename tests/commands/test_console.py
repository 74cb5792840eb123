"""A progress bar tells the rate and the time that is left, and nothing where nobody watches."""

import io
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


def watched(monkeypatch, *, terminal: bool, now=lambda: 0.0) -> io.StringIO:
    """Where a bar is drawn."""
    shown = io.StringIO()
    there = Console(file=shown, force_terminal=terminal, width=140, color_system=None, get_time=now)
    monkeypatch.setattr(progress, "Console", lambda **_: there)
    monkeypatch.setattr(progress, "monotonic", now)
    return shown


@pytest.mark.parametrize(("each_s", "rate"), [(0.5, "20.0 images/s"), (40.0, "15.0 images/min")])
def test_the_rate_and_the_time_left_are_shown(monkeypatch, each_s, rate):
    now = [0.0]
    shown = watched(monkeypatch, terminal=True, now=lambda: now[0])
    with progress.progress_bar("scoring", "images") as report:
        report(0, 100)
        for done in range(10, 60, 10):
            now[0] += each_s
            report(done, 100)
    last = shown.getvalue().splitlines()[-2]
    assert "50/100 images" in last
    assert rate in last
    left_s = int(5 * each_s + 0.5)
    assert f"left 0:0{left_s // 60}:{left_s % 60:02d}" in last


def test_a_log_has_no_bar_but_a_line_now_and_then_of_what_takes_long(monkeypatch, capsys):
    shown = watched(monkeypatch, terminal=False)
    monkeypatch.undo()
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
    assert lines[0] == "scoring: 10/1000 images after 10 s, about 990 s left"
    assert lines[1].startswith("scoring: 20/1000 images after 20 s")
    assert 20 < len(lines) < 50, "ever fewer"


def test_the_time_left_is_told_when_three_are_done_that_were_not_there_before(monkeypatch, capsys):
    now = [0.0]
    monkeypatch.setattr(progress, "monotonic", lambda: now[0])
    with progress.progress_bar("rendering", "recordings") as report:
        for done in range(4, 8):
            report(done, 20)
            now[0] += 30.0
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        "rendering: 5/20 recordings after 30 s",
        "rendering: 6/20 recordings after 60 s",
        "rendering: 7/20 recordings after 90 s, about 390 s left",
    ]


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
