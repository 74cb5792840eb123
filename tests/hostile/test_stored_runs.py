"""Nothing that a stored run says is imported or called."""

import shutil
from pathlib import Path

import pytest

from tests.support.commands import call
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


@pytest.fixture
def trap(tmp_path, monkeypatch) -> Path:
    """Says whether its module was imported; what the trapped files name is `trap_module:Trap`."""
    (tmp_path / "plug").mkdir()
    (tmp_path / "plug" / "trap_module.py").write_text(TRAP)
    monkeypatch.syspath_prepend(str(tmp_path / "plug"))
    return tmp_path / "plug" / "sprung"


def set_trap(run: Path, trap: Path) -> None:
    """Let a stored run name other code where it names a method."""
    named = {"name": "trap_module:Trap", "place": "trap_module:Trap", "settings": {"args": ["touch", str(trap)]}}
    change_manifest(run, lambda content: content["method"].update(named))


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
        set_trap(folder, trap)
    command, *options = words
    given = {
        "report": [folders[0]],
        "compare": [*folders, "--out", tmp_path / "out"],
        "leaderboard": [tmp_path / "runs", "--out", tmp_path / "out"],
        "gate": [folders[0], "--baseline", tmp_path / "baseline", "--update", "--allow-dirty"],
    }[command]
    assert call(monkeypatch, command, *given, *options) == 0
    assert not trap.exists()
