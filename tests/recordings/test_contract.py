"""The contract test finds each broken promise, and every adapter of ours passes it."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from bench.errors import DataError
from bench.lidar import LidarSweep
from bench.plug_ins import imported
from bench.recordings import ADAPTERS, RecordingHandle
from bench.recordings.contract import adapter_faults, check_adapter
from bench.recordings.native import open_native
from bench.recordings.validation import FileModel, validated
from tests.support import tiny
from tests.support.data_sets import DATA_SETS


class Options(FileModel):
    """None."""


@pytest.fixture
def root(tmp_path):
    tiny.write_recording(tmp_path / "data" / "drive")
    return tmp_path / "data"


def adapter_of(opener, *, names=("drive",)):
    """An adapter like a user's own: a few lines around a function that opens."""

    def listing(root, *, options, card, annotations):
        validated(Options, options, file=card, field="options")
        if not (root / "drive").is_dir():
            return ()
        return tuple(RecordingHandle(name=name, opener=partial(opener, root / "drive")) for name in names)

    return listing


def changed(root, **changes):
    return replace(open_native(root), **changes)


def images(change, root):
    """The recording with other images, made of its own."""
    recording = open_native(root)
    return replace(recording, images={"front": tuple(change(recording.images["front"], root))})


def out_of_order(images, _):
    return images[::-1]


def floats_for_times(images, _):
    return [replace(image, timestamp_ns=float(image.timestamp_ns)) for image in images]


def outside(images, root):
    place = root.parent.parent / "elsewhere.png"
    place.write_bytes(images[0].path.read_bytes())
    return [replace(images[0], path=place)]


def tracks(change, root):
    recording = open_native(root)
    return replace(recording, tracks=change(recording.tracks))


def twice(tracks):
    return tracks + tracks[:1]


def of_an_odd_class(tracks):
    return (replace(tracks[0], object_class="tram"),)


def read_with_traceback(path, timestamp_ns):
    points = np.load(path)["points_lidar"]
    return LidarSweep(timestamp_ns=timestamp_ns, points_lidar=points)


def read_at_another_time(path, timestamp_ns):
    return LidarSweep(timestamp_ns=timestamp_ns + 1, points_lidar=np.full((3, 3), np.nan))


def sweeps_read_by(reader, root):
    recording = open_native(root)
    return replace(recording, sweeps=tuple(replace(sweep, reader=reader) for sweep in recording.sweeps))


def raises_key_error(root):
    raise KeyError("fx")


def refuses(root):
    raise DataError(root, expected="a calibration", got="none")


@pytest.mark.parametrize("name", DATA_SETS)
def test_our_adapters_keep_it(tmp_path, name):
    (tmp_path / "set").mkdir()
    options = DATA_SETS[name](tmp_path / "set")
    check_adapter(imported(ADAPTERS[name], expected="an adapter"), tmp_path / "set", options=options)


def test_an_adapter_of_ones_own_keeps_it(root):
    check_adapter(adapter_of(open_native), root)


@pytest.mark.parametrize(
    ("opener", "fault"),
    [
        (partial(changed, name="other"), "drive: name: expected 'drive', as listed, got 'other'"),
        (partial(images, out_of_order), "drive: images.front: expected times that increase"),
        (partial(images, floats_for_times), "drive: images.front: expected times as int nanoseconds, got float"),
        (partial(images, outside), "drive: images.front: expected files below"),
        (partial(tracks, twice), "drive: tracks: expected each id once, got 'van' twice"),
        (partial(tracks, of_an_odd_class), "drive: tracks, van: expected a class of pedestrian, cyclist, vehicle"),
        (
            partial(sweeps_read_by, read_with_traceback),
            "drive: sweeps: expected a DataError for a file that is missing, got FileNotFoundError",
        ),
        (partial(sweeps_read_by, read_at_another_time), "expected finite points, got NaN or infinity"),
        (
            raises_key_error,
            "drive: open: expected no error, or a DataError for a fault of the data, got KeyError: 'fx'",
        ),
        (refuses, "expected a calibration, got none"),
    ],
)
def test_each_broken_promise_is_told(root, opener, fault):
    faults = adapter_faults(adapter_of(opener), root)
    assert any(fault in told for told in faults), faults
    with pytest.raises(AssertionError, match="breaks its contract"):
        check_adapter(adapter_of(opener), root)


def test_names_twice_and_handles_that_cannot_travel(root):
    assert "listing: expected each name once, got 'drive' twice" in adapter_faults(
        adapter_of(open_native, names=("drive", "drive")), root
    )

    def local(place):
        return open_native(place)

    (fault,) = adapter_faults(adapter_of(local), root)
    assert "expected one that pickles" in fault


def test_an_adapter_that_takes_any_option_and_any_folder(root):
    def eager(place, *, options, card, annotations):
        return (RecordingHandle(name="drive", opener=partial(open_native, place / "drive")),)

    faults = adapter_faults(eager, root)
    assert "options: expected a DataError for an option that does not exist, got none" in faults
    assert any(fault.startswith("empty folder: expected no recordings, got 1") for fault in faults)
