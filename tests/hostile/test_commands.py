"""Names of objects that try the commands: nothing ends up outside of the run's folder."""

import pytest

from tests.support import tiny
from tests.support.cards import write_card
from tests.support.commands import call
from tests.support.planting import change_json

pytestmark = pytest.mark.slow


@pytest.fixture
def folder(tmp_path, monkeypatch):
    place = tmp_path / "a" / "b" / "work"
    tiny.write_recording(place / "data" / "drive")
    write_card(place)
    monkeypatch.chdir(place)
    return place


def listing(folder):
    top = folder.parents[2]
    return {str(path.relative_to(top)) for path in top.rglob("*") if not path.is_relative_to(folder / "out")}


@pytest.mark.parametrize("name", ["../../../evil", "/tmp/evil", "\n\x1b[2J", "x" * 5000])
def test_names_of_objects(monkeypatch, capsys, folder, name):
    def rename(content):
        content["objects"][name] = content["objects"].pop("van")
        for frame in content["frames"].values():
            frame["objects"][name] = frame["objects"].pop("van")

    change_json(folder / "data/drive/annotations.json", lambda content: rename(content["openlabel"]))
    before = listing(folder)
    assert call(monkeypatch, "view", "x.yaml", "--method", "nothing", "--out", folder / "out") == 0
    if name.startswith("../"):  # the pictures of a run are named by objects too
        assert call(monkeypatch, "run", "x.yaml", "--method", "nothing", "--out", folder / "out" / "run") in {0, 2}
    assert "Traceback" not in capsys.readouterr().err
    assert listing(folder) == before
