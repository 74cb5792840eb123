"""The reference as data for other programs."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

import bench
from bench.harness.reference_export import label_image
from bench.reference.build import ReferenceBuilder
from tests.support.changed_data import without_scenario
from tests.support.commands import call, output_of

PROTOCOLS = ("paper-v1", "surface-v1")


@pytest.fixture(scope="module", params=PROTOCOLS)
def export(request, tiny_card, tmp_path_factory) -> tuple[str, Path]:
    """The tiny data set's reference by a protocol."""
    out = tmp_path_factory.mktemp("references") / request.param
    with pytest.MonkeyPatch.context() as monkeypatch:
        words = ("--out", out, "--protocol", request.param, "--workers", 1)
        assert call(monkeypatch, "reference", "export", tiny_card, *words) == 0
    return request.param, out


def test_every_image_and_object_is_there_as_it_is_scored(export, tiny_card):
    protocol, folder = export
    head = json.loads((folder / "reference.json").read_text())
    assert (head["dataset"], head["split"], head["protocol"]["name"]) == ("tiny", None, protocol)
    assert head["recordings"] == {"crossing": 5, "overtaking": 5, "standing": 5}
    frames = list(bench.open_dataset(tiny_card).frames(protocol=protocol, history=0))
    entries = {
        (name, image["camera"], image["timestamp_ns"]): image
        for name in head["recordings"]
        for image in json.loads((folder / f"{name}.json").read_text())["images"]
    }
    assert len(entries) == len(frames)
    for frame in frames:
        entry, reference = entries[frame.recording, frame.camera, frame.timestamp_ns], frame.reference
        assert entry["ego_speed_mps"] == reference.ego_speed_mps
        assert [item["track_id"] for item in entry["objects"]] == [one.track_id for one in reference.objects]
        assert [item["region_px"] for item in entry["objects"]] == [one.region_px for one in reference.objects]
        place = f"{frame.camera}/{frame.timestamp_ns}.png"
        read = [cv2.imread(str(folder / frame.recording / what / place), cv2.IMREAD_UNCHANGED)
                for what in ("instances", "labels")]  # fmt: skip
        assert np.array_equal(read[0], reference.labels)
        assert np.array_equal(read[1], label_image(reference))
        assert (folder.parents[0] / entry["file_name"]).suffix == ".png"


def test_labels_tell_what_counts(export, tiny_card):
    protocol, folder = export
    labels = [cv2.imread(str(file), cv2.IMREAD_UNCHANGED) for file in folder.rglob("labels/*/*.png")]
    found = set(np.unique(labels))
    assert {0, 1, 4} <= found
    assert (2 in found) == (protocol == "surface-v1"), "an unknown band"


def test_an_export_that_breaks_off_leaves_nothing(tiny_card, tmp_path, monkeypatch):
    monkeypatch.setattr(ReferenceBuilder, "build", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        bench.export_reference(tiny_card, tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_an_image_without_a_reference_is_told(tiny_card, tmp_path):
    card = shutil.copytree(tiny_card.parent, tmp_path / "data") / tiny_card.name
    without_scenario(card)
    for sweep in (card.parent / "data" / "tiny" / "crossing" / "lidar").iterdir():
        sweep.write_bytes(sweep.read_bytes()[:1000])
    words = ("--split", "crossing", "--workers", 1, "--out", tmp_path / "out")
    assert output_of("reference", "export", card, *words, status=2).count("no reference: crossing/lidar/") >= 4
    images = json.loads((tmp_path / "out" / "crossing.json").read_text())["images"]
    assert all(image["problem"] for image in images[1:])
    assert len({image["timestamp_ns"] for image in images}) == 5
