"""`fisheye-bench gate`: exit statuses, what it prints, which files it leaves."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from junitparser import JUnitXml

from bench.evaluation import load_protocol
from bench.gate import find_baseline, read_run_sums, write_baseline
from bench.methods import build_method
from bench.recordings import load_card
from bench.recordings.cards import shipped_folder
from tests.support.commands import call, error_line
from tests.support.manifests import manifest
from tests.support.runs import run_one
from tests.support.stored_files import change_manifest


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
    write_baseline(read_run_sums(folder / "spherical"), folder / "baseline", allow_dirty=True)
    return {path.stem: path for path in folder.iterdir()}


def test_the_same_run_passes(monkeypatch, capsys, runs):
    assert call(monkeypatch, "gate", runs["spherical"], "--baseline", runs["baseline"]) == 0
    shown = capsys.readouterr().out
    assert "gate passed: " in shown
    assert "::error" not in shown


def test_without_a_named_baseline_the_usual_one_is_taken(monkeypatch, capsys, runs, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert call(monkeypatch, "gate", runs["spherical"]) == 3
    assert "reports/baselines/tiny: no baseline there" in capsys.readouterr().err
    assert call(monkeypatch, "gate", runs["spherical"], "--update", "--allow-dirty") == 0
    assert call(monkeypatch, "gate", runs["spherical"]) == 0
    assert "baseline reports/baselines/tiny\n" in capsys.readouterr().out
    assert find_baseline(manifest(protocol=load_protocol("extended-v1"))) == Path("reports/baselines/demo-extended-v1")
    assert find_baseline(manifest()) == shipped_folder("baselines") / "demo"


def test_a_gate_that_judges_nothing_has_the_status_of_one_without_a_baseline(monkeypatch, capsys, runs, tmp_path):
    write_baseline(read_run_sums(runs["few"]), tmp_path / "few", allow_dirty=True)
    junit = tmp_path / "gate.xml"
    words = ("--baseline", tmp_path / "few", "--junit", junit, "--github")
    assert call(monkeypatch, "gate", runs["few"], *words) == 3
    shown = capsys.readouterr()
    assert "error: nothing was judged" in shown.err
    assert "::error title=gate%3A no verdict::nothing was judged" in shown.out
    assert JUnitXml.fromfile(str(junit)).errors == 1
    assert "gate WITHOUT A VERDICT: " in shown.out
    assert "passed" not in shown.out


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
    first = shown.splitlines()[:15]
    assert first[0].startswith("gate FAILED: ")
    assert "changed: method: 'nothing', was 'spherical'" in first
    assert any(line.split()[:3] == ["failed", "all_moving", "iou"] for line in first)
    assert any(line.startswith("most of ") for line in first)
    assert any(f"fisheye-bench compare reports/runs/baseline {runs['nothing']}" in line for line in first)
    assert JUnitXml.fromfile(str(tmp_path / "ci" / "gate.xml")).failures > 0
    assert json.loads((tmp_path / "gate.json").read_text())["passed"] is False
    told = summary.read_text()
    assert told.startswith("earlier words\n## gate FAILED")
    assert "all_moving" in told


@pytest.mark.parametrize(
    ("run", "baseline", "status", "why"),
    [
        ("spherical", "none", 3, "no baseline there, so nothing was judged"),
        ("extended", "BASELINE", 2, "score with --protocol paper-v1, or replace the baseline with --update"),
        ("nowhere", "BASELINE", 2, "nowhere: expected the folder of a finished run"),
    ],
)
def test_no_verdict_is_handed_over_in_every_form(monkeypatch, capsys, runs, tmp_path, run, baseline, status, why):
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path / "summary.md"))
    files = ("--junit", tmp_path / "gate.xml", "--json", tmp_path / "gate.json", "--github")
    against = runs["baseline"] if baseline == "BASELINE" else tmp_path / baseline
    assert call(monkeypatch, "gate", runs.get(run, tmp_path / run), "--baseline", against, *files) == status
    shown = capsys.readouterr()
    assert (shown.err.startswith("error: "), shown.err.count("\n")) == (True, 1)
    assert "passed" not in shown.out
    (annotation,) = [line for line in shown.out.splitlines() if line.startswith("::error ")]
    content = json.loads((tmp_path / "gate.json").read_text())
    told = JUnitXml.fromfile(str(tmp_path / "gate.xml"))
    (case,) = [case for suite in told for case in suite]
    assert (content["passed"], told.errors) == (False, 1)
    summary = (tmp_path / "summary.md").read_text()
    for text in (shown.err, annotation, content["no_verdict"], case.result[0].message, summary):
        assert why in text
    assert "as in the baseline" not in summary


def test_update_shows_what_it_replaces(monkeypatch, capsys, runs, tmp_path):
    file, update = tmp_path / "b", ("--update", "--allow-dirty")
    told = {}
    for name in ("spherical", "nothing", "extended"):
        assert call(monkeypatch, "gate", runs[name], "--baseline", file, *update) == 0
        told[name] = capsys.readouterr().out
    assert told["spherical"].startswith("the first baseline of this name\n")
    assert f"{file}: spherical on tiny by paper-v1" in told["spherical"]
    assert "changed: method: 'nothing', was 'spherical'" in told["nothing"]
    assert any(line.split()[:3] == ["failed", "all_moving", "iou"] for line in told["nothing"].splitlines())
    assert "REPLACES WHAT DOES NOT COMPARE: the baseline is of protocol" in told["extended"]
    assert re.search(r"^[1-9]\d* of \d+ metrics can be judged$", told["nothing"], re.MULTILINE)


def test_update_says_at_once_that_a_baseline_can_judge_nothing(monkeypatch, capsys, runs, tmp_path):
    assert call(monkeypatch, "gate", runs["few"], "--baseline", tmp_path / "b", "--update", "--allow-dirty") == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert re.fullmatch(r"0 of \d+ metrics can be judged: 3 recordings, 6 needed", last)


PLUG_IN = """
import numpy as np

