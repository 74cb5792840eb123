"""Every command that writes, where it cannot: one line that names the place, status 2, and no half-written file."""

import ast
import io
import os
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

import bench
from bench.commands import console
from tests.support.commands import call
from tests.support.processes import files_of

pytestmark = pytest.mark.slow

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
    "audit": ("audit", "CARD", "--method", "nothing", "--recordings", 1, "--workers", 1, "--no-pictures",
              "--out", "OUT"),
    "view": ("view", "CARD", "--method", "nothing", "--out", "OUT"),
    "view, video": ("view", "CARD", "--method", "nothing", "--video", "OUT.avi"),
    "view, log": ("view", "CARD", "--method", "nothing", "--rrd", "OUT.rrd"),
    "export": ("annotate", "export", "CARD", "--annotated", "--format", "openlabel", "--out", "OUT"),
    "reference": ("reference", "export", "CARD", "--workers", 1, "--out", "OUT"),
    "import": ("annotate", "import", "openlabel", "LABELS", "--dataset", "CARD", "--recording", "crossing",
               "--out", "OUT"),
    "synthesize": ("synthesize", "SCENARIO", "--workers", 1, "--out", "OUT"),
    "validate": ("validate", "CARD", "--json", "OUT"),
    "gate, junit": ("gate", "RUN", "--baseline", "BASELINE", "--junit", "OUT"),
    "gate, json": ("gate", "RUN", "--baseline", "BASELINE", "--json", "OUT"),
    "gate, update": ("gate", "RUN", "--allow-dirty", "--update", "--baseline", "OUT"),
}  # fmt: skip


@pytest.fixture(scope="module")
def places(tiny_card, tmp_path_factory) -> dict[str, str]:
    """What the commands read."""
    folder = tmp_path_factory.mktemp("read")
    with pytest.MonkeyPatch.context() as monkeypatch:
        common = ("--no-pictures", "--workers", 1, "--protocol", "paper-v1")
        for name in ("nothing", "everything"):
            assert call(monkeypatch, "run", tiny_card, "--method", name, "--out", folder / "runs" / name, *common) == 0
        words = ("gate", folder / "runs" / "nothing", "--baseline", folder / "b", "--update", "--allow-dirty")
        assert call(monkeypatch, *words) == 0
        words = ("annotate", "export", tiny_card, "--annotated", "--format", "openlabel", "--out", folder / "labels")
        assert call(monkeypatch, *words, "--recording", "crossing") == 0
    shutil.copytree(folder / "runs" / "nothing", folder / "copy")
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
        "COPY": str(folder / "copy"),
        "LABELS": str(next((folder / "labels").rglob("openlabel.json"))),
        "BASELINE": str(folder / "b"),
    }


def words_of(name: str, places: dict[str, str], out: Path) -> list[str]:
    named = [places.get(str(word), str(word)) for word in COMMANDS[name]]
    return [str(out) + word.removeprefix("OUT") if word.startswith("OUT") else word for word in named]


def one_line(told: str, *, about: Path) -> bool:
    *progress, line = told.splitlines()
    slow = all(" recordings after " in one for one in progress)  # of a machine that is busy
    return line.startswith("error: ") and str(about) in line and slow


@pytest.mark.parametrize("name", COMMANDS)
def test_a_place_that_cannot_be_made(monkeypatch, capsys, places, tmp_path, name):
    if "log" in name:
        pytest.importorskip("rerun")
    above = tmp_path / "above"
    above.write_text("a file")
    assert call(monkeypatch, *words_of(name, places, above / "out")) == 2
    told = capsys.readouterr().err
    assert one_line(told, about=above), told
    assert above.read_text() == "a file"


@pytest.mark.parametrize("name", COMMANDS)
def test_a_full_disk(monkeypatch, capsys, places, tmp_path, name):
    if "log" in name:
        pytest.importorskip("rerun")
    with files_of(FILE_SIZE):
        status = call(monkeypatch, *words_of(name, places, tmp_path / "out"))
    told = capsys.readouterr().err
    assert status == 2, told
    assert one_line(told, about=Path("crossing.json") if name == "import" else tmp_path), told  # it tries elsewhere
    assert "free some disk space" in told
    assert [file for file in tmp_path.rglob("*") if file.is_file() and file.stat().st_size >= FILE_SIZE] == []
    assert [file for file in tmp_path.rglob(".*") if file.is_file()] == [], "nothing half-written stays"


