"""Answers that no method could give: the reference itself, and the exact masks of simulated data.

Neither is a method, for methods never see annotations. The harness writes their answers in the place of a method's, and
a run's settings say so: `sees_the_reference`, `sees_the_truth`. The reference scored against itself checks the
evaluation: every metric must be perfect. The exact masks are the ceiling: what the truth scores under a protocol.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

from bench.errors import DataError, UsageError
from bench.methods import Method, Scorable, Segmentation, build_method, known_methods
from bench.methods.contract import not_derived, refuse_unfit
from bench.methods.registry import build
from bench.recordings import ImageRef, Recording, read_truth
from bench.records.reference import ReferenceFrame, Status


@dataclass(frozen=True, kw_only=True)
class ReferenceItself(Scorable):
    """The reference in place of a method: a check of the evaluation, which every metric must pass with 1 or 0."""

    name = "reference"
    reads_images = False

    def settings(self) -> dict[str, object]:
        """The mark by which a table tells it from methods."""
        return {"sees_the_reference": True}

    def answer(self, recording: Recording, image: ImageRef, reference: ReferenceFrame) -> Segmentation:  # noqa: ARG002
        """The evaluated objects of the reference, all pixels of their regions."""
        return Segmentation(cell_size_px=1, mask=reference.labels > 0)


@dataclass(frozen=True, kw_only=True)
class ExactMasks(Scorable):
    """The exact masks of all moving objects, in place of a method: the ceiling of a protocol."""

    name = "truth"
    reads_images = False

    def settings(self) -> dict[str, object]:
        """The mark by which a table tells it from methods."""
        return {"sees_the_truth": True}

    def answer(self, recording: Recording, image: ImageRef, reference: ReferenceFrame) -> Segmentation:
        """The pixels of every annotated object that moves, evaluated or not."""
        mask = read_exact_mask(image, recording, reference)
        if mask is None:
            raise DataError(
                recording.root,
                expected="exact masks (truth/<camera>/<timestamp_ns>.png)",
                got="a recording without",
                hint="only simulated data have them: score a method, or --method reference",
            )
        return Segmentation(cell_size_px=1, mask=mask)


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


def read_exact_mask(image: ImageRef, recording: Recording, reference: ReferenceFrame) -> NDArray[np.bool_] | None:
    """The exact mask of an image; None where the data have none.

    Raises:
        DataError: its file cannot be used.
    """
    if image.truth_path is None:
        return None
    return exact_mask(read_truth(image, recording.cameras[image.camera]), recording, reference)


ORACLES = {"reference": "bench.harness.exact:ReferenceItself", "truth": "bench.harness.exact:ExactMasks"}


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
