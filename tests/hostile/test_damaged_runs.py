"""A damaged file of a stored run ends every command that reads it in one line, and never with the gate's verdict."""

import json
import shutil
from pathlib import Path

import pytest

from bench.recordings.checked_json import DIGEST, with_digest
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


def flip(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


def raise_a_digit(file: Path) -> None:
    """Still JSON, and still a figure."""
    text = file.read_text()
    assert '"value": 1.0' in text or '"recordings": 3' in text
    file.write_text(text.replace('"value": 1.0', '"value": 0.5', 1).replace('"recordings": 3', '"recordings": 4', 1))


def with_changed_content(file: Path, change) -> None:
    """As by somebody who knows the digest."""
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(with_digest(content)))


def without_digest(file: Path) -> None:
    """A method of 99.9 %, as by somebody who leaves the digest out."""
    content = json.loads(file.read_text())
    content["all_moving"]["iou"]["value"] = 0.999
    file.write_text(json.dumps({name: value for name, value in content.items() if name != DIGEST}))


DAMAGE = {  # file, and what is done to it
    "not UTF-8": ("summary.json", lambda file: file.write_bytes(b"\xff\xfe" + file.read_bytes())),
    "cut short": ("summary.json", lambda file: file.write_bytes(file.read_bytes()[:-100])),
    "another figure": ("summary.json", raise_a_digit),
    "without its digest": ("summary.json", without_digest),
    "a row missing": ("summary.json", lambda f: with_changed_content(f, lambda c: c["categories"].pop("crossing"))),
    "an unknown row": (
        "summary.json", lambda f: with_changed_content(f, lambda c: c["categories"].update(flying=c["all_moving"]))
    ),
    "a figure missing": ("summary.json", lambda f: with_changed_content(f, lambda c: c["all_moving"].pop("iou"))),
    "a level missing": (
        "summary.json", lambda f: with_changed_content(f, lambda c: c["all_moving"].pop("detection_rate_10")),
    ),
    "a version to come": ("summary.json", lambda f: with_changed_content(f, lambda c: c.update(schema_version=99))),
    "a flipped bit in the objects": ("objects.parquet", flip),
    "a flipped bit in the frames": ("frames.parquet", flip),
    "a flipped bit in the maps": ("image_maps.npz", flip),
    "a flipped bit in the sums": ("sums.csv", flip),
    "a flipped bit in the masks": ("masks.parquet", flip),
    "another run's tables": ("objects.parquet", lambda f: shutil.copy(f.parents[1] / "nothing/objects.parquet", f)),
}  # fmt: skip
COMMANDS = {
    "report": lambda f: ("report", f / "everything", "--no-pictures"),
    "gate": lambda f: ("gate", f / "everything", "--baseline", f / "baseline"),
    "compare": lambda f: ("compare", f / "nothing", f / "everything", "--no-pictures", "--out", f / "out"),
    "leaderboard": lambda f: ("leaderboard", f),
}


@pytest.mark.parametrize("what", DAMAGE)
def test_runs(whole, tmp_path, monkeypatch, capsys, what):
    folder, (name, damage) = shutil.copytree(whole, tmp_path / "runs"), DAMAGE[what]
    damage(folder / "everything" / name)
    for words in COMMANDS.values():
        assert call(monkeypatch, *words(folder)) == 2
        shown = capsys.readouterr()
        told = shown.err + shown.out
        assert str(folder / "everything" / "summary.json") in told or str(folder / "everything" / name) in told
        assert "Traceback" not in told


@pytest.mark.parametrize("name", ["sums.csv", "manifest.json"])
@pytest.mark.parametrize("damage", [flip, lambda file: file.write_bytes(b"\xff" + file.read_bytes())])
def test_baselines(whole, tmp_path, monkeypatch, capsys, damage, name):
    folder = shutil.copytree(whole, tmp_path / "runs")
    damage(folder / "baseline" / name)
    assert_refused(folder / "baseline" / name, monkeypatch, capsys)


def test_an_edited_baseline(whole, tmp_path, monkeypatch, capsys):
    """Another layout is no other content; another content is refused, as valid as it is."""
    folder = shutil.copytree(whole, tmp_path / "runs")
    manifest, sums = folder / "baseline" / "manifest.json", folder / "baseline" / "sums.csv"
    content, rows = json.loads(manifest.read_text()), sums.read_bytes()
    manifest.write_text(json.dumps(content))
    sums.write_bytes(rows.replace(b"\n", b"\r\n"))
    assert call(monkeypatch, *COMMANDS["gate"](folder)) == 3, "too few recordings for a verdict"
    capsys.readouterr()
    sums.write_bytes(b"".join(rows.splitlines(keepends=True)[:-1]))
    assert_refused(sums, monkeypatch, capsys)
    sums.write_bytes(rows)
    manifest.write_text(json.dumps(content | {"reference": "another"}))
    assert_refused(manifest, monkeypatch, capsys)


def assert_refused(file: Path, monkeypatch, capsys) -> None:
    shown = error_line(monkeypatch, capsys, *COMMANDS["gate"](file.parents[1]))
    assert shown.startswith(f"error: {file}: ")


def test_a_fault_of_ours_is_no_verdict(whole, monkeypatch, capsys):
    def fault(*_, **__):
        raise KeyError("crossing")

    monkeypatch.setattr("bench.gate.judge", fault)
    assert call(monkeypatch, *COMMANDS["gate"](whole)) == 70
    assert "KeyError" in capsys.readouterr().err


def test_a_run_of_an_older_version_is_read(whole, tmp_path, monkeypatch):
    folder = shutil.copytree(whole, tmp_path / "runs")
    with_changed_content(folder / "everything" / "summary.json", lambda content: content["all_moving"].keys())
    assert call(monkeypatch, *COMMANDS["report"](folder)) == 0
