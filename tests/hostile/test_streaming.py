"""Recordings stream: opening and walking through one costs a small index a frame, however long it is."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from bench.recordings import RecordingWriter, open_native, read_image
from tests.support import tiny
from tests.support.limits import peak_bytes

pytestmark = pytest.mark.slow

SHORT, LONG = 50, 250
INDEX_BYTES = 9_000  # a frame: its references, its pose, the states of the objects in it


def linked(first, paths):
    """The same file under many names: the disk holds it once, readers cannot tell."""
    for path in paths:
        path.hardlink_to(first)


def write(root, frames):
    drive = tiny.write_recording(root / "drive")
    for folder in ("images", "lidar", "truth"):
        shutil.rmtree(drive / folder)
    times_ns = tiny.TIMES_NS[0] + np.arange(frames, dtype=np.int64) * tiny.STEP_NS
    writer = RecordingWriter(drive)
    writer.image("front", int(times_ns[0]), tiny.pixels(0))
    first = drive / "images" / "front" / f"{times_ns[0]}.png"
    linked(first, [first.with_name(f"{t}.png") for t in times_ns[1:]])
    (drive / "lidar").mkdir()
    first = drive / "lidar" / f"{times_ns[0]}.npz"
    np.savez(first, points_lidar=np.random.default_rng(1).uniform(-20, 20, (4000, 3)).astype(np.float32))
    linked(first, [first.with_name(f"{t}.npz") for t in times_ns[1:]])
    writer.bus_signals(timestamps_ns=times_ns, speed_mps=np.full(frames, 3.0), yaw_rate_radps=np.zeros(frames))
    van = tiny.tracks()[0]
    writer.annotations([replace(van, states=tuple(replace(van.states[0], timestamp_ns=int(t)) for t in times_ns))])
    return drive


def walk(root):
    """Open everything, and read every image and sweep of it, one after the other."""
    recording = open_native(root)
    for image in recording.images["front"]:
        read_image(image, recording.cameras["front"])
    for sweep in recording.sweeps:
        sweep.read()


def test_memory_does_not_grow_with_the_recording(tmp_path):
    short, long = (write(tmp_path / str(frames), frames) for frames in (SHORT, LONG))
    walk(short)  # modules and caches
    grown = (peak_bytes(lambda: walk(long))[0] - peak_bytes(lambda: walk(short))[0]) / (LONG - SHORT)
    assert grown < INDEX_BYTES, f"{grown:.0f} bytes a frame"
