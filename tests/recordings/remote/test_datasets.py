"""A card with an address: the same recordings as from disk, each fetched when it is opened."""

import pickle
import shutil

import pytest

from bench.errors import DataError
from bench.recordings import load_card, open_dataset
from bench.recordings.object_storage import BY_RECORDING
from tests.support.data_sets import DATA_SETS, card_of

pytestmark = pytest.mark.slow


def remote_card(folder, adapter, options, url):
    """The card of a data set whose copy lies on the storage."""
    return load_card(card_of(folder, adapter, options, file="remote.yaml", root=url))


@pytest.mark.parametrize("adapter", DATA_SETS)
def test_every_adapter_reads_the_same_from_an_address(tmp_path, bucket, adapter):
    (tmp_path / "data").mkdir()
    options = DATA_SETS[adapter](tmp_path / "data")
    here = load_card(card_of(tmp_path, adapter, options))
    there = remote_card(tmp_path, adapter, options, bucket.put_folder(tmp_path / "data", "sets/data"))
    (local,), (remote,) = open_dataset(here), pickle.loads(pickle.dumps(open_dataset(there)))
    shutil.move(tmp_path / "data", tmp_path / "elsewhere")
    recording = remote.open()
    shutil.move(tmp_path / "elsewhere", tmp_path / "data")
    expected = local.open()
    assert (recording.name, remote.name) == (expected.name, local.name)
    assert recording.root.is_relative_to(tmp_path / "remote" / "data")
    for name, images in expected.images.items():
        assert [image.path.relative_to(recording.root) for image in recording.images[name]] == [
            image.path.relative_to(expected.root) for image in images
        ]
    assert [track.track_id for track in recording.tracks] == [track.track_id for track in expected.tracks]
    assert [sweep.timestamp_ns for sweep in recording.sweeps] == [sweep.timestamp_ns for sweep in expected.sweeps]


def test_adapters_that_are_fetched_by_recording_exist():
    assert set(BY_RECORDING) < set(DATA_SETS)


def write_two(root, adapter):
    options = DATA_SETS[adapter](root)
    (name,) = (path.name for path in root.iterdir() if path.is_dir() or path.suffix == ".mcap")
    other = f"other{root.joinpath(name).suffix}"
    copied = shutil.copytree if (root / name).is_dir() else shutil.copy
    copied(root / name, root / other)
    return options, name, other


@pytest.mark.parametrize("adapter", BY_RECORDING)
def test_only_the_opened_recording_is_fetched(tmp_path, bucket, fetched, adapter):
    (tmp_path / "data").mkdir()
    options, name, other = write_two(tmp_path / "data", adapter)
    there = remote_card(tmp_path, adapter, options, bucket.put_folder(tmp_path / "data", "sets/data"))
    handles = open_dataset(there)
    assert len(handles) == 2
    assert fetched == []
    next(handle for handle in handles if not other.startswith(handle.name)).open()
    assert any(file.startswith(name) for file in fetched)
    assert not any(file.startswith(other) for file in fetched)


def test_an_address_may_be_of_one_recording(tmp_path, bucket):
    (tmp_path / "data").mkdir()
    options = DATA_SETS["native"](tmp_path / "data")
    there = remote_card(tmp_path, "native", options, bucket.put_folder(tmp_path / "data" / "drive", "sets/drive"))
    (handle,) = open_dataset(there)
    assert handle.open().name == "drive"


def test_faults_are_told_of_the_remote_recording(tmp_path, bucket):
    (tmp_path / "data").mkdir()
    options = DATA_SETS["native"](tmp_path / "data")
    (tmp_path / "data" / "drive" / "annotations.json").write_text("{}")
    there = remote_card(tmp_path, "native", options, bucket.put_folder(tmp_path / "data", "sets/data"))
    (handle,) = open_dataset(there)
    with pytest.raises(DataError, match=r"annotations.json"):
        handle.open()
    reading = handle.read_leniently()
    assert reading.errors
    assert reading.recording is not None
    for key in bucket.names("sets/data/drive/"):
        bucket.remove(key)
    (fault,) = handle.read_leniently().errors
    assert "nothing there" in str(fault)


def test_wrong_options_and_hostile_names_are_told_before_anything_is_fetched(tmp_path, bucket, fetched):
    (tmp_path / "data").mkdir()
    DATA_SETS["native"](tmp_path / "data")
    url = bucket.put_folder(tmp_path / "data", "sets/data")
    with pytest.raises(DataError, match=r"remote.yaml: options.speed"):
        open_dataset(remote_card(tmp_path, "native", {"speed": 1}, url))
    bucket.put("sets/data/../x/recording.json", b"{}")
    with pytest.raises(DataError, match="names of objects that can be files"):
        open_dataset(remote_card(tmp_path, "native", {}, url))
    assert fetched == []
