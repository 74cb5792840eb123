"""What every adapter promises, as a test that its author can run on his own data.

from bench.recordings.contract import check_adapter

def test_my_adapter_keeps_the_contract():
    check_adapter(my_recordings, Path("/data/mine"), options={"camera": "rear"})
"""

from __future__ import annotations

import pickle
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.atomic import linked_folder
from bench.errors import DataError
from bench.recordings.catalogue import Adapter, RecordingHandle
from bench.recordings.images import read_image
from bench.records.recording import MountedCamera, Recording, SweepRef, Track
from bench.records.reference import OBJECT_CLASSES

READ_IMAGES, READ_SWEEPS = 12, 4
NO_SUCH_OPTION = "no_such_option_of_any_adapter"


def check_adapter(adapter: Adapter, root: Path, *, options: Mapping[str, Any] | None = None) -> None:
    """Refuse an adapter that breaks the contract.

    It must refuse unknown options, give handles that travel to other processes, name everything once, give times that
    increase, stay below `root`, read images and sweeps one by one, and report every fault as a `DataError`. Nothing
    here sees whether it reads them before they are wanted, which costs the memory of a whole drive.

    Args:
        adapter: the function.
        root: a small data set that is known to be good.
        options: the card's options for it.

    Raises:
        AssertionError: says which promise is broken; what the adapter itself raises on good data goes through.
    """
    listing = partial(adapter, card=root / "card.yaml", annotations=None)
    chosen = options or {}
    with _refusal("options: one that does not exist"):
        listing(root, options={**chosen, NO_SUCH_OPTION: 1})
    with tempfile.TemporaryDirectory() as empty, suppress(DataError):
        found: Any = listing(Path(empty), options=chosen)
        _promise(found == (), f"empty folder: expected no recordings or a DataError, got {found}")
    handles: Any = listing(root, options=chosen)
    listed = isinstance(handles, tuple) and handles and all(isinstance(each, RecordingHandle) for each in handles)
    _promise(listed, f"listing: expected a tuple of RecordingHandle, got {handles!r}")
    _once([handle.name for handle in handles], "listing: expected each name once")
    for handle in handles:
        try:
            travelled: RecordingHandle = pickle.loads(pickle.dumps(handle))
        except Exception as error:
            what = "expected one that pickles (a function of a module, or a partial of one)"
            raise AssertionError(f"{handle.name}: handle: {what}, got {error!r}") from error
        _check_recording(travelled.open(), handle.name, root)


def _check_recording(recording: Recording, name: str, root: Path) -> None:
    _promise(recording.name == name, f"name: expected {name!r}, as listed, got {recording.name!r}")
    cameras, images = sorted(recording.cameras), sorted(recording.images)
    _promise(cameras and images == cameras, f"images: expected those of each camera of {cameras}, got {images}")
    for camera in recording.cameras.values():
        _check_camera(recording, camera, root)
    _in_time([sweep.timestamp_ns for sweep in recording.sweeps], "sweeps")
    _below([sweep.path for sweep in recording.sweeps], root, "sweeps")
    for reference in recording.sweeps[:READ_SWEEPS]:
        _check_sweep(reference)
    _once([track.track_id for track in recording.tracks], "tracks: expected each id once")
    for track in recording.tracks:
        _check_track(track)


def _check_camera(recording: Recording, camera: MountedCamera, root: Path) -> None:
    place, size = f"images.{camera.name}", (camera.model.height, camera.model.width)
    images, body = recording.images.get(camera.name, ()), camera.ego_body
    named = images and all(image.camera == camera.name for image in images)
    _promise(named, f"{place}: expected a camera of this name, and images that name it")
    _promise(body is None or (body.shape == size and body.dtype == bool), f"{place}.ego_body: expected {size} bool")
    times_ns = [image.timestamp_ns for image in images]
    _in_time(times_ns, place)
    _below([image.path for image in images], root, place)
    driven = recording.trajectory.at(np.array(times_ns, dtype=np.int64))[2].any()
    _promise(driven, f"trajectory: expected ego-motion at the images of {camera.name}, got none at any")
    for image in images[:READ_IMAGES]:
        pixels = read_image(image, camera)
        got = f"{pixels.shape} {pixels.dtype}"
        _promise(pixels.shape == size and pixels.dtype == np.uint8, f"{place}: expected {size} uint8, got {got}")


def _check_sweep(reference: SweepRef) -> None:
    """Read a sweep as another process does, and in its place a file that is not there, and half of it."""
    place, time_ns = f"sweeps, {reference.path.name}", reference.timestamp_ns
    sweep = pickle.loads(pickle.dumps(reference)).read()
    _promise(sweep.timestamp_ns == time_ns, f"{place}: expected the time {time_ns}, got {sweep.timestamp_ns}")
    _promise(np.isfinite(sweep.points_lidar).all(), f"{place}: expected finite points, got NaN or infinity")
    if reference.path.is_file():
        with tempfile.TemporaryDirectory() as folder:
            cut = Path(folder) / reference.path.name
            with _refusal(f"{place}: a file that is missing"):
                reference.reader(cut, time_ns)
            whole = reference.path.read_bytes()
            cut.write_bytes(whole[: len(whole) // 2])
            with _refusal(f"{place}: a file that is cut short", or_nothing=True):
                reference.reader(cut, time_ns)


def _check_track(track: Track) -> None:
    place, known = f"tracks, {track.track_id}", ", ".join(OBJECT_CLASSES)
    named = track.object_class in OBJECT_CLASSES
    _promise(named, f"{place}: expected a class of {known}, got {track.object_class!r}")
    _in_time([state.timestamp_ns for state in track.states], place)
    vectors = all(np.shape(state.velocity_mps) == (3,) for state in track.states)
    _promise(vectors, f"{place}: expected velocities (3,), NaN where unknown, got another shape")


def _promise(kept: object, what: str) -> None:
    if not kept:
        raise AssertionError(f"the adapter breaks its contract: {' '.join(what.split())[:500]}")


def _once(names: Sequence[str], what: str) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    _promise(not twice, f"{what}, got {twice} twice")


def _in_time(times_ns: Sequence[object], place: str) -> None:
    kinds = {type(time).__name__ for time in times_ns}
    _promise(kinds <= {"int"}, f"{place}: expected times as int nanoseconds, got {', '.join(kinds)}")
    ordered = sorted(set(times_ns))  # type: ignore[type-var]
    _promise(list(times_ns) == ordered, f"{place}: expected times that increase, got one twice or out of order")


def _below(paths: Sequence[Path], root: Path, place: str) -> None:
    for path in paths:
        inside = path.resolve().is_relative_to(linked_folder(root, path, levels=1).resolve())
        _promise(inside, f"{place}: expected files below {root}, got {path}")


@contextmanager
def _refusal(of: str, *, or_nothing: bool = False) -> Iterator[None]:
    """Expect a `DataError` of the block and no other error, or nothing where a file may pass for a whole one."""
    got = "none"
    try:
        yield
        if or_nothing:
            return
    except DataError:
        return
    except Exception as error:  # noqa: BLE001 - any other is what we look for
        got = repr(error)
    _promise(False, f"{of}: expected a DataError, got {got}")
