"""Agreement over time, for any method: what it marks is followed back through the last images.

Every pixel of the current image is followed by dense flow to where its content was, image by image. A region that the
method marks now, and did not mark where it was before, is doubted and left out; one that it marked in every earlier
image, and not now, is completed. Regions are decided as wholes, so outlines stay as the method draws them. It looks
back only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from bench.errors import UsageError
from bench.methods.contract import Method, MethodInput, UnansweredImage
from bench.methods.registry import build_method
from bench.methods.rigid_scene.method import RigidSceneMethod
from bench.methods.rigid_scene.scene import pixel_positions, remapped
from bench.records.segmentation import Segmentation

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
Answer = TypeVar("Answer")
FLOW = RigidSceneMethod()  # whose flow starts from the motion of a rigid scene
DOUBTED = 0.25  # a region of which less was marked before
STEADY = 0.9  # what was marked in so many of the earlier images was marked in all, but for interpolation


@dataclass(frozen=True, kw_only=True)
class FollowedMethod(Method):
    """Any method, whose regions have to agree with its answers on the images before.

    Attributes:
        method: name of the method, or "module:Class".
        parameters: of the method.
        images: how many images are looked at, the current one among them; 1 leaves the method as it is.

    Raises:
        UsageError: a method that is itself followed.
    """

    name = "followed"

    method: str = "rigid-scene"
    parameters: dict[str, object] = field(default_factory=dict)
    images: Annotated[int, Field(ge=1)] = 3

    def __post_init__(self) -> None:
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
        """Whether the followed method takes colour."""
        return self._inner.colour

    @property
    def files(self) -> Sequence[str | Path]:  # type: ignore[override]
        """Those of the method."""
        return self._inner.files

    def segment(self, frame: MethodInput) -> Segmentation:
        """Segment the last image; see `bench.methods.contract`.

        Raises:
            UnansweredImage: the method has no answer for it.
        """
        now = self._noted(frame, 0, "answer", self._inner.segment)
        if self.images == 1:
            return now
        shape = now.mask.shape
        place, inside = pixel_positions(*shape[::-1]), np.ones(shape, dtype=bool)
        marked, seen = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        last = min(self.images - 1, len(frame.images) - 1 - self._inner.history)
        for back in range(1, last + 1):
            flow = self._noted(frame, back - 1, "flow", FLOW.mean_flow)
            place = place + remapped(_on_cells(flow, now), place, outside=None)
            inside &= remapped(frame.valid.astype(np.float32), place * now.cell_size_px) > 0.99
            try:
                before = self._noted(frame, back, "answer", self._inner.segment)
            except UnansweredImage:
                break
            marked += np.where(inside, remapped(before.mask.astype(np.float32), place), np.float32(0))
            seen += inside
        return replace(now, mask=_agreed(now.mask, marked, seen), threshold=None)  # no likelihood alone decides

    def _noted(self, frame: MethodInput, back: int, kind: str, compute: Callable[[MethodInput], Answer]) -> Answer:
        """Compute something of the image `back` before the current one, unless it was noted when that was current."""
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


def _as_of(frame: MethodInput, back: int, *, images: int) -> MethodInput:
    """Return the input of a method that uses so many images where the image `back` before is the current one."""
    end = len(frame.images) - back
    start = max(end - images, 0)
    return replace(
        frame,
        images=frame.images[start:end],
        timestamps_ns=frame.timestamps_ns[start:end],
        current_from_previous=frame.current_from_previous[start : end - 1],
    )


def _agreed(mask: Mask, marked: Image, seen: Image) -> Mask:
    """A mask without the regions that are doubted, and with those that are completed.

    Args:
        mask: (rows, columns), of the current image.
        marked: (rows, columns), in how many earlier images a cell was marked.
        seen: (rows, columns), in how many it could be followed.
    """
    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    of_region = [np.bincount(labels.ravel(), part.ravel(), minlength=count) for part in (marked, seen, seen > 0, mask)]
    before, possible, followed, cells = of_region
    doubted = (before < DOUBTED * possible) & (followed > 0.5 * cells)
    steady = (seen > 1) & (marked > STEADY * seen)
    count, regions = cv2.connectedComponents(steady.astype(np.uint8), connectivity=8)
    missed = np.bincount(regions[mask], minlength=count) == 0
    missed[0] = False
    return np.asarray((mask & ~doubted[labels]) | missed[regions])


def _on_cells(flow: Image, answer: Segmentation) -> Image:
    """A flow in pixels of the images, on a coarser grid of them, on the cells of an answer and in cells."""
    rows, columns = answer.mask.shape
    enlarged = cv2.resize(flow, (columns, rows), interpolation=cv2.INTER_LINEAR)
    return np.asarray(enlarged / answer.cell_size_px, dtype=np.float32)
