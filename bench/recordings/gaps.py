"""Times at which a camera missed images."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from bench.recordings.records import Recording

GAP_INTERVALS = 1.5  # a pair further apart than this many nominal intervals has an image missing between


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameGap:
    """Two neighbouring images too far apart to be compared.

    Attributes:
        index: of the later image among the camera's.
        previous_ns: time of the earlier image.
        current_ns: time of the later image.
    """

    index: int
    previous_ns: int
    current_ns: int


def frame_gaps(recording: Recording, camera: str) -> tuple[FrameGap, ...]:
    """Neighbouring images of a camera that lie more than 1.5 nominal intervals apart, in order of time."""
    images = recording.images[camera]
    limit_ns = GAP_INTERVALS * recording.frame_interval_ns
    return tuple(
        FrameGap(index=i, previous_ns=before.timestamp_ns, current_ns=after.timestamp_ns)
        for i, (before, after) in enumerate(pairwise(images), start=1)
        if after.timestamp_ns - before.timestamp_ns > limit_ns
    )
