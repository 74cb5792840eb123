"""WoodScape (Yogamani et al. 2019): pairs of images of four surround-view cameras with masks of what moves.

```
rgb_images/<index>_<camera>.png            previous_images/<index>_<camera>_prev.png
motion_annotations/gtLabels/<index>_<camera>.png
calibration_data/calibration/<index>_<camera>.json
vehicle_data/{rgb_images,previous_images}/<index>_<camera>.json
```

What is translated here, once:

- The data set has no drives, only pairs (WoodScape #120), and times repeat from one of its drives to the next (#102): a
  pair is a recording of its own, with two images of which the later is scored.
- The vehicle frame is ours (ISO 8855, origin on the ground below the rear axle), quaternions are x, y, z, w, and the
  principal point is an offset from the middle of the image.
- Vehicle data are text: microseconds, km/h and degrees per second (#55). Over the pair the car runs an arc.
- The cars that drove are identified by the index; each can have its own masks of its body (`cars` in the card).
- Any value of a mask that is not 0 moves; names and numbers of its classes do not line up. There is no lidar, so
  range, speed and kind of motion are unknown.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.adapters.woodscape.camera import CalibrationFile, WoodscapeOptions, read_camera
from bench.adapters.woodscape.files import Kind, VehicleFile, find_pair, list_pairs, read_arc
from bench.egomotion import Trajectory
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings.error_handlers import STRICT, ErrorHandler, reporting_all, stationary
from bench.recordings.handles import RecordingHandle
from bench.recordings.validation import json_faults, read_json, validated
from bench.records.recording import COMPLETELY, ImageRef, MountedCamera, Recording

STAND_IN_TIMES_NS = (0, 33_320_000)  # of a pair whose own cannot be read


def woodscape_recordings(
    root: Path, *, options: Mapping[str, Any], card: Path, annotations: Path | None
) -> tuple[RecordingHandle, ...]:
    """The adapter `woodscape`: each pair of images is a recording, named `<index>_<camera>`.

    Raises:
        DataError: options that are wrong, annotations apart from the data, or a folder without images.
    """
    chosen = validated(WoodscapeOptions, options, file=card, field="options")
    if annotations is not None:
        raise DataError(card, field="annotations", expected="none: this data set has masks", got=str(annotations))
    return tuple(
        RecordingHandle(name=name, opener=partial(open_woodscape, root, pair=name, options=chosen), lenient=True)
        for name in list_pairs(root, chosen)
    )


def open_woodscape(root: Path, *, pair: str, options: WoodscapeOptions, on_error: ErrorHandler = STRICT) -> Recording:
    """Open a pair.

    Args:
        root: folder of the data set.
        pair: `<index>_<camera>`.
        options: as in the card.
        on_error: takes errors; the default raises the first.

    Raises:
        DataError: a file that is missing or not what the format asks for.
    """
    files = find_pair(root, pair, options, on_error)
    camera: MountedCamera | None = None
    if "calibration" in files:
        with reporting_all(on_error, lambda _: json_faults(CalibrationFile, files["calibration"])):
            camera = read_camera(root, files["calibration"], pair, options)
    trajectory, times_ns = _motion(files, options, on_error)
    if camera is None:
        on_error.stop()
    if trajectory is None:
        on_error.leave_out("trajectory")
    name, images = camera.name, []
    if "previous" in files:
        images.append(ImageRef(camera=name, timestamp_ns=times_ns[0], path=files["previous"], scored=False))
    if "current" in files:
        images.append(
            ImageRef(camera=name, timestamp_ns=times_ns[1], path=files["current"], moving_path=files.get("mask"))
        )
    return Recording(
        name=pair,
        root=root,
        licence=options.licence,
        frame_interval_ns=times_ns[1] - times_ns[0],
        cameras={name: camera},
        images={name: tuple(images)},
        trajectory=trajectory or stationary(root),
        vehicle_from_lidar=RigidTransform.identity(),
        sweeps=(),
        tracks=(),
        annotated=COMPLETELY,
        vehicle_outline_m=np.array(options.outline_m(int(pair.split("_")[0])), dtype=np.float64),
    )


def _motion(
    files: Mapping[Kind, Path], options: WoodscapeOptions, on_error: ErrorHandler
) -> tuple[Trajectory | None, tuple[int, int]]:
    """Ego-motion and the times of both images; after an error None, with stand-ins for the times."""
    before, after = files.get("vehicle_before"), files.get("vehicle")
    present = [file for file in (before, after) if file is not None]

    def find_all(_: DataError) -> list[DataError]:
        return [fault for file in present for fault in json_faults(VehicleFile, file)]

    with reporting_all(on_error, find_all):
        if before is not None and after is not None:
            return read_arc(before, after, options)
        for file in present:
            read_json(VehicleFile, file)
    return None, STAND_IN_TIMES_NS
