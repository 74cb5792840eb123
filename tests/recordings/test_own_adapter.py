"""A newcomer's adapter, as `fisheye-bench new adapter` writes it, through everything that he would do with it."""

import importlib
import sys
from importlib.metadata import EntryPoint

import numpy as np
import pytest

from bench import plug_ins
from bench.recordings import catalogue, load_card, open_dataset, read_image
from tests.support.commands import call


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder of the adapter `lab-format`, with its example written."""
    monkeypatch.chdir(tmp_path)
    assert call(monkeypatch, "new", "adapter", "lab_format") == 0
    place = tmp_path / "lab-format"
    monkeypatch.chdir(place)
    monkeypatch.syspath_prepend(place)
    importlib.import_module("example").main()
    yield place
    for name in ("example", "lab_format", "test_lab_format"):
        sys.modules.pop(name, None)


def test_its_own_tests_pass(folder, tmp_path):
    tests = importlib.import_module("test_lab_format")
    tests.test_it_keeps_the_contract(tmp_path / "one")
    tests.test_images_and_points_are_those_of_the_files(tmp_path / "two")
    next((folder / "example/monday/scans").iterdir()).write_bytes(b"123")
    with pytest.raises(AssertionError, match="the adapter breaks its contract"):
        tests.check_adapter(tests.recordings, folder / "example")


def test_a_card_finds_it_by_its_entry_point(folder, monkeypatch, capsys):
    point = EntryPoint(name="lab-format", value="lab_format:recordings", group=catalogue.ENTRY_POINTS)
    assert f'{point.name} = "{point.value}"' in (folder / "pyproject.toml").read_text()
    monkeypatch.setattr(plug_ins, "installed_points", lambda group: [point] if group == point.group else [])
    (handle,) = open_dataset(load_card("lab-format.yaml"))
    recording = handle.open()
    assert read_image(recording.images["front"][2], recording.cameras["front"])[0, 1] == 22
    assert recording.sweeps[0].read().points_lidar == pytest.approx(np.array([[8.0, 1.0, -1.0], [8.0, 1.5, -0.5]]))
    assert call(monkeypatch, "run", "lab-format.yaml", "--method", "nothing", "--out", "run", "--no-pictures") == 0
    assert "2 images: 2 scored, 0 skipped, 0 failed" in " ".join(capsys.readouterr().out.split())
