"""A newcomer's adapter, as docs/your-data.md shows it, through everything that he would do with it."""

from importlib.metadata import EntryPoint
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from bench import plug_ins
from bench.cli import main
from bench.egomotion import write_tum
from bench.recordings import catalogue, load_card, open_dataset, read_image, write_annotations
from bench.recordings.contract import adapter_faults
from tests.recordings import my_adapter, tiny

TIMES_US = tuple(1_700_000_000_000_000 + i * 66_667 for i in range(3))
POINTS = np.array([[8.0, 1.0, -1.0, 0.5], [8.0, 1.5, -0.5, 0.25]], dtype=np.float32)


@pytest.fixture
def data(tmp_path):
    drive = tmp_path / "data" / "monday"
    for folder in ("front", "scans"):
        (drive / folder).mkdir(parents=True)
    for i, time_us in enumerate(TIMES_US):
        assert cv2.imwrite(str(drive / f"front/{time_us}.png"), tiny.pixels(i))
        POINTS.tofile(drive / f"scans/{time_us}.bin")
    times_ns = np.array(TIMES_US, dtype=np.int64) * 1000
    poses = np.array([[0.2 * i, 0.0, 0.0] for i in range(3)])
    write_tum(drive / "poses.txt", timestamps_ns=times_ns, rotations=Rotation.identity(3), positions_m=poses)
    return tmp_path / "data"


def call(monkeypatch, *words):
    monkeypatch.setattr("sys.argv", ["fisheye-bench", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code or 0


def test_it_is_the_one_that_the_documentation_shows():
    page = Path(__file__).parents[2] / "docs/your-data.md"
    assert f"```python\n{Path(my_adapter.__file__).read_text()}```" in page.read_text("utf-8")


def test_it_keeps_the_contract(data):
    assert adapter_faults(my_adapter.my_recordings, data) == ()


def test_the_command_tries_it_where_it_lies(data, tmp_path, monkeypatch, capsys):
    (tmp_path / "my_adapter.py").write_text(Path(my_adapter.__file__).read_text())
    monkeypatch.chdir(tmp_path)
    assert call(monkeypatch, "validate", data, "--adapter", "my_adapter:my_recordings") == 0
    assert "my_adapter:my_recordings keeps the contract of adapters" in capsys.readouterr().out
    next((data / "monday/scans").iterdir()).write_bytes(b"123")
    assert call(monkeypatch, "validate", data, "--adapter", "my_adapter:my_recordings") == 1
    assert "breaks 1 promises of the contract" in capsys.readouterr().out


def test_a_card_finds_it_by_its_entry_point(data, tmp_path, monkeypatch, capsys):
    point = EntryPoint(name="mine", value="tests.recordings.my_adapter:my_recordings", group=catalogue.ENTRY_POINTS)
    monkeypatch.setattr(plug_ins, "entry_points", lambda group: [point] if group == point.group else [])
    write_annotations(tmp_path / "labels/monday.json", (), timestamps_ns=[time_us * 1000 for time_us in TIMES_US])
    content = {"name": "mine", "title": "x", "adapter": "mine", "root": "data", "licence": "x", "annotations": "labels"}
    card = tmp_path / "mine.yaml"
    card.write_text(yaml.safe_dump(content))
    (handle,) = open_dataset(load_card(card))
    recording = handle.open()
    assert np.array_equal(read_image(recording.images["front"][2], recording.cameras["front"]), tiny.pixels(2))
    assert recording.sweeps[0].read().points_lidar == pytest.approx(POINTS[:, :3])
    assert call(monkeypatch, "run", card, "--method", "nothing", "--out", tmp_path / "run", "--no-pictures") == 0
    assert "2 images: 2 scored, 0 skipped, 0 failed" in " ".join(capsys.readouterr().out.split())
