"""Images: readable, of the right size, not black, not twice the same, in the order in which they were taken."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from hashlib import blake2b

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.errors import DataError
from bench.recordings import ImageRef, Recording, read_image, read_truth
from bench.recordings.images import read_moving_mask
from bench.validation.findings import Finding, new_finding, unusable

BLACK = 3.0  # grey levels
FEW_LEVELS, DARK_LEVEL = 32, 64  # as of 12 bits in files of 16, read as if these were full
MOVING_MPS = 0.5
COMPARED_PX, BLUR_PX = 64, 1.0  # width at which images are compared, and the standard deviation of a blur
LONGEST_STEP_S = 0.25  # between images whose order shows
# In clean drives, rendered and real, by day and night, the first is 1.10 to 2.0 and the second 1.16 to 2.0; of two
# images that were swapped the first is 0.5 to 0.9.
SWAPPED, FOREIGN = 0.85, 0.6
WRONG = {  # images of which a finding tells, and what it says of them
    "black-image": "black ones",
    "same-image": "the same pixels while driving",
    "strange-image": "unlike both neighbours, which are like each other",
    "image-order": "fits better in the place of the next image",
    "same-image: at rest": "the same pixels twice",
}


class ImageOrder:
    """Says which images do not lie between those before and after them; takes them one by one.

    The difference of two images is the mean of that of their small, blurred copies, of mean 0 and deviation 1. While a
    camera moves or watches what moves, it grows with the time between them.
    """

    def __init__(self, interval_ns: float) -> None:
        self._longest_ns = min(LONGEST_STEP_S * 1e9, 1.5 * interval_ns)
        self._last: deque[tuple[int, int, NDArray[np.float32]]] = deque(maxlen=2)
        self._next: dict[int, float] = {}  # difference to the next image, by row
        self._second: dict[int, float] = {}  # and to the one after it

    def add(self, row: int, timestamp_ns: int, pixels: NDArray[np.uint8]) -> None:
        """Compare an image, (H, W), with the two before it; rows increase."""
        height = max(round(pixels.shape[0] * COMPARED_PX / pixels.shape[1]), 1)
        reduced = cv2.resize(pixels, (COMPARED_PX, height), interpolation=cv2.INTER_AREA).astype(np.float32)
        blurred = cv2.GaussianBlur(reduced, (0, 0), BLUR_PX)
        small = np.asarray((blurred - blurred.mean()) / max(float(blurred.std()), 1.0), np.float32)
        for before, before_ns, image in self._last:
            steps = row - before
            if steps <= 2 and timestamp_ns - before_ns < steps * self._longest_ns:
                (self._next if steps == 1 else self._second)[before] = float(np.abs(small - image).mean())
        self._last.append((row, timestamp_ns, small))

    def foreign(self) -> list[int]:
        """Rows of images that differ from both neighbours far more than these from each other."""
        return [
            row + 1
            for row, around in self._second.items()
            if around < FOREIGN * min(self._next.get(row, 0.0), self._next.get(row + 1, 0.0))
        ]

    def swapped(self) -> list[int]:
        """Rows of images that, with the next one in their place, fit their neighbours better; not of foreign ones."""
        foreign, rows = set(self.foreign()), []
        known = {row for row in self._second if row in self._next and row + 1 in self._next}
        for row in self._next:
            before, after = row - 1 in known, row in known  # whether the images around the two were compared
            stated = before * self._next.get(row - 1, 0.0) + after * self._next.get(row + 1, 0.0)
            exchanged = before * self._second.get(row - 1, 0.0) + after * self._second.get(row, 0.0)
            if exchanged < SWAPPED * stated and not {row - 1, row, row + 1, row + 2} & foreign:
                rows.append(row)
        return rows


def check_images(recording: Recording, camera: str, rows: list[int], progress: Callable[[], None]) -> Iterator[Finding]:
    """Read images of a camera, their truth and their masks.

    Args:
        recording: the drive.
        camera: name of the camera.
        rows: indices of the images to read, increasing; neighbours are compared.
        progress: called after every image.
    """
    images, mounted = recording.images[camera], recording.cameras[camera]
    rows_by_digest: dict[bytes, int] = {}
    wrong: dict[str, list[ImageRef]] = {kind: [] for kind in WRONG}
    levels = np.zeros(256, dtype=bool)
    order = ImageOrder(recording.frame_interval_ns)
    for row in rows:
        image = images[row]
        try:
            pixels = read_image(image, mounted)
        except DataError as error:
            yield unusable(error, check="image", timestamp_ns=image.timestamp_ns)
        else:
            seen = pixels if mounted.ego_body is None else pixels[~mounted.ego_body]
            levels[seen] = True
            order.add(row, image.timestamp_ns, pixels)
            digest = blake2b(pixels.tobytes(), digest_size=16).digest()
            earlier = rows_by_digest.get(digest)
            if seen.size and float(seen.mean()) < BLACK and float(seen.std()) < BLACK:
                wrong["black-image"].append(image)
            elif earlier is not None and _moves(recording, images[earlier].timestamp_ns, image.timestamp_ns):
                wrong["same-image"].append(image)
            elif earlier is not None and earlier == row - 1:
                wrong["same-image: at rest"].append(image)
            rows_by_digest[digest] = row
        for check, path, read in (
            ("truth-image", image.truth_path, read_truth),
            ("mask-image", image.moving_path, read_moving_mask),
        ):
            try:
                if path is not None:
                    read(image, mounted)
            except DataError as error:
                yield unusable(error, check=check, timestamp_ns=image.timestamp_ns)
        progress()
    wrong["strange-image"] = [images[row] for row in order.foreign()]
    wrong["image-order"] = [images[row] for row in order.swapped()]
    field, used = f"images of {camera}", np.flatnonzero(levels)
    if len(wrong["black-image"]) < len(rows) and 1 < len(used) <= FEW_LEVELS and used[-1] < DARK_LEVEL:
        got = f"{len(used)} levels up to {used[-1]}"
        yield new_finding("grey-levels", got, file=images[rows[0]].path, field=field)
    for kind, of_kind in wrong.items():
        if of_kind:
            yield new_finding(
                kind,
                f"{WRONG[kind]}, {len(of_kind)} of those read",
                file=of_kind[0].path,
                field=field,
                times=len(of_kind),
                timestamp_ns=of_kind[0].timestamp_ns,
            )


def _moves(recording: Recording, first_ns: int, last_ns: int) -> bool:
    _, positions_m, valid = recording.trajectory.at(np.array([first_ns, last_ns], dtype=np.int64))
    return (
        bool(valid.all())
        and float(np.linalg.norm(positions_m[1] - positions_m[0])) > MOVING_MPS * (last_ns - first_ns) / 1e9
    )
