"""Every command that writes, where it cannot: one line that names the place, status 2, and no half-written file.

Files that a command did not write are never replaced by its output; those that it wrote are.
"""

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

import bench
from tests.support.commands import call, error_line
from tests.support.processes import files_of

slow = pytest.mark.slow

FILE_SIZE = 150  # bytes that a process may write into one file, where a disk is to be full

# Words of each command; OUT is what cannot be written.
COMMANDS = {
    "run": ("run", "CARD", "--method", "nothing", "--no-pictures", "--workers", 1, "--out", "OUT"),
    "run, part": ("run", "CARD", "--method", "nothing", "--shard", "1/2", "--workers", 1, "--out", "OUT"),
    "evaluate": ("evaluate", "CARD", "--predictions", "PREDICTIONS", "--missing", "empty", "--workers", 1,
                 "--out", "OUT"),
    "report": ("report", "RUN", "--no-pictures", "--out", "OUT"),
    "compare": ("compare", "RUN", "OTHER", "--no-pictures", "--out", "OUT"),
    "leaderboard": ("leaderboard", "RUNS", "--out", "OUT"),
    "sweep": ("sweep", "CARD", "--set", "threshold=0.001,0.002", "--out", "OUT"),
    "audit": ("audit", "CARD", "--method", "nothing", "--recordings", 1, "--workers", 1, "--out", "OUT"),
    "view": ("view", "CARD", "--method", "nothing", "--out", "OUT"),
    "view, video": ("view", "CARD", "--method", "nothing", "--video", "OUT.mp4"),
    "view, log": ("view", "CARD", "--method", "nothing", "--rrd", "OUT.rrd"),
    "export": ("annotate", "export", "CARD", "--annotated", "--format", "openlabel", "--out", "OUT"),
    "reference": ("reference", "export", "CARD", "--workers", 1, "--out", "OUT"),
    "import": ("annotate", "import", "openlabel", "LABELS", "--dataset", "CARD", "--recording", "crossing",
               "--out", "OUT"),
    "synthesize": ("synthesize", "SCENARIO", "--workers", 1, "--out", "OUT"),
    "validate": ("validate", "CARD", "--json", "OUT"),
    "gate, junit": ("gate", "RUN", "--baseline", "BASELINE", "--junit", "OUT"),
    "gate, json": ("gate", "RUN", "--baseline", "BASELINE", "--json", "OUT"),
    "gate, update": ("gate", "RUN", "--update", "--baseline", "OUT"),
}  # fmt: skip


@pytest.fixture(scope="module")
def places(tiny_card, tmp_path_factory) -> dict[str, str]:
    """What the commands read."""
    folder = tmp_path_factory.mktemp("read")
    with pytest.MonkeyPatch.context() as monkeypatch:
        common = ("--no-pictures", "--workers", 1, "--protocol", "paper-v1")
        for name in ("nothing", "everything"):
            assert call(monkeypatch, "run", tiny_card, "--method", name, "--out", folder / "runs" / name, *common) == 0
        words = ("gate", folder / "runs" / "nothing", "--baseline", folder / "b", "--update")
        assert call(monkeypatch, *words) == 0
        words = ("annotate", "export", tiny_card, "--annotated", "--format", "openlabel", "--out", folder / "labels")
        assert call(monkeypatch, *words, "--split", "crossing") == 0
    *_, image = sorted((tiny_card.parent / "data" / "tiny" / "crossing" / "images" / "front").glob("*.png"))
    (folder / "predictions" / "crossing" / "front").mkdir(parents=True)
    cv2.imwrite(str(folder / "predictions" / "crossing" / "front" / image.name), np.zeros((240, 320), np.uint8))
    return {
        "CARD": str(tiny_card),
        "SCENARIO": str(tiny_card.parent / "tiny.scenario.yaml"),
        "PREDICTIONS": str(folder / "predictions"),
        "RUNS": str(folder / "runs"),
        "RUN": str(folder / "runs" / "nothing"),
        "OTHER": str(folder / "runs" / "everything"),
        "LABELS": str(next((folder / "labels").rglob("openlabel.json"))),
        "BASELINE": str(folder / "b"),
    }


