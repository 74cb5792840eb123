"""Names and polygons in a recording that try the commands: nothing ends up outside of the run's folder."""

import numpy as np
import pytest

from tests.support import tiny
from tests.support.cards import write_card
from tests.support.commands import call, error_line
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


def edit(folder, change):
    change_json(folder / "data" / "drive" / "annotations.json", lambda content: change(content["openlabel"]))


@pytest.mark.parametrize("name", ["../../../evil", "/tmp/evil", "\n\x1b[2J", "x" * 5000])
def test_names_of_objects(monkeypatch, capsys, folder, name):
    def rename(content):
        content["objects"][name] = content["objects"].pop("van")
        for frame in content["frames"].values():
            frame["objects"][name] = frame["objects"].pop("van")

    edit(folder, rename)
    before = listing(folder)
    assert call(monkeypatch, "view", "x.yaml", "--method", "nothing", "--out", folder / "out") == 0
    if name.startswith("../"):  # the pictures of a run are named by objects too
        assert call(monkeypatch, "run", "x.yaml", "--method", "nothing", "--out", folder / "out" / "run") in {0, 2}
    assert "Traceback" not in capsys.readouterr().err
    assert listing(folder) == before


def test_polygons_of_a_hundred_thousand_points(monkeypatch, capsys, folder):
    """A star that crosses itself everywhere: five billion crossings."""
    turn = np.arange(100_000) * 2.4
    star = np.column_stack([6.0 + np.cos(turn), 2.0 + np.sin(turn)]).ravel().tolist()

    def replace(content):
        frame = content["frames"]["1"]["objects"]["walker"]["object_data"]
        frame["poly2d"][0]["val"] = star
        frame["boolean"] = []

    edit(folder, replace)
    told = error_line(monkeypatch, capsys, "view", "x.yaml", "--method", "nothing", "--out", folder / "out")
    assert "objects.walker.object_data.poly2d.0.val: expected" in told
    assert call(monkeypatch, "validate", "x.yaml") == 1
    assert capsys.readouterr().err == ""
