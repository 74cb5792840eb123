"""`fisheye-bench gate`: exit statuses, what it prints, which files it leaves."""

import json
import re
import shutil
from pathlib import Path

import pytest
from junitparser import JUnitXml

from bench.evaluation.protocol import load_protocol
from bench.gate.baseline import find_baseline, read_run_sums, write_baseline
from bench.methods import build_method
from bench.recordings import load_card
from bench.recordings.cards import shipped_folder
from tests.support.commands import call, error_line, output_of
from tests.support.manifests import manifest
from tests.support.runs import run_one


@pytest.fixture(scope="module")
def runs(tiny_card, tmp_path_factory) -> dict[str, Path]:
    """Runs of the paper's method and of one that finds nothing, with a baseline of the former; of two data sets.

    The tiny data set has three recordings, too few for a verdict; the other has each of them twice.
    """
    folder, data = tmp_path_factory.mktemp("gate"), tmp_path_factory.mktemp("data")
    shutil.copytree(tiny_card.parent, data, dirs_exist_ok=True)
    for recording in sorted((data / "data" / "tiny").iterdir()):
        if recording.is_dir():
            again = shutil.copytree(recording, recording.with_name(f"{recording.name}-again"))
            head = json.loads((again / "recording.json").read_text())
            (again / "recording.json").write_text(json.dumps(head | {"name": again.name}))
    card, protocol = load_card(str(data / tiny_card.name)), load_protocol("paper-v1")
    few = run_one(
        card=load_card(str(tiny_card)), method=build_method("spherical"), protocol=protocol, out=folder / "few"
    )
    assert few.images.evaluated
    for name in ("spherical", "nothing"):
        run_one(card=card, method=build_method(name), protocol=protocol, out=folder / name)
    run_one(card=card, method=build_method("nothing"), protocol=load_protocol("extended-v1"), out=folder / "extended")
    write_baseline(read_run_sums(folder / "spherical"), folder / "baseline")
    return {path.stem: path for path in folder.iterdir()}


def test_without_a_named_baseline_the_usual_one_is_taken(monkeypatch, capsys, runs, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert call(monkeypatch, "gate", runs["spherical"]) == 3
    assert "reports/baselines/tiny: no baseline there" in capsys.readouterr().err
    assert call(monkeypatch, "gate", runs["spherical"], "--update") == 0
    shown = output_of("gate", runs["spherical"])
    assert "gate passed: " in shown
    assert "::error" not in shown
    assert "baseline reports/baselines/tiny\n" in shown
    assert find_baseline(manifest(protocol=load_protocol("extended-v1"))) == Path("reports/baselines/demo-extended-v1")
    assert find_baseline(manifest()) == shipped_folder("baselines") / "demo"
    assert find_baseline(manifest(), own=True) == Path("reports/baselines/demo")


def test_a_worse_run_fails_in_every_form(monkeypatch, runs, tmp_path):
    summary = tmp_path / "summary.md"
    summary.write_text("earlier words\n")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(summary))
    files = ("--junit", tmp_path / "ci" / "gate.xml", "--json", tmp_path / "gate.json")
    shown = output_of("gate", runs["nothing"], "--baseline", runs["baseline"], *files, "--github", status=1)
    lines = [line for line in shown.splitlines() if line.startswith("::error ")]
    assert 0 < len(lines) <= 10
    first = shown.splitlines()[:15]
    assert first[0].startswith("gate FAILED: ")
    assert "changed: method: 'nothing', was 'spherical'" in first
    assert any(line.split()[:3] == ["failed", "all_moving", "iou"] for line in first)
    assert any(line.startswith("most of ") for line in first)
    assert any(f"fisheye-bench compare reports/runs/baseline {runs['nothing']}" in line for line in first)
    wanted = f"  fisheye-bench gate {runs['nothing']} --baseline {runs['baseline']} --update"
    assert f"make this run the baseline, and commit it:\n{wanted}\n" in shown
    assert JUnitXml.fromfile(str(tmp_path / "ci" / "gate.xml")).failures > 0
    assert json.loads((tmp_path / "gate.json").read_text())["passed"] is False
    told = summary.read_text()
    assert told.startswith("earlier words\n## gate FAILED")
    assert "all_moving" in told


@pytest.mark.parametrize(
    ("run", "baseline", "status", "why"),
    [
        ("spherical", "none", 3, "no baseline there, so nothing was judged"),
        ("few", "few", 3, "nothing was judged; a verdict needs metrics that decide"),
        ("extended", "baseline", 2, "the baseline is of protocol paper-v1"),
        ("nowhere", "baseline", 2, "nowhere: expected the folder of a finished run"),
    ],
)
def test_no_verdict_is_handed_over_in_every_form(monkeypatch, capsys, runs, tmp_path, run, baseline, status, why):
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path / "summary.md"))
    files = ("--junit", tmp_path / "gate.xml", "--json", tmp_path / "gate.json", "--github")
    words = (runs.get(run, tmp_path / run), "--baseline", runs.get(baseline, tmp_path / baseline))
    assert call(monkeypatch, "gate", *words, *files) == status
    shown = capsys.readouterr()
    assert (shown.err.startswith("error: "), shown.err.count("\n")) == (True, 1)
    assert "gate passed" not in shown.out
    (annotation,) = [line for line in shown.out.splitlines() if line.startswith("::error ")]
    content = json.loads((tmp_path / "gate.json").read_text())
    told = JUnitXml.fromfile(str(tmp_path / "gate.xml"))
    assert (content["passed"], told.errors) == (False, 1)
    case = next(case for suite in told for case in suite)
    for text in (shown.err, annotation, content["no_verdict"], case.result[0].message):
        assert why in text
    assert why in (tmp_path / "summary.md").read_text()


def test_update_shows_what_it_replaces_and_what_it_accepts(monkeypatch, capsys, runs, tmp_path):
    file, update = tmp_path / "b", "--update"
    told = {}
    for name in ("spherical", "nothing", "extended", "few"):
        assert call(monkeypatch, "gate", runs[name], "--baseline", file, update) == 0
        told[name] = capsys.readouterr().out
    assert told["spherical"].startswith("the first baseline of this name\n")
    assert f"{file}: spherical on tiny by paper-v1" in told["spherical"]
    assert "accepts" not in told["spherical"]
    assert "changed: method: 'nothing', was 'spherical'" in told["nothing"]
    assert any(line.split()[:3] == ["failed", "all_moving", "iou"] for line in told["nothing"].splitlines())
    assert "the new baseline accepts what failed by the one before it" in told["nothing"]
    assert "REPLACES WITHOUT COMPARING: the baseline is of protocol" in told["extended"]
    assert re.search(r"^[1-9]\d* of \d+ metrics can be judged$", told["nothing"], re.MULTILINE)
    last = told["few"].splitlines()[-1]
    assert re.fullmatch(r"0 of \d+ metrics can be judged: cases of both in 3 recordings, 6 are needed", last)


def test_update_refuses_what_is_no_run(monkeypatch, capsys, tmp_path):
    words = ("gate", tmp_path, "--baseline", tmp_path / "b", "--update")
    assert "expected the folder of a finished run" in error_line(monkeypatch, capsys, *words)
    assert not (tmp_path / "b").exists()
