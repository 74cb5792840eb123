"""Images: readable, of the right size, not black, not twice the same."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from hashlib import blake2b

import numpy as np

from bench.errors import DataError
from bench.recordings import ImageRef, Recording, read_image, read_truth
from bench.recordings.images import read_moving_mask
from bench.validation.findings import Finding, Severity, unusable

BLACK = 3.0  # grey levels
FEW_LEVELS, DARK_LEVEL = 32, 64  # as of 12 bits in files of 16, read as if these were full
WHITE_LEVELS = "state the camera's white_level where files of 16 bits hold fewer: 1023, 4095 or 16383 for 10, 12 or 14"
MOVING_MPS = 0.5


def check_images(recording: Recording, camera: str, rows: list[int], progress: Callable[[], None]) -> Iterator[Finding]:
    """Read images of a camera, their truth and their masks.

    Args:
        recording: the drive.
        camera: name of the camera.
        rows: indices of the images to read, increasing; neighbours are compared.
        progress: called after every image.
    """
    images, mounted = recording.images[camera], recording.cameras[camera]
    before: tuple[int, bytes] | None = None
    dark: list[ImageRef] = []
    twice: list[ImageRef] = []
    still: list[ImageRef] = []
    levels = np.zeros(256, dtype=bool)
    for row in rows:
        image = images[row]
        try:
            pixels = read_image(image, mounted)
        except DataError as error:
            yield unusable(error, check="image", timestamp_ns=image.timestamp_ns)
        else:
            seen = pixels if mounted.ego_body is None else pixels[~mounted.ego_body]
            levels[seen] = True
            if seen.size and float(seen.mean()) < BLACK and float(seen.std()) < BLACK:
                dark.append(image)
            digest = blake2b(pixels.tobytes(), digest_size=16).digest()
            if before == (row - 1, digest) and image not in dark:
                (twice if _moves(recording, images[row - 1].timestamp_ns, image.timestamp_ns) else still).append(image)
            before = row, digest
        others = (
            ("truth-image", image.truth_path, read_truth),
            ("mask-image", image.moving_path, read_moving_mask),
        )
        for check, path, read in others:
            try:
                if path is not None:
                    read(image, mounted)
            except DataError as error:
                yield unusable(error, check=check, timestamp_ns=image.timestamp_ns)
        progress()
    what = f"images of {camera}"
    used = np.flatnonzero(levels)
    if len(dark) < len(rows) and 1 < len(used) <= FEW_LEVELS and used[-1] < DARK_LEVEL:
        yield Finding(
            check="grey-levels",
            severity=Severity.WARNING,
            file=str(images[rows[0]].path),
            field=what,
            expected="images that use the levels from 0 to 255",
            got=f"{len(used)} levels up to {used[-1]}",
            hint=WHITE_LEVELS,
        )
    yield from _finding(
        dark, "black-image", what, "an image of something", "black ones", Severity.WARNING, WHITE_LEVELS
    )
    yield from _finding(twice, "same-image", what, "another image at another time", "the same pixels while driving")
    yield from _finding(still, "same-image", what, "the noise of a sensor", "the same pixels twice", Severity.WARNING)


def _finding(
    found: list[ImageRef],
    check: str,
    field: str,
    expected: str,
    got: str,
    severity: Severity = Severity.ERROR,
    hint: str = "",
) -> Iterator[Finding]:
    if found:
        yield Finding(
            check=check,
            severity=severity,
            file=str(found[0].path),
            field=field,
            expected=expected,
            got=f"{got}, {len(found)} of those read",
            hint=hint,
            times=len(found),
            timestamp_ns=found[0].timestamp_ns,
        )


def _moves(recording: Recording, first_ns: int, last_ns: int) -> bool:
    _, positions_m, valid = recording.trajectory.at(np.array([first_ns, last_ns], dtype=np.int64))
    return (
        bool(valid.all())
        and float(np.linalg.norm(positions_m[1] - positions_m[0])) > MOVING_MPS * (last_ns - first_ns) / 1e9
    )
