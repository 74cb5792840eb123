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

from bench.adapters.woodscape.camera import WoodscapeOptions, read_camera
from bench.adapters.woodscape.files import find_pair, list_pairs, read_arc
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings.handles import RecordingHandle
from bench.recordings.validation import validated
from bench.records.recording import COMPLETELY, Content, ImageRef, Recording


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
        RecordingHandle(name=name, opener=partial(open_woodscape, root, pair=name, options=chosen))
        for name in list_pairs(root, chosen)
    )


def open_woodscape(root: Path, *, pair: str, options: WoodscapeOptions) -> Recording:
    """Open a pair.

    Args:
        root: folder of the data set.
        pair: `<index>_<camera>`.
        options: as in the card.

    Raises:
        DataError: a file that is missing or not what the format asks for.
    """
    files = find_pair(root, pair, options)
    camera = read_camera(root, files["calibration"], pair, options)
    trajectory, times_ns = read_arc(files["vehicle_before"], files["vehicle"], options)
    images = (
        ImageRef(camera=camera.name, timestamp_ns=times_ns[0], path=files["previous"], scored=False),
        ImageRef(camera=camera.name, timestamp_ns=times_ns[1], path=files["current"], moving_path=files["mask"]),
    )
    return Recording(
        name=pair,
        root=root,
        licence=options.licence,
        frame_interval_ns=times_ns[1] - times_ns[0],
        cameras={camera.name: camera},
        images={camera.name: images},
        trajectory=trajectory,
        vehicle_from_lidar=RigidTransform.identity(),
        sweeps=(),
        tracks=(),
        annotated=COMPLETELY,
        vehicle_outline_m=np.array(options.outline_m(int(pair.split("_")[0])), dtype=np.float64),
        contents=(
            *(Content(what=path.relative_to(root).as_posix(), read_as=kind) for kind, path in files.items()),
            Content(what="acceleration and steering of vehicle_data", why="of unknown unit"),
            Content(what="classes of motion_annotations", why="names and numbers do not line up"),
        ),
    )
