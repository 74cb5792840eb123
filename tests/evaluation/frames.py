"""Reference frames built by hand, and random ones for properties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from numpy.typing import NDArray

from bench.records.reference import Category, Direction, IgnoreReason, ReferenceFrame, ReferenceObject, Status

SIZE = (9, 12)


def reference_object(track_id: str, **changes: object) -> ReferenceObject:
    """A pedestrian that crosses 3 m ahead."""
    item = ReferenceObject(
        track_id=track_id,
        object_class="pedestrian",
        status=Status.EVALUATED,
        reason=None,
        category=Category.CROSSING,
        direction=Direction.LATERAL,
        speed_mps=1.2,
        range_m=3.0,
        centroid_m=np.array([4.5, 0.5]),
        points=80,
        polygon=None,
        polygon_px=0,
        region_px=0,
    )
    return replace(item, **changes)  # type: ignore[arg-type]


def static_object(track_id: str) -> ReferenceObject:
    return reference_object(track_id, status=Status.STATIC, category=None)


def ignored_object(track_id: str, reason: IgnoreReason = IgnoreReason.RANGE) -> ReferenceObject:
    return reference_object(track_id, status=Status.IGNORED, reason=reason)


def reference_frame(
    labels: NDArray[np.int32], *, objects: Sequence[ReferenceObject] | None = None, **changes: object
) -> ReferenceFrame:
    """A frame from labels, changed in some fields; objects "a", "b" ... where none are given."""
    labels = np.asarray(labels, dtype=np.int32)
    nowhere = np.zeros(labels.shape, dtype=bool)
    if objects is None:
        objects = [reference_object(chr(ord("a") + k)) for k in range(labels.max(initial=0))]
    frame = ReferenceFrame(
        recording="drive",
        camera="front",
        timestamp_ns=0,
        ego_speed_mps=2.0,
        objects=tuple(replace(o, region_px=int((labels == k + 1).sum())) for k, o in enumerate(objects)),
        labels=labels,
        ignored=nowhere,
        unknown=nowhere,
        left_out=nowhere,
        valid=~nowhere,
    )
    return replace(frame, **changes)  # type: ignore[arg-type]


def picture(text: str) -> NDArray[np.int32]:
    """Labels from a drawing: a dot is 0, a digit itself."""
    rows = [line.strip() for line in text.strip().splitlines()]
    return np.array([[0 if c == "." else int(c) for c in row] for row in rows], dtype=np.int32)


def mask(text: str) -> NDArray[np.bool_]:
    """A mask from a drawing: a dot is False."""
    return np.array([[c != "." for c in line.strip()] for line in text.strip().splitlines()])


masks = npst.arrays(bool, SIZE)


@st.composite
def frames(draw: st.DrawFn) -> ReferenceFrame:
    """Random regions: rectangles that occlude each other, nearest first, with ignored and static objects between."""
    valid = ~draw(npst.arrays(bool, SIZE, fill=st.just(False)))
    labels, ignored = np.zeros(SIZE, dtype=np.int32), np.zeros(SIZE, dtype=bool)
    objects: list[ReferenceObject] = []
    for name in draw(st.permutations("abcdef"))[: draw(st.integers(0, 5))]:
        box = _box(draw)
        free = np.zeros(SIZE, dtype=bool)
        free[box] = (valid & (labels == 0))[box]
        status = draw(st.sampled_from(["evaluated", "evaluated", "ignored", "static"]))
        if status == "evaluated" and free.any():
            objects.append(reference_object(name))
            labels[free] = len(objects)
        elif status == "static":
            objects.append(static_object(name))
        else:
            objects.append(ignored_object(name))
            ignored |= free
    return reference_frame(labels, objects=objects, ignored=ignored & (labels == 0), valid=valid)


def _box(draw: st.DrawFn) -> tuple[slice, slice]:
    v, u = draw(st.integers(0, SIZE[0] - 1)), draw(st.integers(0, SIZE[1] - 1))
    return slice(v, v + draw(st.integers(1, 5))), slice(u, u + draw(st.integers(1, 5)))
