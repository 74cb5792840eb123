"""What every adapter promises, as a test that its author can run on his own data.

from bench.recordings.contract import check_adapter

def test_my_adapter_keeps_the_contract():
    check_adapter(my_recordings, Path("/data/mine"), options={"camera": "rear"})
"""

from __future__ import annotations

import pickle
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.atomic import linked_folder
from bench.errors import BenchError, DataError
from bench.lidar import LidarSweep
from bench.recordings.catalogue import Adapter, RecordingHandle
from bench.recordings.images import read_image
from bench.records.recording import Recording, SweepRef, Track
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
        AssertionError: with one line for each broken promise.
    """
    listing = partial(adapter, card=root / "card.yaml", annotations=None)
    faults = [*_refusals(listing, root, options or {}), *_listing_faults(listing, root, options or {})]
    if faults:
        raise AssertionError("the adapter breaks its contract:\n- " + "\n- ".join(faults))


def _refusals(listing: Callable[..., Any], root: Path, options: Mapping[str, Any]) -> Iterator[str]:
    """Cases that have to be refused, with a `DataError` and nothing else."""
    fault = "options: expected a DataError for an option that does not exist"
    yield from _not_refused(fault, partial(listing, root, options={**options, NO_SUCH_OPTION: 1}))
    with tempfile.TemporaryDirectory() as empty:
        fault = "empty folder: expected no recordings or a DataError"
        yield from _not_refused(fault, partial(listing, Path(empty), options=options), none=())


def _listing_faults(listing: Callable[..., Any], root: Path, options: Mapping[str, Any]) -> Iterator[str]:
    handles, fault = _called("listing", partial(listing, root, options=options))
    if handles is None:
        yield fault
    elif not (isinstance(handles, tuple) and handles and all(isinstance(h, RecordingHandle) for h in handles)):
        yield f"listing: expected a tuple of RecordingHandle, got {_shown(handles)}"
    else:
        yield from _twice([handle.name for handle in handles], "listing: expected each name once")
        yield from (f"{handle.name}: {fault}" for handle in handles for fault in _handle_faults(handle, root))


def _handle_faults(handle: RecordingHandle, root: Path) -> Iterator[str]:
    try:
        travelled: RecordingHandle = pickle.loads(pickle.dumps(handle))
    except Exception as error:  # noqa: BLE001
        yield f"handle: expected one that pickles (a function of a module, or a partial of one), got {_shown(error)}"
        return
    recording, fault = _called("open", travelled.open)
    if not isinstance(recording, Recording):
        yield fault if recording is None else f"open: expected a Recording, got {_shown(recording)}"
        return
    if recording.name != handle.name:
        yield f"name: expected {handle.name!r}, as listed, got {recording.name!r}"
    yield from _camera_faults(recording, root)
    yield from _sweep_faults(recording, root)
    yield from _track_faults(recording.tracks)


def _camera_faults(recording: Recording, root: Path) -> Iterator[str]:
    if set(recording.images) != set(recording.cameras) or not recording.cameras:
        yield f"images: expected one row for each camera of {sorted(recording.cameras)}, got {sorted(recording.images)}"
    for name, camera in recording.cameras.items():
        place, size = f"images.{name}", (camera.model.height, camera.model.width)
        if camera.name != name:
            yield f"cameras.{name}: expected its own name, got {camera.name!r}"
        if (body := camera.ego_body) is not None and (body.shape != size or body.dtype != bool):
            yield f"cameras.{name}.ego_body: expected {size} bool, got {body.shape} {body.dtype}"
        images = recording.images.get(name, ())
        yield from _time_faults([image.timestamp_ns for image in images], place)
        yield from (f"{place}: expected this camera, got {i.camera!r}" for i in images[:1] if i.camera != name)
        yield from _outside([image.path for image in images], root, place)
        times_ns = np.array([image.timestamp_ns for image in images], dtype=np.int64)
        if len(times_ns) and not recording.trajectory.at(times_ns)[2].any():
            yield f"trajectory: expected ego-motion at the images of {name}, got none at any"
        for image in images[:READ_IMAGES]:
            pixels, fault = _called(f"{place}, {image.path.name}", partial(read_image, image, camera))
            if pixels is None:
                yield fault
            elif pixels.shape != size or pixels.dtype != np.uint8:
                yield f"{place}: expected {size} uint8, got {pixels.shape} {pixels.dtype}"


def _sweep_faults(recording: Recording, root: Path) -> Iterator[str]:
    yield from _time_faults([sweep.timestamp_ns for sweep in recording.sweeps], "sweeps")
    yield from _outside([sweep.path for sweep in recording.sweeps], root, "sweeps")
    for reference in recording.sweeps[:READ_SWEEPS]:
        place = f"sweeps, {reference.path.name}"
        sweep, fault = _called(place, partial(_travelled, reference))
        if sweep is None:
            yield fault
            continue
        if not np.isfinite(sweep.points_lidar).all():
            yield f"{place}: expected finite points, got NaN or infinity"
        if sweep.timestamp_ns != reference.timestamp_ns:
            yield f"{place}: expected the time {reference.timestamp_ns}, got {sweep.timestamp_ns}"
    if recording.sweeps and recording.sweeps[0].path.is_file():
        yield from _cut_sweep(recording.sweeps[0])


def _travelled(reference: SweepRef) -> LidarSweep:
    """The sweep as another process reads it."""
    sweep: LidarSweep = pickle.loads(pickle.dumps(reference)).read()
    return sweep


def _cut_sweep(reference: SweepRef) -> Iterator[str]:
    """A sweep file that is not there, and one of which half is missing."""
    with tempfile.TemporaryDirectory() as folder:
        cut = Path(folder) / reference.path.name
        read, fault = partial(reference.reader, cut, reference.timestamp_ns), "sweeps: expected a DataError for a file"
        yield from _not_refused(f"{fault} that is missing", read)
        with reference.path.open("rb") as whole:
            cut.write_bytes(whole.read(reference.path.stat().st_size // 2))
        yield from _not_refused(f"{fault} that is cut short", read, may_succeed=True)


def _track_faults(tracks: Sequence[Track]) -> Iterator[str]:
    yield from _twice([track.track_id for track in tracks], "tracks: expected each id once")
    for track in tracks:
        place = f"tracks, {track.track_id}"
        if track.object_class not in OBJECT_CLASSES:
            yield f"{place}: expected a class of {', '.join(OBJECT_CLASSES)}, got {track.object_class!r}"
        yield from _time_faults([state.timestamp_ns for state in track.states], place)
        if any(np.shape(state.velocity_mps) != (3,) for state in track.states):
            yield f"{place}: expected velocities (3,), NaN where unknown, got another shape"


def _twice(names: Sequence[str], what: str) -> list[str]:
    return [f"{what}, got {name!r} twice" for name in sorted(set(names)) if names.count(name) > 1]


def _time_faults(times_ns: Sequence[object], place: str) -> Iterator[str]:
    wrong = [time for time in times_ns if not isinstance(time, int) or isinstance(time, bool)]
    if wrong:
        yield f"{place}: expected times as int nanoseconds, got {type(wrong[0]).__name__}"
    elif list(times_ns) != sorted(set(times_ns)):  # type: ignore[type-var]
        yield f"{place}: expected times that increase, got one twice or out of order"


def _outside(paths: Sequence[Path], root: Path, place: str) -> Iterator[str]:
    for path in paths:
        if not path.resolve().is_relative_to(linked_folder(root, path, levels=1).resolve()):
            yield f"{place}: expected files below {root}, got {path}"
            return


def _called(what: str, call: Callable[[], Any]) -> tuple[Any, str]:
    """The result, or None and what went wrong on a data set that is known to be good."""
    try:
        return call(), f"{what}: expected a result, got None"
    except BenchError as error:
        return None, f"{what}: {error}"
    except Exception as error:  # noqa: BLE001 - a traceback would hide the other promises
        return None, f"{what}: expected no error, or a DataError for a fault of the data, got {_shown(error)}"


def _not_refused(
    what: str, call: Callable[[], Any], *, may_succeed: bool = False, none: object = None
) -> Iterator[str]:
    """A line unless the call raises a `DataError` or gives `none`, where that is one."""
    try:
        result = call()
    except DataError:
        return
    except Exception as error:  # noqa: BLE001 - any other is what we look for
        yield f"{what}, got {_shown(error)}"
        return
    if not may_succeed and (none is None or result != none):
        yield f"{what}, got none" if none is None else f"{what}, got {_shown(result)}"


def _shown(value: object) -> str:
    text = f"{type(value).__name__}: {value}" if isinstance(value, Exception) else repr(value)
    return " ".join(text.split())[:200]
