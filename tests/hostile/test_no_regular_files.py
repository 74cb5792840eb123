"""Pipes, devices and folders in the place of files: each is an error that names it, and nothing waits for it."""

import os
import shutil

import pytest

from tests.support import tiny
from tests.support.cards import write_card
from tests.support.commands import called_here
from tests.support.limits import at_most
from tests.support.runs import score

DRIVE = "data/drive"
FIRST = tiny.TIMES_NS[0]
KINDS = {
    "pipe": os.mkfifo,
    "device": lambda path: path.symlink_to("/dev/zero"),
    "folder": lambda path: path.mkdir(),
}


@pytest.fixture(autouse=True)
def _never_waits():
    with at_most(60):
        yield


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A data set, and a run of it."""
    folder = tmp_path_factory.mktemp("whole")
    tiny.write_recording(folder / DRIVE)
    score(write_card(folder), folder / "runs" / "nothing", method="nothing")
    return folder


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "name",
    [
        "x.yaml",
        *(f"{DRIVE}/{name}" for name in ("recording.json", "annotations.json", "egomotion.csv", "ego_body/front.png")),
        *(f"{DRIVE}/images/front/{FIRST}.png", f"{DRIVE}/lidar/{tiny.TIMES_NS[1]}.npz"),
    ],
)
def test_files_of_a_data_set(whole, tmp_path, kind, name):
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    (tmp_path / name).unlink()
    KINDS[kind](tmp_path / name)
    for words in (
        ("run", "x.yaml", "--method", "nothing", "--out", "out", "--no-pictures"),
        ("validate", "x.yaml"),
    ):
        done = called_here(*words, folder=tmp_path)
        assert done.returncode in {1, 2}, words
        assert name.rpartition("/")[2].partition(".")[0] in done.stdout + done.stderr
        assert "Traceback" not in done.stderr


READ_BY = {
    "summary.json": ("report", "leaderboard", "gate"),
    "protocol.json": ("report", "leaderboard", "gate"),
    "sums.csv": ("report", "gate"),
    "*.objects.parquet": ("report",),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", READ_BY)
def test_files_of_a_run(whole, tmp_path, kind, name):
    run = shutil.copytree(whole / "runs" / "nothing", tmp_path / "runs" / "nothing")
    file = next(run.rglob(name))
    file.unlink()
    KINDS[kind](file)
    words = {
        "report": (run, "--no-pictures"),
        "leaderboard": (tmp_path / "runs", "--out", tmp_path / "out"),
        "gate": (run, "--baseline", whole / "runs" / "nothing" / "paper-v1"),
    }
    for command in READ_BY[name]:
        done = called_here(command, *words[command], folder=tmp_path)
        assert done.returncode == 2, (command, done.stdout)
        assert file.name in done.stdout + done.stderr
        assert "Traceback" not in done.stderr


@pytest.mark.parametrize("name", ["manifest.json", "sums.csv"])
def test_files_of_a_baseline(whole, tmp_path, name):
    baseline = shutil.copytree(whole / "runs" / "nothing" / "paper-v1", tmp_path / "baseline")
    (baseline / name).unlink()
    os.mkfifo(baseline / name)
    done = called_here("gate", whole / "runs" / "nothing", "--baseline", baseline, folder=tmp_path)
    assert done.returncode == 2
    assert f"{name}: expected" in done.stderr


def test_a_pipe_among_the_predictions(whole, tmp_path):
    place = tmp_path / "masks" / "front"
    place.mkdir(parents=True)
    os.mkfifo(place / f"{FIRST + 66_666_667}.png")
    done = called_here("evaluate", whole / "x.yaml", "--predictions", tmp_path / "masks", folder=tmp_path)
    assert done.returncode == 2
    assert "1 unusable" in done.stderr