@pytest.mark.parametrize("name", ["validate", "gate, junit", "gate, json", "report", "view, video"])
def test_a_folder_or_device_in_the_place_of_a_file(monkeypatch, capsys, places, tmp_path, name):
    folder = tmp_path / ("out.avi" if "video" in name else "out")
    folder.mkdir()
    assert call(monkeypatch, *words_of(name, places, tmp_path / "out")) == 2
    assert one_line(capsys.readouterr().err, about=folder)
    assert list(tmp_path.iterdir()) == [folder]


def test_a_device_is_not_replaced(monkeypatch, capsys, places):
    assert call(monkeypatch, "gate", places["RUN"], "--baseline", places["BASELINE"], "--json", "/dev/full") == 2
    assert one_line(capsys.readouterr().err, about=Path("/dev/full"))
    assert Path("/dev/full").is_char_device()


@pytest.mark.parametrize("name", ["index.html", "figures"])
def test_a_run_in_which_a_page_cannot_be_written(monkeypatch, capsys, places, tmp_path, name):
    run = shutil.copytree(places["RUN"], tmp_path / "run")
    place = run / "paper-v1" / name
    place.mkdir() if name == "index.html" else place.write_text("a file")
    assert call(monkeypatch, "report", run, "--no-pictures") == 2
    assert one_line(capsys.readouterr().err, about=run / "paper-v1" / name)


@pytest.mark.parametrize("suffix", [".avi", ".mp4", ".webm"])
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


def test_a_full_disk_behind_the_output_is_told(places):
    command = [sys.executable, "-m", "bench", "gate", places["RUN"], "--baseline", places["BASELINE"]]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, env=environment, check=False)
    assert ended.returncode == 2
    assert ended.stderr.startswith("error: standard output: ")
    assert ended.stderr.count("\n") == 1


def test_a_reader_who_goes_away_changes_no_verdict(monkeypatch, places):
    words = ["gate", places["OTHER"], "--baseline", places["BASELINE"]]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    read, write = os.pipe()
    os.close(read)
    ended = subprocess.run(
        [sys.executable, "-m", "bench", *words], stdout=write, stderr=subprocess.PIPE, env=environment, check=False
    )
    os.close(write)
    assert ended.returncode == call(monkeypatch, *words)
    assert ended.stderr.count(b"\n") == 1
    assert ended.stderr.startswith(b"error: nothing was judged"), "three recordings are too few"


def test_letters_that_the_output_has_no_code_for_are_shown(monkeypatch):
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding="ascii"))
    console.say("straße")
    assert written.getvalue() == b"stra\\xdfe\n"


def test_a_bug_keeps_its_traceback(monkeypatch, capsys, places):
    def fail(_: object) -> None:
        raise OSError("no file is named")

    monkeypatch.setattr("bench.recordings.list_cards", fail)
    monkeypatch.setattr(sys, "argv", ["fisheye-bench", "list", "datasets"])
    from bench.commands.app import main

    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 70
    shown = capsys.readouterr().err
    assert "no file is named" in shown
    assert "Traceback" in shown


# Who writes beside `bench.atomic`, and tells in one line what cannot be written.
WRITERS = {
    "egomotion/tum.py": "to the temporary file of its caller",
    "recordings/contract.py": "copies in a temporary folder",
}


def test_files_and_folders_are_written_in_one_place():
    folder = Path(bench.__file__).parent
    found: dict[str, list[str]] = {}
    for file in folder.rglob("*.py"):
        if file.name in {"atomic.py", "film.py"}:
            continue
        for node in ast.walk(ast.parse(file.read_text())):
            writes = isinstance(node, ast.Attribute) and node.attr in {"write_text", "write_bytes", "mkdir", "touch"}
            if writes and "temporary" not in ast.unparse(node.value):
                found.setdefault(file.relative_to(folder).as_posix(), []).append(ast.unparse(node))
    assert found.keys() == WRITERS.keys(), found
