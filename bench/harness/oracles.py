"""Answers that no method could give: the reference itself, and the exact masks of simulated data.

Neither is a method, for methods never see annotations. The harness answers in their place, and a run's settings say so:
`sees_the_reference`, `sees_the_truth`. The reference scored against itself checks the evaluation: every metric must be
perfect. The exact masks are the ceiling: what the truth scores under a protocol. Their variants (grown, shifted,
filled to the convex hull, upper half) show what a protocol thinks of masks that are wrong in a known way.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeGuard

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.cameras import ray_grid
from bench.errors import DataError, UsageError
from bench.methods import Method, Scorable, Segmentation, build_method, known_methods
from bench.methods.contract import not_derived, refuse_unfit
from bench.methods.registry import build
from bench.recordings import ImageRef, Recording, read_truth
from bench.reference import ReferenceFrame, Status

Shape = Literal["exact", "hull", "upper_half"]


@dataclass(frozen=True, kw_only=True)
class ReferenceItself(Scorable):
    """The reference in place of a method: a check of the evaluation, which every metric must pass with 1 or 0.

    Attributes:
        sees_the_reference: the mark by which a table tells it from methods.
    """

    name = "reference"
    reads_images = False

    sees_the_reference: bool = True

    def __post_init__(self) -> None:
        if self.sees_the_reference is not True:
            raise UsageError(f"reference: it sees the reference and nothing else, got {self.sees_the_reference!r}")

    def answer(self, recording: Recording, image: ImageRef, reference: ReferenceFrame) -> Segmentation:  # noqa: ARG002
        """The evaluated objects of the reference, all pixels of their regions."""
        return Segmentation(cell_size_px=1, mask=reference.labels > 0)


@dataclass(frozen=True, kw_only=True)
class ExactMasks(Scorable):
    """The exact masks of all moving objects, in place of a method: the ceiling of a protocol.

    Attributes:
        cell_size_px: side of the cells of the answer, each of which is what its centre shows; 1 for every pixel.
        grow_px: pixels by which each object's mask grows, in a disc; negative: shrinks.
        shift_px: pixels by which it moves to the right.
        shape: the mask as it is, its convex hull, or its upper half.
        sees_the_truth: the mark by which a table tells it from methods.
    """

    name = "truth"
    reads_images = False

    cell_size_px: int = 1
    grow_px: int = 0
    shift_px: int = 0
    shape: Shape = "exact"
    sees_the_truth: bool = True

    def __post_init__(self) -> None:
        if self.sees_the_truth is not True:
            raise UsageError(f"truth: it sees the exact masks and nothing else, got {self.sees_the_truth!r}")
        for name, least in (("cell_size_px", 1), ("grow_px", -100), ("shift_px", -1000)):
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= 1000:
                raise UsageError(f"truth: {name}: expected a whole number from {least} to 1000, got {value!r}")
        if self.shape not in ("exact", "hull", "upper_half"):
            raise UsageError(f"truth: shape: expected exact, hull or upper_half, got {self.shape!r}")

    def answer(self, recording: Recording, image: ImageRef, reference: ReferenceFrame) -> Segmentation:
        """The pixels of every annotated object that moves, evaluated or not."""
        if image.truth_path is None:
            raise DataError(
                recording.root,
                expected="exact masks (truth/<camera>/<timestamp_ns>.png)",
                got="a recording without",
                hint="only simulated data have them: score a method, or --method reference",
            )
        return self.of_truth(read_truth(image, recording.cameras[image.camera]), recording, reference)

    def of_truth(self, ids: NDArray[np.uint16], recording: Recording, reference: ReferenceFrame) -> Segmentation:
        """The same, from the image's true instance ids, (H, W)."""
        if (self.grow_px, self.shift_px, self.shape) == (0, 0, "exact"):
            mask = exact_mask(ids, recording, reference)
        else:
            mask = np.zeros(ids.shape, dtype=bool)
            for number in moving_instances(recording, reference):
                mask |= self._varied(ids == number)
        if self.cell_size_px > 1:
            camera = recording.cameras[reference.camera]
            mask = ray_grid(camera.model, self.cell_size_px).at_centres(mask)
        return Segmentation(cell_size_px=self.cell_size_px, mask=mask)

    def _varied(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The mask of one object, wrong as the parameters say."""
        if not mask.any():
            return mask
        rows = np.flatnonzero(mask.any(axis=1))
        varied = mask.astype(np.uint8)
        if self.shape == "upper_half":
            varied[(rows[0] + rows[-1]) // 2 + 1 :] = 0
        elif self.shape == "hull":
            points = cv2.findNonZero(varied)
            cv2.fillConvexPoly(varied, cv2.convexHull(points), 1)
        if self.grow_px:
            size = 2 * abs(self.grow_px) + 1
            disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
            change = cv2.dilate if self.grow_px > 0 else cv2.erode
            varied = change(varied, disc).astype(np.uint8, copy=False)
        if self.shift_px:
            shift = np.array([[1.0, 0.0, self.shift_px], [0.0, 1.0, 0.0]])
            size_px = (mask.shape[1], mask.shape[0])
            varied = cv2.warpAffine(varied, shift, size_px, flags=cv2.INTER_NEAREST).astype(np.uint8, copy=False)
        return varied > 0


Oracle = ReferenceItself | ExactMasks


def is_oracle(method: object) -> TypeGuard[Oracle]:
    """True if the harness answers in place of a method; never for a class from elsewhere."""
    return type(method) in (ReferenceItself, ExactMasks)


def moving_instances(recording: Recording, reference: ReferenceFrame) -> list[int]:
    """Numbers in truth images of the annotated objects that move, evaluated or ignored.

    Args:
        recording: simulated.
        reference: of the image.
    """
    number_of = {track.track_id: track.instance_id for track in recording.tracks}
    numbers = (number_of[item.track_id] for item in reference.objects if item.status is not Status.STATIC)
    return [number for number in numbers if number is not None]


def exact_mask(ids: NDArray[np.uint16], recording: Recording, reference: ReferenceFrame) -> NDArray[np.bool_]:
    """Pixels of all annotated objects that move: (H, W) bool.

    Args:
        ids: (H, W) uint16, the image's true instance ids.
        recording: simulated.
        reference: of the image.
    """
    return np.isin(ids, np.array(moving_instances(recording, reference), dtype=np.int64))


ORACLES = {
    "reference": "bench.harness.oracles:ReferenceItself",
    "truth": "bench.harness.oracles:ExactMasks",
    "exact-flow": "bench.harness.exact_flow:SphericalOnExactFlow",
}


def scorable_methods() -> dict[str, str]:
    """Name -> "module:Class" of all that can be scored: the methods, and what knows more than a method may."""
    return known_methods() | ORACLES


def build_scorable(name: str, parameters: Mapping[str, object] | None = None) -> Scorable:
    """Build anything that can be scored; see `bench.methods.build_method`.

    Raises:
        UnknownNameError: no such method.
        UsageError: it cannot be imported, or refuses a parameter.
    """
    target = ORACLES.get(name, name)
    return build(name, target, Scorable, parameters) if target in ORACLES.values() else build_method(name, parameters)


def require_scorable(value: object) -> Scorable:
    """Pass on what can be scored: a method, or an oracle of this module.

    Raises:
        UsageError: an object of a class that does not derive from `Method`.
    """
    if isinstance(value, Method) or is_oracle(value):
        refuse_unfit(value)
        return value
    raise UsageError(not_derived(type(value).__name__))
