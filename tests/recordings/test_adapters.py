"""What every adapter promises."""

import pickle
from importlib.metadata import EntryPoint

import numpy as np
import pytest

from bench import plug_ins
from bench.errors import UsageError
from bench.recordings import ADAPTERS, load_card, open_dataset
from tests.support.cards import write_card
from tests.support.data_sets import DATA_SETS, card_of, native

MASKED = {"woodscape"}  # masks in place of lidar and annotated objects


def test_every_adapter_is_tried():
    assert set(DATA_SETS) == set(ADAPTERS)


@pytest.fixture(params=DATA_SETS)
def card(request, tmp_path):
    (tmp_path / "data").mkdir()
    return load_card(card_of(tmp_path, request.param, DATA_SETS[request.param](tmp_path / "data")))


def test_recordings_have_what_the_reference_needs(card):
    (handle,) = pickle.loads(pickle.dumps(open_dataset(card)))
    recording = handle.open()
    for name, camera in recording.cameras.items():
        assert camera.ego_body.shape == (camera.model.height, camera.model.width)
        times_ns = np.array([image.timestamp_ns for image in recording.images[name]])
        assert recording.trajectory.at(times_ns)[2].all()
    masked = card.content.adapter in MASKED
    assert all(images[-1].moving_path is not None for images in recording.images.values()) == masked
    assert bool(recording.sweeps) != masked
    for reference in recording.sweeps:
        assert recording.trajectory.at(reference.read().times_ns)[2].all()
    assert bool(recording.tracks) != masked
    assert recording.vehicle_outline_m.shape[1] == 2


@pytest.mark.parametrize("value", ["no_such_module_of_anybody:listing", "bench.recordings:no_such_name", "bench"])
def test_a_package_whose_adapter_cannot_be_imported_is_one_clear_line(tmp_path, monkeypatch, value):
    point = EntryPoint(name="mine", value=value, group="fisheye_bench.adapters")
    monkeypatch.setattr(plug_ins, "installed_points", lambda group: [point] if group == point.group else [])
    native(tmp_path / "data")
    with pytest.raises(UsageError, match="adapter 'mine': expected a function "):
        open_dataset(load_card(write_card(tmp_path, adapter="mine")))
