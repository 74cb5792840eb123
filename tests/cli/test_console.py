"""A progress bar tells the rate and the time that is left, and nothing where nobody watches."""

import io

import pytest
from rich.console import Console

from bench.cli import console


def watched(monkeypatch, *, terminal: bool, now=lambda: 0.0) -> io.StringIO:
    """Where a bar is drawn."""
    shown = io.StringIO()
    there = Console(file=shown, force_terminal=terminal, width=140, color_system=None, get_time=now)
    monkeypatch.setattr(console, "Console", lambda **_: there)
    return shown


@pytest.mark.parametrize(("each_s", "rate"), [(0.5, "20.0 images/s"), (40.0, "15.0 images/min")])
def test_the_rate_and_the_time_left_are_shown(monkeypatch, each_s, rate):
    now = [0.0]
    shown = watched(monkeypatch, terminal=True, now=lambda: now[0])
    with console.progress_bar("scoring", "images") as report:
        report(0, 100)
        for done in range(10, 60, 10):
            now[0] += each_s
            report(done, 100)
    last = shown.getvalue().splitlines()[-2]
    assert "50/100 images" in last
    assert rate in last
    left_s = int(5 * each_s + 0.5)
    assert f"left 0:0{left_s // 60}:{left_s % 60:02d}" in last


def test_nothing_is_shown_where_nobody_watches(monkeypatch):
    shown = watched(monkeypatch, terminal=False)
    with console.progress_bar("scoring", "images") as report:
        report(5, 10)
    assert shown.getvalue() == ""
