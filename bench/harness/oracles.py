"""Answers that no method could give: the reference itself, and the exact masks of simulated data.

Neither is a method, for methods never see annotations. The harness answers in their place, and a run's settings say so:
`sees_the_reference`, `sees_the_truth`. The reference scored against itself checks the evaluation: every metric must be
perfect. The exact masks are the ceiling: what the truth scores under a protocol. Their variants, outlines that are off
and objects or parts that lack or are added (`bench.harness.wrong_masks`), show what a protocol thinks of masks that are
wrong in a known way.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeGuard, get_args

import numpy as np
from numpy.typing import NDArray

from bench.cameras import ray_grid
from bench.errors import DataError, UsageError
from bench.harness.wrong_masks import grown, merged, reshaped, shifted, with_ghost, with_shadow
from bench.methods import Method, Scorable, Segmentation, build_method, known_methods
from bench.methods.contract import not_derived, refuse_unfit
from bench.methods.registry import build
from bench.recordings import ImageRef, Recording, read_truth
from bench.reference import ReferenceFrame, Status

Shape = Literal["exact", "hull", "box", "upper_half", "feet"]
WHOLE = {"cell_size_px": (1, 1000), "grow_px": (-100, 1000), "shift_px": (-1000, 1000), "lag_images": (0, 1000),
         "merge_px": (0, 1000)}  # fmt: skip
SHARES = {"drop_share": 1.0, "ghost_widths": 100.0, "shadow": 10.0}


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
        shape: the mask as it is, its convex hull, its bounding box, its upper half, or its lowest fifth.
        lag_images: images by which the answer is late; at the start of a recording the first image's.
        drop_share: share of the object-frames that are missed.
        ghost_widths: distance of a copy to the right of each object, in widths of the object; 0 for none.
        merge_px: objects at most so far apart are one, with their common hull; 0 for none.
        shadow: length of a shadow of each object, over the object's height; 0 for none.
        sees_the_truth: the mark by which a table tells it from methods.
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
    sees_the_truth: bool = True

    def __post_init__(self) -> None:
        if self.sees_the_truth is not True:
            raise UsageError(f"truth: it sees the exact masks and nothing else, got {self.sees_the_truth!r}")
        for name, (least, most) in WHOLE.items():
            value = getattr(self, name)
            if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
                raise UsageError(f"truth: {name}: expected a whole number from {least} to {most}, got {value!r}")
        for name, largest in SHARES.items():
            value = getattr(self, name)
            if not isinstance(value, int | float) or isinstance(value, bool) or not 0 <= value <= largest:
                raise UsageError(f"truth: {name}: expected a number from 0 to {largest:g}, got {value!r}")
        if self.shape not in get_args(Shape):
            raise UsageError(f"truth: shape: expected one of {', '.join(get_args(Shape))}, got {self.shape!r}")

    @property
    def changes_objects(self) -> bool:
        """Whole objects or parts lack or are added; else outlines are off at most."""
        whole_objects = self.drop_share or self.ghost_widths or self.merge_px or self.shadow
        return bool(whole_objects) or self.shape in ("upper_half", "feet")

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