def words_of(command: tuple[object, ...], places: dict[str, str], out: Path) -> list[str]:
    return [re.sub("[A-Z]+", lambda name: str((places | {"OUT": out})[name[0]]), str(word)) for word in command]


def one_line(told: str, *, about: Path) -> bool:
    *progress, line = told.splitlines()
    slow = all(" recordings after " in one for one in progress)  # of a machine that is busy
    return line.startswith("error: ") and str(about) in line and slow


# Outputs in the place of a file of the user's, by its name below OUT, or of a file of a run.
TAKEN = {
    "report": (("report", "RUN", "--no-pictures", "--out", "OUT/mine.html"), "mine.html"),
    "report, of the run": (("report", "RUN", "--no-pictures", "--out", "RUN/paper-v1/summary.json"), ""),
    "compare": (("compare", "RUN", "OTHER", "--no-pictures", "--out", "OUT"), "compare.md"),
    "leaderboard": (("leaderboard", "RUNS", "--out", "OUT"), "index.html"),
    "leaderboard, stored": (("leaderboard", "RUNS", "--out", "OUT"), "leaderboard.json"),
    "video": (("view", "CARD", "--recording", "crossing", "--video", "OUT/mine.mp4"), "mine.mp4"),
    "gate": (("gate", "RUN", "--baseline", "BASELINE", "--json", "OUT/mine.json"), "mine.json"),
    "gate, junit": (("gate", "RUN", "--baseline", "BASELINE", "--junit", "OUT/mine.xml"), "mine.xml"),
    "gate, sums of a run": (("gate", "RUN", "--baseline", "BASELINE", "--junit", "RUN/paper-v1/sums.csv"), ""),
    "gate, summary of a run": (("gate", "RUN", "--baseline", "BASELINE", "--json", "RUN/paper-v1/summary.json"), ""),
}


@pytest.mark.parametrize("name", TAKEN)
def test_a_file_of_the_users_or_of_a_run_stays(monkeypatch, capsys, places, tmp_path, name):
    run, out = shutil.copytree(places["RUN"], tmp_path / "run"), tmp_path / "out"
    words, there = TAKEN[name]
    out.mkdir()
    if there:
        (out / there).write_text("mine")
    before = {file: file.read_bytes() for file in [*out.iterdir(), *run.rglob("*")] if file.is_file()}
    line = error_line(monkeypatch, capsys, *words_of(words, places | {"RUN": str(run)}, out))
    assert "got a file that is there and is something else; move it away, or name another place" in line
    assert {file: file.read_bytes() for file in before} == before


@slow
@pytest.mark.parametrize("name", ["report", "compare", "leaderboard", "gate", "gate, junit"])
def test_an_earlier_output_is_replaced(monkeypatch, places, tmp_path, name):
    words = words_of(TAKEN[name][0], places, tmp_path / "out")
    assert call(monkeypatch, *words) == call(monkeypatch, *words) != 2


@slow
@pytest.mark.parametrize("name", COMMANDS)
def test_a_place_that_cannot_be_made(monkeypatch, capsys, places, tmp_path, name):
    if "log" in name:
        pytest.importorskip("rerun")
    above = tmp_path / "above"
    above.write_text("a file")
    assert call(monkeypatch, *words_of(COMMANDS[name], places, above / "out")) == 2
    told = capsys.readouterr().err
    assert one_line(told, about=above), told
    assert above.read_text() == "a file"


