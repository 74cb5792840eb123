"""The chance level: the same objects scored against the mask of another frame of the same sequence."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.reference.records import ReferenceFrame, Status


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Mask:
    timestamp_ns: int
    packed: NDArray[np.uint8]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Objects:
    """The evaluated objects of a frame.

    Attributes:
        timestamp_ns: of the frame.
        evaluated: label of each, by track id.
        pixel: (P,) index into the flattened image of every pixel in their regions.
        label: (P,) whose it is.
    """

    timestamp_ns: int
    evaluated: dict[str, int]
    pixel: NDArray[np.int32]
    label: NDArray[np.int32]


class ChanceScorer:
    """Scores the frames of one camera's sequence, fed in time order, against the mask of a frame `lag_ns` away.

    A frame is scored against the latest mask at least `lag_ns` earlier. The first frames, which have none, wait for the
    first mask at least `lag_ns` later. In a sequence that is too short for either there is no chance level. At most the
    masks of one lag are kept, one bit a pixel.

    Args:
        lag_ns: how far away the other frame is.
    """

    def __init__(self, *, lag_ns: int) -> None:
        self._lag_ns = lag_ns
        self._masks: deque[_Mask] = deque()
        self._waiting: deque[_Objects] = deque()
        self._results: dict[int, dict[str, int]] = {}

    def add(self, reference: ReferenceFrame, detected: NDArray[np.bool_]) -> None:
        """Take the next frame.

        Args:
            reference: of the frame.
            detected: (H, W) bool, the method's mask of the frame.
        """
        assert not self._masks or reference.timestamp_ns > self._masks[-1].timestamp_ns, "frames come in time order"
        mask = _Mask(timestamp_ns=reference.timestamp_ns, packed=np.packbits(detected))
        while self._waiting and self._waiting[0].timestamp_ns <= mask.timestamp_ns - self._lag_ns:
            self._score(self._waiting.popleft(), mask)
        self._masks.append(mask)
        objects = _objects(reference)
        earlier = self._earlier_mask(reference.timestamp_ns)
        if earlier is None:
            self._waiting.append(objects)
        else:
            self._score(objects, earlier)

    def finish(self) -> dict[int, dict[str, int]]:
        """End the sequence.

        Returns:
            By timestamp, then by track id: pixels of the object in the other frame's mask. Frames without another
            one are missing, and so are objects that are not evaluated.
        """
        return self._results

    def _earlier_mask(self, timestamp_ns: int) -> _Mask | None:
        latest_ns = timestamp_ns - self._lag_ns
        while len(self._masks) > 1 and self._masks[1].timestamp_ns <= latest_ns:
            self._masks.popleft()
        return self._masks[0] if self._masks[0].timestamp_ns <= latest_ns else None

    def _score(self, objects: _Objects, mask: _Mask) -> None:
        bits = mask.packed[objects.pixel >> 3] >> (7 - (objects.pixel & 7)).astype(np.uint8) & 1
        found = np.bincount(objects.label[bits == 1], minlength=max(objects.evaluated.values(), default=0) + 1)
        self._results[objects.timestamp_ns] = {name: int(found[label]) for name, label in objects.evaluated.items()}


def _objects(reference: ReferenceFrame) -> _Objects:
    flat = reference.labels.reshape(-1)
    pixel = np.flatnonzero(flat > 0).astype(np.int32)
    return _Objects(
        timestamp_ns=reference.timestamp_ns,
        evaluated={o.track_id: k + 1 for k, o in enumerate(reference.objects) if o.status is Status.EVALUATED},
        pixel=pixel,
        label=flat[pixel],
    )
