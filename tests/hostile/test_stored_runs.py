"""Nothing that a stored run says is imported or called."""

import json
import shutil
from pathlib import Path

import pytest

from bench.recordings.checked_json import with_digest
from tests.support.commands import call
from tests.support.runs import score

pytestmark = pytest.mark.slow

TRAP = """
from pathlib import Path

Path(__file__).with_name("sprung").touch()


class Trap:
    def __init__(self, **settings):
        Path(__file__).with_name("sprung").touch()
"""


@pytest.fixture
def trap(tmp_path, monkeypatch) -> Path:
    """Says whether its module was imported; what the trapped files name is `trap_module:Trap`."""
    (tmp_path / "plug").mkdir()
    (tmp_path / "plug" / "trap_module.py").write_text(TRAP)
    monkeypatch.syspath_prepend(str(tmp_path / "plug"))
    return tmp_path / "plug" / "sprung"


def set_trap(file: Path, trap: Path) -> None:
    """Let a stored file name other code in every place where it names a method."""
    content = json.loads(file.read_text())
    method = content["manifest"]["method"] if "manifest" in content else content["method"]
    method |= {"name": "trap_module:Trap", "place": "trap_module:Trap", "settings": {"args": ["touch", str(trap)]}}
    file.write_text(json.dumps(with_digest(content)))


@pytest.fixture(scope="module")
def runs(tiny_card, tmp_path_factory) -> list[Path]:
    """Two finished runs."""
    folders = []
    for name in ("spherical", "nothing"):
        folders.append(tmp_path_factory.mktemp("runs") / name)
        score(tiny_card, folders[-1], method=name)
    return folders


@pytest.mark.parametrize("words", [("report",), ("report", "--no-pictures"), ("compare",), ("leaderboard",), ("gate",)])
def test_commands_that_read_runs(runs, tmp_path, monkeypatch, trap, words):
    folders = [shutil.copytree(run, tmp_path / "runs" / run.name) for run in runs]
    for folder in folders:
        for name in ("summary.json", "manifest.json"):
            set_trap(folder / name, trap)
    command, *options = words
    given = {
        "report": [folders[0]],
        "compare": [*folders, "--out", tmp_path / "out"],
        "leaderboard": [tmp_path / "runs", "--out", tmp_path / "out"],
        "gate": [folders[0], "--baseline", tmp_path / "baseline", "--update", "--allow-dirty"],
    }[command]
    assert call(monkeypatch, command, *given, *options) == 0
    assert not trap.exists()
