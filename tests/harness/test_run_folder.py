"""All files in the folder of a run are of one experiment, and nothing finished is touched before the new is whole."""

import json
import random
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from bench.api.runs import RUNS, default_folder, non_default_settings
from bench.errors import DataError
from bench.evaluation import load_protocol
from bench.harness import read_run
from bench.harness.run_folder import held_run_folder, new_results
from bench.methods import build_method
from bench.recordings import load_card
from tests.support.commands import call
from tests.support.processes import PATIENCE_S
from tests.support.runs import bytes_of, run_one, score
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


def test_overwriting_leaves_nothing_of_the_former_experiment(finished, tiny_card, monkeypatch, tmp_path):
    assert {"index.html", "pictures/crossing/panels.png"} <= everything_in(finished).keys()
    options = ("--method", "nothing", "--no-pictures", "--workers", 1)
    assert call(monkeypatch, "run", tiny_card, *options, "--out", finished, "--overwrite") == 0
    assert call(monkeypatch, "run", tiny_card, *options, "--out", tmp_path / "fresh") == 0
    found, fresh = everything_in(finished), everything_in(tmp_path / "fresh")
    assert found.keys() == fresh.keys()
    assert bytes_of(finished) == bytes_of(tmp_path / "fresh")


FOREIGN = {
    "notes.txt": lambda place: place.write_text("mine"),
    "table.csv": lambda place: (place.unlink(), place.symlink_to(place.with_name("elsewhere")))[0],
    "pictures/mine.png": lambda place: place.write_text("mine"),
    "units/mine.txt": lambda place: place.write_text("mine"),
    "units/a-00000001.unit": lambda place: place.write_text("mine"),
    "maps.npz": lambda place: place.write_text("mine"),
    "documents": lambda place: place.symlink_to("/usr"),
    "empty": Path.mkdir,
}


@pytest.mark.parametrize("name", FOREIGN)
@pytest.mark.parametrize("options", [(), ("--overwrite",)], ids=" ".join)
def test_a_folder_with_what_no_run_wrote_is_refused_at_once(finished, tiny_card, monkeypatch, capsys, name, options):
    (finished.parent / "elsewhere").write_text("mine")
    FOREIGN[name](finished / name)
    before = everything_in(finished)
    monkeypatch.setattr("bench.harness.run._score", None)
    words = ("run", tiny_card, "--method", "nothing", "--no-pictures", "--out", finished, "--workers", 1, *options)
    assert call(monkeypatch, *words) == 2
    shown = capsys.readouterr().err
    assert f"got one with {name}, which this program did not write" in shown
    assert "--out" in shown
    assert everything_in(finished) == before
    assert (finished.parent / "elsewhere").read_text() == "mine"


def test_the_working_folder_itself_may_be_that_of_the_run(tiny_card, tmp_path, monkeypatch):
    """Its own name never changes, so that it may be a mount point, too."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    inode = Path().stat().st_ino
    for method, options in (("everything", ()), ("nothing", ("--overwrite",))):
        words = ("run", tiny_card, "--method", method, "--no-pictures", "--out", ".", "--workers", 1, *options)
        assert call(monkeypatch, *words) == 0
        assert read_run(Path()).manifest.method.name == method
    assert (Path().stat().st_ino, (tmp_path / "here").stat().st_ino) == (inode, inode)


def test_results_that_cannot_be_finished_do_not_appear(finished, tiny_card):
    before = everything_in(finished)

    def finish(run):
        (run.folder / "table.md").write_text("half")
        raise OSError("the disk is full")

    with pytest.raises(OSError, match="the disk is full"):
        run_one(
            card=load_card(tiny_card),
            method=build_method("everything"),
            protocol=PAPER,
            out=finished,
            finish=finish,
        )
    assert everything_in(finished) == before
    assert not list(finished.glob(".*"))


@pytest.mark.parametrize("killed_at", range(6))
def test_a_process_that_is_killed_between_the_steps_of_the_renaming_leaves_one_whole_run(
    finished, monkeypatch, killed_at
):
    """Steps: the list of what comes, three files that come, the list of what is there."""

    class KilledError(BaseException):
        pass

    units = sorted(file.name for file in (finished / "units").iterdir())
    replace, left = Path.replace, [killed_at]

    def counted(self, target):
        if Path(target).parent in {finished, finished / "pictures"}:
            left[0] -= 1
            if left[0] < 0:
                raise KilledError
        return replace(self, target)

    with monkeypatch.context() as patched, suppress(KilledError):
        patched.setattr(Path, "replace", counted)
        patched.setattr(shutil, "rmtree", lambda *_, **__: None)  # as of a process that is no more
        with held_run_folder(finished), new_results(finished) as results:
            for name in ("summary.json", "table.md"):
                (results / name).write_text("new")
            (results / "pictures").mkdir()
            (results / "pictures/new.png").write_text("new")
    assert (left[0] < 0) == (killed_at < 5)
    with held_run_folder(finished):
        pass
    new = (finished / "summary.json").read_text() == "new"
    assert new == (killed_at >= 1), "once they are listed the new results are whole"
    assert (finished / "index.html").exists() == (not new)
    assert (finished / "pictures/crossing").exists() == (not new)
    assert (finished / "pictures/new.png").exists() == new
    assert sorted(file.name for file in (finished / "units").iterdir()) == units
    assert not list(finished.glob(".*"))


def write_extra(*folders: Path) -> None:
    for folder in folders:
        (folder / "extra.json").write_text(folder.name)


def test_what_comes_during_a_run_is_neither_replaced_nor_removed(finished):
    """A file of a result's name stops it, and one of another name stays."""
    told = r"got extra\.json, which came during the run; move it"
    with pytest.raises(DataError, match=told), held_run_folder(finished), new_results(finished) as results:
        write_extra(results, finished)
    assert (finished / "extra.json").read_text() == finished.name
    (finished / "extra.json").unlink()
    with held_run_folder(finished), new_results(finished) as results:
        shutil.rmtree(finished / "pictures")
        (finished / "pictures").symlink_to(finished.parent / "pictures")
        (finished.parent / "pictures/crossing").mkdir(parents=True)
        (finished.parent / "pictures/crossing/panels.png").write_text("mine")
        (finished / "notes.txt").write_text("mine")
        (results / "summary.json").write_text("new")
    assert (finished / "summary.json").read_text() == "new"
    assert (finished / "notes.txt").read_text() == "mine"
    assert (finished.parent / "pictures/crossing/panels.png").read_text() == "mine"
    assert not (finished / "cost.json").exists(), "the cost of other results"


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
    assert not list(out.glob(".*"))
