"""Adapters stream: opening and walking through a recording costs a small index a frame, however long it is."""

import json
import shutil
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from bench.adapters.aimotive import aimotive_recordings
from bench.adapters.kitti360.adapter import kitti360_recordings
from bench.adapters.woodscape import woodscape_recordings
from bench.recordings import RecordingWriter, read_image
from bench.recordings.images import read_moving_mask
from bench.recordings.native import native_recordings
from tests.support import tiny, tiny_aimotive, tiny_kitti360, tiny_woodscape
from tests.support.limits import peak_bytes

pytestmark = pytest.mark.slow

SHORT, LONG = 50, 250
INDEX_BYTES = 9_000  # a frame: its references, its pose, the states of the objects in it
SIDE = 256  # of images: 65 kB of pixels, far above an index
POINTS = 4000  # of a sweep: 64 kB


def pixels(frame):
    return np.full((SIDE, SIDE), frame % 200, dtype=np.uint8)


def points():
    return np.random.default_rng(1).uniform(-20, 20, (POINTS, 3)).astype(np.float32)


def linked(first, paths):
    """The same file under many names: the disk holds it once, readers cannot tell."""
    for path in paths:
        path.hardlink_to(first)


def native(root, frames):
    drive = tiny.write_recording(root / "drive")
    for folder in ("images", "lidar", "truth"):
        shutil.rmtree(drive / folder)
    times_ns = tiny.TIMES_NS[0] + np.arange(frames, dtype=np.int64) * tiny.STEP_NS
    writer = RecordingWriter(drive)
    writer.image("front", int(times_ns[0]), pixels(0)[:48, :64])
    first = drive / "images" / "front" / f"{times_ns[0]}.png"
    linked(first, [first.with_name(f"{t}.png") for t in times_ns[1:]])
    (drive / "lidar").mkdir()
    first = drive / "lidar" / f"{times_ns[0]}.npz"
    np.savez(first, points_lidar=points())
    linked(first, [first.with_name(f"{t}.npz") for t in times_ns[1:]])
    writer.bus_signals(timestamps_ns=times_ns, speed_mps=np.full(frames, 3.0), yaw_rate_radps=np.zeros(frames))
    states = tiny.tracks()[0].states[0]
    tracks = tiny.tracks()[:1]
    writer.annotations([replace(tracks[0], states=tuple(replace(states, timestamp_ns=int(t)) for t in times_ns))])
    return native_recordings, {}


def aimotive(root, frames):
    folder = tiny_aimotive.write_data_set(root)
    camera, first_frame = tiny_aimotive.CAMERA, tiny_aimotive.FIRST_FRAME
    images, sweeps = folder / "sensor/camera" / camera, folder / "dynamic/raw-revolutions"
    rows = ["frame,box_ns,front,rear"]
    for frame in range(frames):
        time_ns = tiny_aimotive.START_NS + frame * tiny_aimotive.STEP_NS
        boxes = {"CapturedObjects": [tiny_aimotive.box(frame % 3)], "Timestamp": str(time_ns)}
        tiny_aimotive.box_file(folder, frame).write_text(json.dumps(boxes))
        rows.append(f"{first_frame + frame},{time_ns},30,30")
    first = images / f"{camera}_{first_frame:07d}.jpg"
    linked(first, [images / f"{camera}_{first_frame + n:07d}.jpg" for n in range(3, frames)])
    first = sweeps / f"frame_{first_frame:07d}.laz"
    # Its points have their own times, so only the first sweep can be read at its own; the others are listed.
    linked(first, [sweeps / f"frame_{first_frame + n:07d}.laz" for n in range(1, frames)])
    next((root / "derived").iterdir()).write_text("\n".join(rows) + "\n")
    return aimotive_recordings, tiny_aimotive.OPTIONS


def kitti360(root, frames):
    tiny_kitti360.write_data_set(root)
    drive = tiny_kitti360.SEQUENCE
    seconds = [divmod(2_904_219_904 + frame * 103_600_000, 1_000_000_000) for frame in range(frames)]
    stamps = "".join(f"2013-05-28 08:{46 + s // 60:02d}:{s % 60:02d}.{ns:09d}\n" for s, ns in seconds)
    for camera in ("image_02", "image_03"):
        folder = root / "data_2d_raw" / drive / camera
        (folder / "timestamps.txt").write_text(stamps)
        first = folder / "data_rgb" / "0000000000.png"
        linked(first, [folder / "data_rgb" / f"{n:010d}.png" for n in range(tiny_kitti360.FRAMES, frames)])
    data = root / "data_3d_raw" / drive / "velodyne_points" / "data"
    first = data / "0000000000.bin"
    linked(first, [data / f"{n:010d}.bin" for n in range(tiny_kitti360.FRAMES, frames)])
    rows = [(n, (tiny_kitti360.global_from_vehicle(n) @ tiny_kitti360.VEHICLE_FROM_IMU)[:3]) for n in range(frames)]
    text = "".join(f"{n} " + " ".join(f"{v:.9f}" for v in pose.ravel()) + "\n" for n, pose in rows)
    (root / "data_poses" / drive / "poses.txt").write_text(text)
    moving = "".join(
        tiny_kitti360.object_xml(
            n, label="car", semantic=13, instance=3, centre=(1200 + n, 3400, 110), size=(4.4, 1.8, 1.5), frame=n
        ).replace("<end_frame>10<", f"<end_frame>{frames}<")
        for n in range(1, frames)
    )
    boxes = root / "data_3d_bboxes/train" / f"{drive}.xml"
    boxes.write_text(f"<opencv_storage>\n{moving}</opencv_storage>\n")
    return kitti360_recordings, tiny_kitti360.OPTIONS


def woodscape(root, frames):
    """Each pair is a recording: here it is the data set that grows."""
    tiny_woodscape.write_data_set(root)
    old = tiny_woodscape.NAMES[0]
    for path in [path for path in root.rglob(f"{old}*") if path.is_file()]:
        linked(path, [path.with_name(path.name.replace("00000", f"{n + 1000:05d}")) for n in range(frames - 2)])
    return woodscape_recordings, tiny_woodscape.OPTIONS


def walk(adapter, root, options):
    """Open everything, and read every image, mask and sweep of it, one after the other."""
    count = 0
    for handle in adapter(root, options=options, card=root / "card.yaml", annotations=None):
        recording = handle.open()
        for camera, images in recording.images.items():
            for image in images:
                read_image(image, recording.cameras[camera])
                if image.moving_path is not None:
                    read_moving_mask(image, recording.cameras[camera])
                count += image.scored
        for sweep in recording.sweeps[: 1 if adapter is aimotive_recordings else None]:
            sweep.read()
    return count


@pytest.mark.parametrize("write", [native, aimotive, kitti360, woodscape])
def test_memory_does_not_grow_with_the_recording(tmp_path, write):
    peaks, counts = [], []
    for frames in (SHORT, LONG):
        root = tmp_path / str(frames)
        root.mkdir()
        adapter, options = write(root, frames)
        if not peaks:
            walk(adapter, root, options)  # modules and caches
        peak, count = peak_bytes(partial(walk, adapter, root, options))
        peaks.append(peak)
        counts.append(count)
    assert counts[1] - counts[0] >= LONG - SHORT
    grown = (peaks[1] - peaks[0]) / (counts[1] - counts[0])
    assert grown < INDEX_BYTES, f"{grown:.0f} bytes a frame, {peaks} in all"
