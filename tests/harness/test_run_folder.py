"""All files in the folder of a run are of one experiment, and nothing finished is touched before the new is whole."""

import json
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bench.api.runs import RUNS, default_folder, non_default_settings
from bench.errors import DataError
from bench.evaluation import load_protocol
from bench.harness import RunRequest, run_benchmark
from bench.harness.run_folder import held_run_folder, new_results
from bench.methods import build_method
from bench.recordings import load_card
from tests.support.commands import call
from tests.support.processes import PATIENCE_S
from tests.support.runs import bytes_of, score
from tests.support.troubled_runs import environment

pytestmark = pytest.mark.slow

PAPER = load_protocol("paper-v1")
KILLS = 4


def everything_in(folder: Path) -> dict[str, bytes]:
    """Every file of results, by its path."""
    files = (path for path in folder.rglob("*") if path.is_file())
    found = {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}
    return {name: content for name, content in found.items() if not name.startswith("units/")}


OTHERS = {
    "method": (("--method", "nothing"), "method 'nothing', was 'everything'"),
    "settings": (("--method", "spherical", "--set", "threshold=0.01"), "method 'spherical', was 'everything'"),
    "protocol": (("--method", "everything", "--protocol", "extended-v1"), ", was paper-v1 version 1 ("),
    "split": (("--method", "everything", "--split", "moving"), "split 'moving', was none"),
}


@pytest.fixture(scope="module")
def finished_once(tiny_card, tmp_path_factory) -> Path:
    """A finished run with its page."""
    run = tmp_path_factory.mktemp("finished") / "run"
    with pytest.MonkeyPatch.context() as patched:
        assert call(patched, "run", tiny_card, "--method", "everything", "--out", run, "--workers", 1) == 0
        assert call(patched, "report", run, "--no-pictures") == 0
    return run


@pytest.fixture
def finished(finished_once, tmp_path) -> Path:
    return shutil.copytree(finished_once, tmp_path / "run")


@pytest.mark.parametrize("other", OTHERS)
def test_another_experiment_is_refused_and_the_finished_one_stays(finished, tiny_card, monkeypatch, capsys, other):
    words, told = OTHERS[other]
    before = everything_in(finished)
    assert call(monkeypatch, "run", tiny_card, *words, "--out", finished, "--workers", 1) == 2
    shown = capsys.readouterr().err
    assert told in shown
    assert "--overwrite" in shown
    assert everything_in(finished) == before


def test_other_settings_of_the_same_method_are_named(tiny_card, tmp_path):
    score(tiny_card, tmp_path / "run", settings={"threshold": 1e-3})
    with pytest.raises(DataError, match=r"another one: threshold = 0\.01, was 0\.001; give another folder"):
        score(tiny_card, tmp_path / "run", settings={"threshold": 1e-2})


@pytest.mark.parametrize("words", [("--split", "nosuch"), ("--set", "nosuch=1"), ("--protocol", "nosuch")])
def test_a_mistake_in_the_command_destroys_nothing(finished, tiny_card, monkeypatch, words):
    before = everything_in(finished)
    named = ("run", tiny_card, "--method", "everything", "--out", finished, "--workers", 1, "--overwrite")
    assert call(monkeypatch, *named, *words) == 2
    assert everything_in(finished) == before


def test_overwriting_leaves_nothing_of_the_former_experiment_and_keeps_what_is_the_users(
    finished, tiny_card, monkeypatch, tmp_path
):
    (finished / "notes.txt").write_text("mine")
    assert {"index.html", "pictures/crossing/panels.png"} <= everything_in(finished).keys()
    options = ("--method", "nothing", "--no-pictures", "--workers", 1)
    assert call(monkeypatch, "run", tiny_card, *options, "--out", finished, "--overwrite") == 0
    assert call(monkeypatch, "run", tiny_card, *options, "--out", tmp_path / "fresh") == 0
    found, fresh = everything_in(finished), everything_in(tmp_path / "fresh")
    assert found.pop("notes.txt") == b"mine"
    assert found.keys() == fresh.keys()
    assert bytes_of(finished) == bytes_of(tmp_path / "fresh")
    assert not list(tmp_path.glob(".*"))


def test_results_that_cannot_be_finished_do_not_appear(finished, tiny_card):
    before = everything_in(finished)

    def finish(results, _):
        (results / "table.md").write_text("half")
        raise OSError("the disk is full")

    with pytest.raises(OSError, match="the disk is full"):
        run_benchmark(
            RunRequest(card=load_card(tiny_card), method=build_method("everything"), protocol=PAPER, out=finished),
            finish=finish,
        )
    assert everything_in(finished) == before
    assert not list(finished.parent.glob(".*"))


