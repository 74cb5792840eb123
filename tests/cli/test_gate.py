"""`fisheye-bench gate`: exit statuses, what it prints, which files it leaves."""

import json
from pathlib import Path

import pytest
from junitparser import JUnitXml

from bench.evaluation import load_protocol
from bench.gate import scored_run, write_baseline
from bench.harness import run_benchmark
from bench.methods import build_method
from bench.recordings import load_card
from tests.cli.test_commands import call


@pytest.fixture(autouse=True)
def _at_a_desk(monkeypatch):
    monkeypatch.delenv("GITHUB_STEP_SUMMARY", raising=False)


@pytest.fixture(scope="module")
def runs(tiny_card, tmp_path_factory) -> dict[str, Path]:
    """Runs of the paper's method and of one that finds nothing, with a baseline of the former."""
    folder = tmp_path_factory.mktemp("gate")
    card, protocol = load_card(str(tiny_card)), load_protocol("paper-v1")
    for name in ("spherical", "nothing"):
        run_benchmark(card, method=build_method(name), protocol=protocol, out=folder / name)
    run_benchmark(card, method=build_method("nothing"), protocol=load_protocol("extended-v1"), out=folder / "extended")
    write_baseline(scored_run(folder / "spherical"), folder / "baseline.json", allow_dirty=True)
    return {path.stem: path for path in folder.iterdir()}


def test_the_same_run_passes(monkeypatch, capsys, runs):
    assert call(monkeypatch, "gate", runs["spherical"], "--baseline", runs["baseline"]) == 0
    shown = capsys.readouterr().out
    assert "gate passed: " in shown
    assert "::error" not in shown


def test_a_worse_run_fails_in_every_form(monkeypatch, capsys, runs, tmp_path):
    summary = tmp_path / "summary.md"
    summary.write_text("earlier words\n")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(summary))
    files = ("--junit", tmp_path / "ci" / "gate.xml", "--json", tmp_path / "gate.json")
    assert call(monkeypatch, "gate", runs["nothing"], "--baseline", runs["baseline"], *files, "--github") == 1
    shown = capsys.readouterr().out
    assert "gate FAILED: " in shown
    lines = [line for line in shown.splitlines() if line.startswith("::error ")]
    assert 0 < len(lines) <= 10
    assert JUnitXml.fromfile(str(tmp_path / "ci" / "gate.xml")).failures > 0
    assert json.loads((tmp_path / "gate.json").read_text())["passed"] is False
    told = summary.read_text()
    assert told.startswith("earlier words\n## gate FAILED")
    assert "all_moving" in told


def test_a_missing_baseline_has_a_status_of_its_own(monkeypatch, capsys, runs, tmp_path):
    assert call(monkeypatch, "gate", runs["spherical"], "--baseline", tmp_path / "none.json") == 3
    shown = capsys.readouterr()
    assert shown.err.startswith("error: ")
    assert "nothing was judged" in shown.err
    assert shown.err.count("\n") == 1
    assert "passed" not in shown.out


def test_update_writes_a_baseline_that_the_run_passes(monkeypatch, capsys, runs, tmp_path):
    file = tmp_path / "baselines" / "tiny.json"
    assert call(monkeypatch, "gate", runs["nothing"], "--baseline", file, "--update", "--allow-dirty") == 0
    assert f"{file}: nothing on tiny by paper-v1" in capsys.readouterr().out
    assert call(monkeypatch, "gate", runs["nothing"], "--baseline", file) == 0


def test_update_refuses_changed_code_unless_told(monkeypatch, capsys, runs, tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    for name in ("objects.parquet", "frames.parquet", "protocol.json", "summary.json"):
        (folder / name).write_bytes((runs["spherical"] / name).read_bytes())
    summary = json.loads((folder / "summary.json").read_text())
    summary["provenance"]["commit"] = "0123456789abcdef+"
    (folder / "summary.json").write_text(json.dumps(summary))
    assert call(monkeypatch, "gate", folder, "--baseline", tmp_path / "b.json", "--update") == 2
    assert "--allow-dirty" in capsys.readouterr().err
    assert not (tmp_path / "b.json").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("nowhere",), "nowhere/summary.json"),
        (("RUN", "--tolerances", "default-v9"), "did you mean 'default-v1'"),
        (("EXTENDED",), "protocol 'paper-v1 version 1"),
        (("RUN", "--update", "--github"), "--github: wanted only with a verdict"),
    ],
)
def test_mistakes_are_one_clear_line_and_status_2(monkeypatch, capsys, runs, words, message):
    places = {"RUN": str(runs["spherical"]), "EXTENDED": str(runs["extended"])}
    named = [places.get(word, word) for word in words]
    assert call(monkeypatch, "gate", *named, "--baseline", runs["baseline"]) == 2
    shown = capsys.readouterr().err
    assert message in shown
    assert shown.startswith("error: ")
    assert shown.count("\n") == 1