from bench.methods import Method, Segmentation


class Own(Method):
    name = "own"

    def segment(self, frame):
        return Segmentation(cell_size_px=1, mask=np.zeros(frame.valid.shape, bool))
"""


@pytest.mark.slow
def test_update_refuses_a_plug_in_that_is_not_committed_as_it_is(monkeypatch, capsys, tiny_card, tmp_path):
    checkout = tmp_path / "checkout"
    checkout.mkdir()
    (checkout / "own_for_the_gate.py").write_text(PLUG_IN)
    monkeypatch.syspath_prepend(str(checkout))
    git = ("git", "-C", str(checkout), "-c", "user.name=x", "-c", "user.email=x@x")
    baseline = ("--baseline", tmp_path / "b", "--update")

    def refused(number: int) -> str:
        out = tmp_path / f"run-{number}"
        options = ("--method", "own_for_the_gate:Own", "--protocol", "paper-v1", "--workers", 1, "--no-pictures")
        assert call(monkeypatch, "run", tiny_card, "--out", out, *options) == 0
        change_manifest(out, lambda content: content["code"].update(commit="c0ffee"))
        capsys.readouterr()
        status = call(monkeypatch, "gate", out, *baseline)
        assert status in (0, 2)
        return capsys.readouterr().err

    assert "the code of method 'own' is in no commit" in refused(1)
    subprocess.run([*git, "init", "-q"], check=True)
    assert "the code of method 'own' is in no commit" in refused(2)
    subprocess.run([*git, "add", "."], check=True)
    subprocess.run([*git, "commit", "-qm", "x"], check=True)
    assert refused(3) == ""
    assert (tmp_path / "b").exists()
    (checkout / "own_for_the_gate.py").write_text(PLUG_IN + "# changed\n")
    del sys.modules["own_for_the_gate"]
    assert "the method's files were changed on top of commit" in refused(4)


def test_update_refuses_changed_code_unless_told(monkeypatch, capsys, runs, tmp_path):
    folder = shutil.copytree(runs["spherical"], tmp_path / "run")
    change_manifest(folder, lambda content: content["code"].update(commit="0123456789abcdef+"))
    assert call(monkeypatch, "gate", folder, "--baseline", tmp_path / "b", "--update") == 2
    assert "--allow-dirty" in capsys.readouterr().err
    assert not (tmp_path / "b").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("RUN", "--tolerances", "default-v9"), "did you mean 'default-v1'"),
        (("RUN", "--update", "--github"), "--github: expected only with a verdict"),
    ],
)
def test_mistakes_are_one_clear_line_and_status_2(monkeypatch, capsys, runs, words, message):
    named = [runs["spherical"] if word == "RUN" else word for word in words]
    assert message in error_line(monkeypatch, capsys, "gate", *named, "--baseline", runs["baseline"])
