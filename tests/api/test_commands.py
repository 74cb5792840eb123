"""Functions of the commands: what they return, and what they refuse; what is computed and written is tested there."""

import json

import pytest

import bench
from bench.commands import console
from bench.errors import UnknownNameError, UsageError


@pytest.fixture(scope="module")
def folder(tiny_card, tmp_path_factory):
    """Two runs of the same data, for all functions that read runs."""
    folder = tmp_path_factory.mktemp("runs")
    for method in ("frame-difference", "nothing"):
        bench.run(tiny_card, method, protocol="paper-v1", pictures=False, out=folder / method)
    return folder


@pytest.fixture
def runs(folder):
    return folder / "frame-difference", folder / "nothing"


def test_a_comparison_takes_folders_and_runs_and_writes_where_it_is_told(runs, tmp_path):
    before, after = bench.load_run(runs[0]), str(runs[1])
    found = bench.compare(before, after, out=tmp_path / "c", pictures=False)
    (pair,) = found.pairs
    assert tmp_path / "c" / "compare.html" in found.files
    assert pair.detections["after"].iloc[-1] == 0
    with pytest.raises(UsageError, match="at least two runs"):
        bench.compare(before)


def test_a_verdict_is_that_of_the_command(runs, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    none = bench.judge(runs[0])
    assert (none.passed, none.run.dataset.name) == (False, "tiny")
    assert "no baseline there" in none.why_none
    assert bench.judge(tmp_path / "none").run is None
    made = bench.judge(runs[0], update=True)
    assert made.stored.endswith("metrics can be judged: cases of both in 3 recordings, 6 are needed")
    verdict, same = bench.judge(runs[1]), bench.judge(bench.load_run(runs[1]), made.baseline_folder)
    assert repr(verdict.rows) == repr(same.rows) == repr(bench.judge(runs[1], runs[0]).rows)
    assert not verdict.passed
    again = bench.judge(runs[0], update=True)
    assert repr(again.rows) == repr(bench.judge(runs[0]).rows)
    bench.write_verdict(none, junit=str(tmp_path / "gate.xml"), json=tmp_path / "gate.json")
    assert "no baseline there" in (tmp_path / "gate.xml").read_text()
    assert json.loads((tmp_path / "gate.json").read_text())["passed"] is False
    with pytest.raises(UnknownNameError, match="tolerances"):
        bench.judge(runs[0], tolerances="strict")


def test_values_to_sweep_may_be_parts_of_settings_and_must_be_there(tiny_card):
    with pytest.raises(UsageError, match="'weights' already has the value 1"):
        bench.sweep(tiny_card, settings={"weights": 1, "weights.epipolar": [0.0, 1.0]})
    with pytest.raises(UsageError, match="got none"):
        bench.sweep(tiny_card, settings={"weights": {"epipolar": []}})


def test_a_frame_is_drawn_and_nothing_is_printed(tiny_card, tmp_path, capfd):
    console.be_silent()  # as a process is that has run no command line
    found = bench.view(tiny_card, method="nothing", frame=3, out=str(tmp_path / "one"))
    assert tmp_path / "one" / "areas.png" in found.files
    assert capfd.readouterr() == ("", "")