@pytest.mark.parametrize("killed_at", range(5))
def test_a_process_that_is_killed_between_the_steps_of_the_renaming_leaves_one_whole_run(
    finished, monkeypatch, killed_at
):
    """Steps: each work folder moves, what is the user's moves, the old results go, the new ones come."""

    class KilledError(BaseException):
        pass

    (finished / "notes.txt").write_text("mine")
    units = sorted(file.name for file in (finished / "units").iterdir())
    rename, left = Path.rename, [killed_at]

    def counted(self, target):
        left[0] -= 1
        if left[0] < 0:
            raise KilledError
        return rename(self, target)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "rename", counted)
        try:
            with held_run_folder(finished), new_results(finished) as results:
                (results / "summary.json").write_text("new")
        except KilledError:
            killed = True
        else:
            killed = False
    assert killed == (killed_at < 4)
    with held_run_folder(finished):
        pass
    new = (finished / "summary.json").read_text() == "new"
    assert new == (killed_at >= 3), "from the last but one step on the new results are whole"
    assert (finished / "index.html").exists() == (not new)
    assert (finished / "notes.txt").read_text() == "mine"
    assert sorted(file.name for file in (finished / "units").iterdir()) == units
    assert not list(finished.parent.glob(".*"))


def test_what_a_run_wrote_is_never_covered_by_what_was_there(finished):
    """Neither by an old cost, nor by a file of the same name that nobody knows."""
    for name in ("cost.json", "extra.json"):
        (finished / name).write_text("old")
    with held_run_folder(finished), new_results(finished) as results:
        (results / "extra.json").write_text("new")
    assert (finished / "extra.json").read_text() == "new"
    assert not (finished / "cost.json").exists(), "the cost of other results"


def test_a_folder_that_was_removed_by_hand_stays_removed(finished):
    """What a killed process had begun beside it does not take its place."""
    finished.rename(finished.with_name(".run.new"))
    with held_run_folder(finished):
        assert not (finished / "summary.json").exists()


def test_the_default_folder_tells_settings_protocol_and_split_apart(tiny_card):
    card = load_card(tiny_card)

    def named(settings=None, protocol="paper-v1", split=None) -> str:
        method = build_method("spherical", settings or {})
        folder = default_folder(
            card, method.name, non_default_settings(method, "spherical"), load_protocol(protocol), split
        )
        assert folder.parent == RUNS
        return folder.name

    assert named() == "tiny-spherical"
    assert named({"threshold": 0.01}) == "tiny-spherical-threshold-0.01"
    assert named(protocol="extended-v1", split="moving") == "tiny-spherical-extended-v1-moving"
    long = [named({"weights": {"epipolar": weight}, "threshold": 1 / 3, "flow": "dis"}) for weight in (0.1, 0.2)]
    assert long[0] != long[1]
    assert all(len(name) < 140 and "/" not in name for name in long)


@pytest.mark.slow
def test_kills_at_random_instants_and_then_the_same_as_without(tiny_card, tmp_path, monkeypatch):
    """A finished run of the same experiment lies in the folder all the time, and is whole after every kill."""

    def words(out: Path, workers: int) -> list[str]:
        options = ("--method", "everything", "--no-cache", "--workers", str(workers))
        return ["run", str(tiny_card), "--out", str(out), *options]

    def start(out: Path, workers: int) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "bench", *words(out, workers)]
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment())

    calm, out = tmp_path / "calm", tmp_path / "run"
    begun = time.monotonic()
    assert start(calm, 1).wait(PATIENCE_S) == 0
    whole_s = time.monotonic() - begun
    expected = bytes_of(calm)
    draw, kills = random.Random(20), 0
    for number in range(3 * KILLS):
        process = start(out, 1 + kills % 2)  # with two workers one may still write when the first process is gone
        try:
            process.wait(timeout=draw.uniform(0.3, 1.0) * whole_s)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
            kills += 1
        if (out / "summary.json").exists():
            assert bytes_of(out) == expected, f"after start {number}"
            json.loads((out / "table.json").read_text())
        if kills == KILLS:
            break
        if number % 3 == 2:
            shutil.rmtree(out / "units", ignore_errors=True)  # or there would soon be nothing left to interrupt
            (out / "units").mkdir(parents=True, exist_ok=True)
    assert kills == KILLS
    assert call(monkeypatch, *words(out, 1)) == 0
    assert bytes_of(out) == expected
    assert everything_in(out).keys() == everything_in(calm).keys()
    assert not list(tmp_path.glob(".*"))
