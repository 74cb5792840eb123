"""Exact masks made wrong in known ways: outlines that are off, and whole objects or parts that lack or are added."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.cameras.model import ray_grid
from bench.errors import UsageError
from bench.harness.exact import moving_instances
from bench.methods import Scorable, Segmentation
from bench.recordings import Recording, read_truth
from bench.records.reference import ReferenceFrame

Shape = Literal["exact", "hull", "box", "upper_half", "feet"]

Mask = NDArray[np.bool_]
FEET = 0.2  # of an object's rows


def reshaped(mask: Mask, shape: str) -> Mask:
    """The mask of an object, not empty, as it is, as its hull or bounding box, its upper half or its lowest fifth."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    found = mask.astype(np.uint8)
    if shape == "hull":
        cv2.fillConvexPoly(found, cv2.convexHull(cv2.findNonZero(found)), 1)
    elif shape == "box":
        found[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] = 1
    elif shape == "upper_half":
        found[(rows[0] + rows[-1]) // 2 + 1 :] = 0
    elif shape == "feet":
        found[: rows[-1] + 1 - max(round(FEET * (rows[-1] + 1 - rows[0])), 1)] = 0
    return found > 0


def grown(mask: Mask, by_px: int) -> Mask:
    """The mask grown in a disc; shrunk for a negative number."""
    size = 2 * abs(by_px) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    change = cv2.dilate if by_px > 0 else cv2.erode
    return np.asarray(change(mask.astype(np.uint8), disc) > 0)


def shifted(mask: Mask, by_px: int) -> Mask:
    """The mask moved to the right; what leaves the image is gone."""
    return _mapped(mask, [[1.0, 0.0, by_px], [0.0, 1.0, 0.0]])


def with_ghost(mask: Mask, widths: float) -> Mask:
    """The mask of an object, not empty, and a copy of it to the right, so many of its widths away."""
    columns = np.flatnonzero(mask.any(axis=0))
    return mask | shifted(mask, round(widths * int(columns[-1] + 1 - columns[0])))


def with_shadow(mask: Mask, length: float) -> Mask:
    """The mask of an object, not empty, and a shadow that begins at its lowest row and falls down and to the right.

    Args:
        mask: (H, W) bool.
        length: of the shadow, over the object's height.
    """
    lowest = int(np.flatnonzero(mask.any(axis=1))[-1])
    return mask | _mapped(mask, [[1.0, -length, length * lowest], [0.0, -length, (1 + length) * lowest]])


def merged(masks: Sequence[Mask], within_px: int) -> list[Mask]:
    """The masks of objects, not empty, and for every two that are at most so far apart the convex hull of both."""
    away_px = [cv2.distanceTransform((~mask).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for mask in masks]
    pairs = [(one, other) for other in range(len(masks)) for one in range(other)]
    near = [masks[one] | masks[other] for one, other in pairs if away_px[one][masks[other]].min() <= within_px]
    return [*masks, *(reshaped(both, "hull") for both in near)]


def _mapped(mask: Mask, matrix: list[list[float]]) -> Mask:
    size_px = (mask.shape[1], mask.shape[0])
    return np.asarray(cv2.warpAffine(mask.view(np.uint8), np.array(matrix), size_px, flags=cv2.INTER_NEAREST) > 0)


@dataclass(frozen=True, kw_only=True)
class WrongMasks(Scorable):
    """The exact masks of all moving objects, wrong in known ways: outlines that are off, objects or parts that lack.

    Attributes:
        cell_size_px: side of the cells of the answer, each of which is what its centre shows; 1 for every pixel.
        grow_px: pixels by which each object's mask grows, in a disc; negative: shrinks.
        shift_px: pixels by which it moves to the right.
        shape: the mask as it is, its convex hull, its bounding box, its upper half, or its lowest fifth.
        lag_images: images by which the answer is late; at the start of a recording the first image's.
        drop_share: share of the object-frames that are missed.
        ghost_widths: distance of a copy to the right of each object, in widths of the object; 0 for none.
        merge_px: objects at most so far apart are one, with their common hull; 0 for none.
        shadow: length of a shadow of each object, over the object's height; 0 for none.
    """

    name = "truth"
    reads_images = False

    cell_size_px: int = 1
    grow_px: int = 0
    shift_px: int = 0
    shape: Shape = "exact"
    lag_images: int = 0
    drop_share: float = 0.0
    ghost_widths: float = 0.0
    merge_px: int = 0
    shadow: float = 0.0

    def __post_init__(self) -> None:
        if self.shape not in get_args(Shape):
            raise UsageError(f"truth: shape: expected one of {', '.join(get_args(Shape))}, got {self.shape!r}")

    @property
    def changes_objects(self) -> bool:
        """Whole objects or parts lack or are added; else outlines are off at most."""
        whole_objects = self.drop_share or self.ghost_widths or self.merge_px or self.shadow
        return bool(whole_objects) or self.shape in ("upper_half", "feet")

    def of_truth(self, ids: NDArray[np.uint16], recording: Recording, reference: ReferenceFrame) -> Segmentation:
        """The answer for an image.

        Args:
            ids: (H, W) uint16, the image's true instance ids.
            recording: simulated.
            reference: of the image, which says what moves.
        """
        ids = self._late(ids, recording, reference)
        numbers = [k for k in moving_instances(recording, reference) if not self._dropped(k, reference.timestamp_ns)]
        mask = np.isin(ids, np.array(numbers, dtype=np.int64))
        if self != replace(self, grow_px=0, shift_px=0, shape="exact", ghost_widths=0.0, merge_px=0, shadow=0.0):
            masks = [self._varied(ids == number) for number in numbers if (ids == number).any()]
            masks = merged([one for one in masks if one.any()], self.merge_px) if self.merge_px else masks
            mask = np.logical_or.reduce([np.zeros_like(mask), *masks])
        if self.cell_size_px > 1:
            camera = recording.cameras[reference.camera]
            mask = ray_grid(camera.model, self.cell_size_px).at_centres(mask)
        return Segmentation(cell_size_px=self.cell_size_px, mask=mask)

    def _late(self, ids: NDArray[np.uint16], recording: Recording, reference: ReferenceFrame) -> NDArray[np.uint16]:
        """The ids of the image that the answer is of."""
        if not self.lag_images:
            return ids
        images = recording.images[reference.camera]
        current = next(k for k, image in enumerate(images) if image.timestamp_ns == reference.timestamp_ns)
        return read_truth(images[max(current - self.lag_images, 0)], recording.cameras[reference.camera])

    def _dropped(self, number: int, timestamp_ns: int) -> bool:
        """The same for every reference and in every process."""
        return bool(np.random.default_rng([number, timestamp_ns]).random() < self.drop_share)

    def _varied(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The mask of one object, not empty, wrong as the parameters say."""
        varied = reshaped(mask, self.shape)
        if self.shadow:
            varied = with_shadow(varied, self.shadow)
        if self.ghost_widths:
            varied = with_ghost(varied, self.ghost_widths)
        if self.grow_px:
            varied = grown(varied, self.grow_px)
        return shifted(varied, self.shift_px) if self.shift_px else varied
