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


def write(root, frames):
    """The tiny recording with a sweep of 4000 points, and with files that stand on the disk once, under many names."""
    drive = tiny.write_recording(root / "drive")
    shutil.rmtree(drive / "truth")
    points = np.random.default_rng(1).uniform(-20, 20, (4000, 3)).astype(np.float32)
    np.savez(drive / f"lidar/{tiny.TIMES_NS[0]}.npz", points_lidar=points)
    times_ns = tiny.TIMES_NS[0] + np.arange(frames, dtype=np.int64) * tiny.STEP_NS
    for first in (drive / f"images/front/{times_ns[0]}.png", drive / f"lidar/{times_ns[0]}.npz"):
        for time_ns in times_ns[3:]:
            first.with_stem(str(time_ns)).hardlink_to(first)
    writer = RecordingWriter(drive)
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