@slow
@pytest.mark.parametrize("name", COMMANDS)
def test_a_full_disk(monkeypatch, capsys, places, tmp_path, name):
    if "log" in name:
        pytest.importorskip("rerun")
    with files_of(FILE_SIZE):
        status = call(monkeypatch, *words_of(COMMANDS[name], places, tmp_path / "out"))
    told = capsys.readouterr().err
    assert status == 2, told
    assert one_line(told, about=Path("crossing.json") if name == "import" else tmp_path), told  # it tries elsewhere
    assert "free some disk space" in told
    assert [file for file in tmp_path.rglob("*") if file.is_file() and file.stat().st_size >= FILE_SIZE] == []
    assert [file for file in tmp_path.rglob(".*") if file.is_file()] == [], "nothing half-written stays"


@slow
@pytest.mark.parametrize("name", ["validate", "gate, junit", "report", "view, video"])
def test_a_folder_or_a_device_in_the_place_of_a_file(monkeypatch, capsys, places, tmp_path, name):
    folder = tmp_path / ("out.mp4" if "video" in name else "out")
    folder.mkdir()
    assert call(monkeypatch, *words_of(COMMANDS[name], places, tmp_path / "out")) == 2
    assert one_line(capsys.readouterr().err, about=folder)
    assert list(tmp_path.iterdir()) == [folder]
    if name != "view, video":
        assert call(monkeypatch, *words_of(COMMANDS[name], places, Path("/dev/full"))) == 2
        assert one_line(capsys.readouterr().err, about=Path("/dev/full"))
        assert Path("/dev/full").is_char_device()


@slow
@pytest.mark.parametrize("suffix", [".mp4", ".webm"])
def test_a_film_that_is_cut_is_no_film(monkeypatch, capsys, places, tmp_path, suffix):
    def film(name: str) -> int:
        words = ("--method", "nothing", "--recording", "crossing", "--video", tmp_path / f"{name}{suffix}")
        return call(monkeypatch, "view", places["CARD"], *words)

    assert film("whole") == 0
    size = (tmp_path / f"whole{suffix}").stat().st_size
    for missing in (size // 2, size // 50, 100):
        capsys.readouterr()
        with files_of(size - missing):
            assert film("cut") == 2
        told = capsys.readouterr().err
        assert f"cut{suffix}: expected a writable path, got a file that ends before" in told
        assert one_line(told, about=tmp_path)
        assert [path.name for path in tmp_path.iterdir()] == [f"whole{suffix}"]


def judged(places, run, output):
    words = ("gate", places[run], "--baseline", places["BASELINE"])
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    command = [sys.executable, "-m", "bench", *words]
    return subprocess.run(command, stdout=output, stderr=subprocess.PIPE, text=True, env=environment, check=False)


@slow
def test_a_full_disk_behind_the_output_is_told(places):
    with Path("/dev/full").open("w") as full:
        ended = judged(places, "RUN", full)
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1)
    assert ended.stderr.startswith("error: standard output: ")


@slow
def test_a_reader_who_goes_away_changes_no_verdict(places):
    read, write = os.pipe()
    os.close(read)
    ended = judged(places, "OTHER", write)
    os.close(write)
    assert (ended.returncode, ended.stderr.count("\n")) == (3, 1)
    assert ended.stderr.startswith("error: nothing was judged"), "three recordings are too few"


# Who writes beside `bench.atomic`, and tells in one line what cannot be written.
WRITERS = {
    "egomotion/files.py": "to the temporary file of its caller",
    "recordings/contract.py": "copies in a temporary folder",
}


def test_files_and_folders_are_written_in_one_place():
    folder = Path(bench.__file__).parent
    found: dict[str, list[str]] = {}
    for file in folder.rglob("*.py"):
        if file.name == "atomic.py":
            continue
        for node in ast.walk(ast.parse(file.read_text())):
            writes = isinstance(node, ast.Attribute) and node.attr in {"write_text", "write_bytes", "mkdir", "touch"}
            if writes and "temporary" not in ast.unparse(node.value):
                found.setdefault(file.relative_to(folder).as_posix(), []).append(ast.unparse(node))
    assert found.keys() == WRITERS.keys(), found
