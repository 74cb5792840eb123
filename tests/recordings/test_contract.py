"""The contract test finds a broken promise, and every adapter of ours passes it."""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from bench.lidar.sweep import LidarSweep
from bench.plug_ins import imported
from bench.recordings import ADAPTERS, RecordingHandle, load_card, open_dataset
from bench.recordings.contract import check_adapter
from bench.recordings.native import open_native
from bench.recordings.validation import FileModel, validated
from tests.support import tiny
from tests.support.data_sets import DATA_SETS, card_of

MASKED = {"woodscape"}  # masks in place of lidar and annotated objects


class Options(FileModel):
    """None."""


@pytest.fixture
def root(tmp_path):
    tiny.write_recording(tmp_path / "data" / "drive")
    return tmp_path / "data"


def adapter_of(opener, *, names=("drive",), anywhere=False):
    """An adapter like a user's own: a few lines around a function that opens."""

    def listing(root, *, options, card, annotations):
        validated(Options, options, file=card, field="options")
        if not (anywhere or (root / "drive").is_dir()):
            return ()
        return tuple(RecordingHandle(name=name, opener=partial(opener, root / "drive")) for name in names)

    return listing


def read_with_traceback(path, timestamp_ns):
    return LidarSweep(timestamp_ns=timestamp_ns, points_lidar=np.load(path)["points_lidar"])


def read_at_another_time(path, timestamp_ns):
    return LidarSweep(timestamp_ns=timestamp_ns + 1, points_lidar=np.zeros((3, 3)))


def read_lost_returns(path, timestamp_ns):
    return LidarSweep(timestamp_ns=timestamp_ns, points_lidar=np.full((3, 3), np.nan))


def read_by(reader):
    return lambda recording: {"sweeps": tuple(replace(sweep, reader=reader) for sweep in recording.sweeps)}


def with_images(change):
    return lambda recording: {"images": {"front": tuple(change(recording.images["front"]))}}


FAULTS = {  # what is told, and the parts of a recording that are others
    "name: expected 'drive', as listed, got 'other'": lambda _: {"name": "other"},
    "images.front: expected times that increase": with_images(reversed),
    "images.front: expected times as int nanoseconds, got float": with_images(
        lambda images: (replace(image, timestamp_ns=float(image.timestamp_ns)) for image in images)
    ),
    "images.front: expected files below": with_images(
        lambda images: (replace(image, path=Path(__file__)) for image in images)
    ),
    "tracks: expected each id once, got ['van'] twice": lambda recording: {"tracks": recording.tracks[:1] * 2},
    "tracks, van: expected a class of pedestrian, cyc": lambda recording: {
        "tracks": (replace(recording.tracks[0], object_class="tram"),)
    },
    "a file that is missing: expected a DataError, got FileNotFoundError": read_by(read_with_traceback),
    "expected finite points, got NaN": read_by(read_lost_returns),
    "expected the time": read_by(read_at_another_time),
}


def with_fault(root, told):
    recording = open_native(root)
    return replace(recording, **FAULTS[told](recording))


def raises_key_error(root):
    raise KeyError("fx")


def test_every_adapter_is_tried():
    assert set(DATA_SETS) == set(ADAPTERS)


@pytest.mark.parametrize("name", DATA_SETS)
def test_our_adapters_keep_it_and_give_what_the_reference_needs(tmp_path, name):
    (tmp_path / "data").mkdir()
    options = DATA_SETS[name](tmp_path / "data")
    check_adapter(imported(ADAPTERS[name], expected="an adapter"), tmp_path / "data", options=options)
    (handle,) = open_dataset(load_card(card_of(tmp_path, name, options)))
    recording, masked = handle.open(), name in MASKED
    for camera in recording.cameras.values():
        assert camera.ego_body.shape == (camera.model.height, camera.model.width)
        times_ns = np.array([image.timestamp_ns for image in recording.images[camera.name]])
        assert recording.trajectory.at(times_ns)[2].all()
    for reference in recording.sweeps:
        assert recording.trajectory.at(reference.read().times_ns)[2].all()
    assert all(images[-1].moving_path is not None for images in recording.images.values()) == masked
    assert bool(recording.sweeps) == bool(recording.tracks) != masked
    assert recording.vehicle_outline_m.shape[1] == 2


def test_an_adapter_of_ones_own_keeps_it(root):
    check_adapter(adapter_of(open_native), root)


BROKEN = [
    *((adapter_of(partial(with_fault, told=told)), told) for told in FAULTS),
    (adapter_of(open_native, names=("drive", "drive")), "listing: expected each name once, got ['drive'] twice"),
    (adapter_of(lambda place: open_native(place)), "drive: handle: expected one that pickles"),
    (lambda place, **_: (RecordingHandle(name="drive", opener=partial(open_native, place / "drive")),),
     "options: one that does not exist: expected a DataError, got none"),
    (adapter_of(open_native, anywhere=True),
     "empty folder: expected no recordings or a DataError, got (RecordingHandle"),
]  # fmt: skip


@pytest.mark.parametrize(("adapter", "fault"), BROKEN, ids=[fault for _, fault in BROKEN])
def test_a_broken_promise_is_told(root, adapter, fault):
    with pytest.raises(AssertionError, match=re.escape(fault)):
        check_adapter(adapter, root)


def test_what_an_adapter_raises_on_good_data_goes_through(root):
    with pytest.raises(KeyError, match="fx"):
        check_adapter(adapter_of(raises_key_error), root)
