"""Names, polygons and files in a recording that try the commands: nothing ends up outside of the run's folder."""

import json

import numpy as np
import pytest

from tests.hostile import files
from tests.support import tiny
from tests.support.commands import call, error_line

pytestmark = pytest.mark.slow

CARD = "name: x\ntitle: x\nadapter: native\nroot: data\nlicence: x\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    place = tmp_path / "a" / "b" / "work"
    tiny.write_recording(place / "data" / "drive")
    (place / "x.yaml").write_text(CARD)
    monkeypatch.chdir(place)
    return place


def listing(folder):
    top = folder.parents[2]
    return {str(path.relative_to(top)) for path in top.rglob("*") if not path.is_relative_to(folder / "out")}


def edit(folder, change):
    file = folder / "data" / "drive" / "annotations.json"
    content = json.loads(file.read_text())
    change(content["openlabel"])
    file.write_text(json.dumps(content))


@pytest.mark.parametrize("name", ["../../../evil", "/tmp/evil", "a/b", "..", "\n\x1b[2J", "x" * 5000, "<script>"])
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


@pytest.mark.parametrize("what", ["30000 x 30000 px", "cut short", "one byte turned"])
def test_run_tells_a_broken_image_and_ends_with_2(monkeypatch, capsys, folder, what):
    image = folder / "data" / "drive" / "images" / "front" / f"{tiny.TIMES_NS[1]}.png"
    image.write_bytes(files.IMAGES[what])
    before = listing(folder)
    assert call(monkeypatch, "run", "x.yaml", "--method", "nothing", "--out", folder / "out", "--no-pictures") == 2
    told = capsys.readouterr()
    assert image.name in "".join((told.out + told.err).split())
    assert "Traceback" not in told.err
    assert listing(folder) == before


def test_run_tells_a_sweep_of_zeros(monkeypatch, capsys, folder):
    sweep = folder / "data" / "drive" / "lidar" / f"{tiny.TIMES_NS[1]}.npz"
    sweep.write_bytes(files.NPZ_FILES["zip of zeros"])
    assert call(monkeypatch, "run", "x.yaml", "--method", "nothing", "--out", folder / "out", "--no-pictures") == 2
    told = capsys.readouterr()
    assert sweep.name in "".join((told.out + told.err).split())
