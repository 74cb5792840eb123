"""Agreement over time, for any method: what it marks is followed through the last images, and the majority holds.

What appears in one image alone is doubted, and what was there before and after a gap is completed. It looks back only.
Every pixel of the current image is followed by dense flow to where its content was, image by image, and the answers
there are averaged: scores where the method has them, else its masks. Pixels that cannot be followed, at the border of
the lens's field, keep the answers of the images that show them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.errors import UsageError
from bench.methods.contract import Method, MethodInput, UnansweredImage, compute_anew
from bench.methods.registry import build_method
from bench.methods.rigid_scene.method import RigidSceneMethod
from bench.methods.rigid_scene.scene import pixel_positions, remapped
from bench.records.segmentation import Segmentation

Image = NDArray[np.float32]
Answer = TypeVar("Answer")
FLOW = RigidSceneMethod()  # whose flow starts from the motion of a rigid scene


@dataclass(frozen=True, kw_only=True)
class FollowedMethod(Method):
    """Any method, with the majority of its answers on the last images in place of the one on the current image.

    Attributes:
        method: name of the method, or "module:Class".
        parameters: of the method.
        images: how many images agree, the current one among them; 1 leaves the method as it is.

    Raises:
        UsageError: fewer than one image, or a method that is itself followed.
    """

    name = "followed"

    method: str = "rigid-scene"
    parameters: dict[str, object] = field(default_factory=dict)
    images: int = 3

    def __post_init__(self) -> None:
        if not isinstance(self.images, int) or self.images < 1:
            raise UsageError(f"followed: images: expected a whole number of at least 1, got {self.images}")
        if self.method == self.name:
            raise UsageError("followed: method: expected one that is not followed itself, got 'followed'")
        self._inner  # noqa: B018 - errors of the method are told when this one is built

    @property
    def history(self) -> int:  # type: ignore[override]
        """Earlier images that the method needs."""
        return max(self._inner.history, 1)

    @property
    def longest_history(self) -> int:  # type: ignore[override]
        """So many that the method has all that it can use on the earliest of the images, too."""
        return self._inner.most_history + self.images - 1

    @property
    def colour(self) -> bool:  # type: ignore[override]
        """As the method."""
        return self._inner.colour

    @property
    def files(self) -> Sequence[str | Path]:  # type: ignore[override]
        """Those of the method."""
        return self._inner.files

    def segment(self, frame: MethodInput) -> Segmentation:
        """Segment the last image; see `bench.methods.contract`.

        Raises:
            UnansweredImage: the method has no answer for it, or there is no ego-motion to follow by.
        """
        if not frame.current_from_previous:
            raise UnansweredImage("followed: expected the ego-motion between the images, got none")
        now = self._noted(frame, 0, "answer", self._inner.segment)
        total, images = _values(now), np.ones(now.mask.shape, np.float32)
        place, seen = pixel_positions(*total.shape[::-1]), np.ones(total.shape, dtype=bool)
        last = min(self.images - 1, len(frame.images) - 1 - self._inner.history)
        for back in range(1, last + 1):
            flow = self._noted(frame, back - 1, "flow", FLOW.mean_flow)
            place = place + remapped(_on_cells(flow, now), place, outside=None)
            seen &= remapped(frame.valid.astype(np.float32), place * now.cell_size_px) > 0.99
            try:
                before = self._noted(frame, back, "answer", self._inner.segment)
            except UnansweredImage:
                break
            total += np.where(seen, remapped(_values(before), place, outside=None), np.float32(0))
            images += seen
        mean = total / images
        if now.likelihood_is_score and now.threshold is not None:
            return replace(now, mask=mean > now.threshold, likelihood=np.clip(mean, 0, 1))
        tied = np.abs(mean - 0.5) < 1e-3
        return replace(now, mask=np.where(tied, now.mask, mean > 0.5))

    def _noted(self, frame: MethodInput, back: int, kind: str, compute: Callable[[MethodInput], Answer]) -> Answer:
        """What is computed of the image `back` before the current one: noted, if that has been the current one."""
        given = _as_of(frame, back, images=self._inner.most_history + 1)
        key = kind, given.timestamps_ns
        if key not in self._notes:
            self._notes[key] = compute(given)
            while len(self._notes) > 2 * self.images:
                del self._notes[next(iter(self._notes))]
        noted: Answer = self._notes[key]
        return noted

    @cached_property
    def _inner(self) -> Method:
        return build_method(self.method, self.parameters)

    @cached_property
    def _notes(self) -> dict[tuple[str, tuple[int, ...]], Any]:
        return {}

    def __getstate__(self) -> dict[str, object]:
        return self.settings()  # notes stay where they were made

    def __setstate__(self, settings: dict[str, object]) -> None:
        self.__dict__.update(settings)


def _as_of(frame: MethodInput, back: int, *, images: int) -> MethodInput:
    """What a method that uses so many images is given where the image `back` before is the current one."""
    end = len(frame.images) - back
    start = max(end - images, 0)
    return replace(
        frame,
        images=frame.images[start:end],
        timestamps_ns=frame.timestamps_ns[start:end],
        current_from_previous=frame.current_from_previous[start : end - 1],
        cached_step=frame.cached_step if back == 0 else compute_anew,  # the cache is of the current image
    )


def _values(answer: Segmentation) -> Image:
    """Scores, or 1 where something moves and 0 elsewhere; a new array."""
    scored = answer.likelihood_is_score and answer.threshold is not None and answer.likelihood is not None
    return np.array(answer.likelihood if scored else answer.mask, dtype=np.float32)


def _on_cells(flow: Image, answer: Segmentation) -> Image:
    """A flow in pixels of the images, on a coarser grid of them, on the cells of an answer and in cells."""
    rows, columns = answer.mask.shape
    enlarged = cv2.resize(flow, (columns, rows), interpolation=cv2.INTER_LINEAR)
    return np.asarray(enlarged / answer.cell_size_px, dtype=np.float32)
