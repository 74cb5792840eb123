"""A damaged file of a stored run ends every command that reads it in one line, and never with the gate's verdict."""

import json
import shutil
from pathlib import Path

import pytest

from tests.support.commands import call, error_line

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def whole(tiny_card, tmp_path_factory) -> Path:
    """A folder of two runs and a baseline."""
    folder = tmp_path_factory.mktemp("stored")
    with pytest.MonkeyPatch.context() as patched:
        for method in ("nothing", "everything"):
            words = ("--method", method, "--workers", 1, "--no-pictures", "--out", folder / method)
            assert call(patched, "run", tiny_card, *words) == 0
        words = ("--baseline", folder / "baseline", "--update", "--allow-dirty")
        assert call(patched, "gate", folder / "everything", *words) == 0
    return folder


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-100])


def edited(change):
    def edit(file: Path) -> None:
        content = json.loads(file.read_text())
        change(content)
        file.write_text(json.dumps(content))

    return edit


def not_text(file: Path) -> None:
    file.write_bytes(b"\xff\xfe" + file.read_bytes())


COMMANDS = {
    "report": lambda f: ("report", f / "everything", "--no-pictures"),
    "gate": lambda f: ("gate", f / "everything", "--baseline", f / "baseline"),
    "compare": lambda f: ("compare", f / "nothing", f / "everything", "--no-pictures", "--out", f / "out"),
    "leaderboard": lambda f: ("leaderboard", f),
    "verify": lambda f: ("verify", f / "everything"),
}
OF_ALL, OF_TABLES = tuple(COMMANDS), ("report", "compare", "verify")
DAMAGE = {  # file, what is done to it, and the commands that read it
    "not UTF-8": ("summary.json", not_text, OF_ALL),
    "cut short": ("summary.json", cut, OF_ALL),
    "a row missing": ("summary.json", edited(lambda c: c["categories"].pop("crossing")), OF_ALL),
    "an unknown row": ("summary.json", edited(lambda c: c["categories"].update(flying=c["all_moving"])), OF_ALL),
    "a figure missing": ("summary.json", edited(lambda c: c["all_moving"].pop("iou")), OF_ALL),
    "a level missing": ("summary.json", edited(lambda c: c["all_moving"].pop("detection_rate_10")), OF_ALL),
    "a version to come": ("summary.json", edited(lambda c: c.update(schema_version=99)), OF_ALL),
    "sums that are no text": ("sums.csv", not_text, ("gate", "compare", "verify")),
    "objects cut short": ("*.objects.parquet", cut, OF_TABLES),
    "frames cut short": ("*.frames.parquet", cut, OF_TABLES),
    "maps cut short": ("*.map.npz", cut, ("report",)),
}


@pytest.mark.parametrize("what", DAMAGE)
def test_runs(whole, tmp_path, monkeypatch, capsys, what):
    folder, (name, damage, readers) = shutil.copytree(whole, tmp_path / "runs"), DAMAGE[what]
    file = sorted((folder / "everything").rglob(name))[0]
    damage(file)
    for command in readers:
        assert call(monkeypatch, *COMMANDS[command](folder)) == 2, command
        shown = capsys.readouterr()
        told = shown.err + shown.out
        assert str(file.parent) in told, command
        assert "Traceback" not in told


def test_answers_cut_short_are_not_what_was_scored(whole, tmp_path, monkeypatch, capsys):
    folder = shutil.copytree(whole, tmp_path / "runs")
    cut(sorted((folder / "everything" / "answers").rglob("*.parquet"))[0])
    assert call(monkeypatch, *COMMANDS["verify"](folder)) == 1
    assert "status evaluated, counted again failed" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("name", ["sums.csv", "manifest.json"])
def test_baselines(whole, tmp_path, monkeypatch, capsys, name):
    folder = shutil.copytree(whole, tmp_path / "runs")
    not_text(folder / "baseline" / name)
    shown = error_line(monkeypatch, capsys, *COMMANDS["gate"](folder))
    assert shown.startswith(f"error: {folder / 'baseline' / name}: ")


def test_a_fault_of_ours_is_no_verdict(whole, monkeypatch, capsys):
    def fault(*_, **__):
        raise KeyError("crossing")

    monkeypatch.setattr("bench.gate.judge", fault)
    assert call(monkeypatch, *COMMANDS["gate"](whole)) == 70
    assert "KeyError" in capsys.readouterr().err
