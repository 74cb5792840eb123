"""Stored runs that others sent: nothing in them is imported, and what is damaged in them ends a command in one line."""

import shutil
from functools import partial

import pytest

from tests.hostile.files import NO_FILES
from tests.support import tiny
from tests.support.cards import write_card
from tests.support.commands import call, error_line
from tests.support.limits import at_most
from tests.support.planting import change_json
from tests.support.runs import score
from tests.support.stored_files import change_manifest

pytestmark = pytest.mark.slow

TRAP = """
from pathlib import Path

Path(__file__).with_name("sprung").touch()


class Trap:
    def __init__(self, **settings):
        Path(__file__).with_name("sprung").touch()
"""


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A folder of two runs and a baseline."""
    folder = tmp_path_factory.mktemp("stored")
    tiny.write_recording(folder / "data/drive")
    card = write_card(folder)
    for method in ("spherical", "everything"):
        score(card, folder / "runs" / method, method=method)
    with pytest.MonkeyPatch.context() as patched:
        words = ("--baseline", folder / "baseline", "--update")
        assert call(patched, "gate", folder / "runs/everything", *words) == 0
    return folder


@pytest.fixture
def folder(whole, tmp_path):
    return shutil.copytree(whole, tmp_path / "folder")


COMMANDS = {
    "report": lambda f: ("report", f / "runs/everything", "--no-pictures"),
    "report with pictures": lambda f: ("report", f / "runs/everything"),
    "gate": lambda f: ("gate", f / "runs/everything", "--baseline", f / "baseline"),
    "compare": lambda f: (
        *("compare", f / "runs/spherical", f / "runs/everything"), "--no-pictures", "--out", f / "out",
    ),
    "leaderboard": lambda f: ("leaderboard", f / "runs", "--out", f / "board"),
    "verify": lambda f: ("verify", f / "runs/everything", "--data", f / "x.yaml"),
}  # fmt: skip


@pytest.mark.parametrize("command", ["report", "report with pictures", "compare", "leaderboard", "gate"])
def test_what_a_run_names_is_not_imported(folder, tmp_path, monkeypatch, command):
    (tmp_path / "plug").mkdir()
    (tmp_path / "plug" / "trap_module.py").write_text(TRAP)
    monkeypatch.syspath_prepend(str(tmp_path / "plug"))
    named = {"name": "trap_module:Trap", "place": "trap_module:Trap", "settings": {"args": ["touch", "x"]}}
    for run in (folder / "runs").iterdir():
        change_manifest(run, lambda content: content["method"].update(named))
    assert call(monkeypatch, *COMMANDS[command](folder)) in {0, 3}  # too few recordings to judge
    assert not (tmp_path / "plug" / "sprung").exists()


def cut(file):
    file.write_bytes(file.read_bytes()[:-100])


def not_text(file):
    file.write_bytes(b"\xff\xfe" + file.read_bytes())


def replaced(file, what):
    file.unlink()
    NO_FILES[what](file)


a_pipe, a_device = (partial(replaced, what=what) for what in ("pipe", "device"))


OF_ALL, OF_TABLES = ("report", "gate", "compare", "leaderboard", "verify"), ("report", "compare", "verify")
DAMAGE = {  # file, what is done to it, and the commands that read it
    "not UTF-8": ("summary.json", not_text, OF_ALL),
    "cut short": ("summary.json", cut, OF_ALL),
    "a pipe": ("summary.json", a_pipe, OF_ALL),
    "a device": ("summary.json", a_device, ("report", "gate")),
    "a figure missing": ("summary.json", partial(change_json, change=lambda c: c["all_moving"].pop("iou")), OF_ALL),
    "a version to come": ("summary.json", partial(change_json, change=lambda c: c.update(schema_version=99)), OF_ALL),
    "a protocol in a pipe": ("protocol.json", a_pipe, ("report",)),
    "sums that are no text": ("sums.csv", not_text, ("gate", "compare", "verify")),
    "sums in a pipe": ("sums.csv", a_pipe, ("gate",)),
    "objects cut short": ("*.objects.parquet", cut, OF_TABLES),
    "objects in a pipe": ("*.objects.parquet", a_pipe, ("report",)),
    "frames cut short": ("*.frames.parquet", cut, OF_TABLES),
}


@pytest.mark.parametrize("what", DAMAGE)
def test_a_damaged_file_is_told_and_never_a_verdict(folder, monkeypatch, capsys, what):
    name, damage, readers = DAMAGE[what]
    file = sorted((folder / "runs/everything").rglob(name))[0]
    damage(file)
    for command in readers:
        with at_most(60):
            assert call(monkeypatch, *COMMANDS[command](folder)) == 2, command
        told = "".join(capsys.readouterr())
        assert str(file.parent) in told, command
        assert "Traceback" not in told


def test_answers_that_are_cut_short_are_found_by_verify(folder, monkeypatch, capsys):
    cut(sorted((folder / "runs/everything").glob("answers/**/*.parquet"))[0])
    assert call(monkeypatch, *COMMANDS["verify"](folder)) == 1
    assert "status evaluated, counted again failed" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("damage", [not_text, a_pipe])
@pytest.mark.parametrize("name", ["sums.csv", "manifest.json"])
def test_baselines(folder, monkeypatch, capsys, name, damage):
    damage(folder / "baseline" / name)
    with at_most(60):
        shown = error_line(monkeypatch, capsys, *COMMANDS["gate"](folder))
    assert shown.startswith(f"error: {folder / 'baseline' / name}: ")
