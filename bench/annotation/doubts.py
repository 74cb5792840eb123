"""Doubts that follow from a track as it stands, whoever made it: a reviewer can mend them, and they are gone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.annotation.settings import ProposalSettings
from bench.annotation.store import Doubt
from bench.records.reference import ObjectClass

HOLE = 1.5  # usual steps between two states, from which on one is missing
LONGEST_M, WIDEST_M = ProposalSettings().longest_m, ProposalSettings().widest_m
USUAL_M: dict[ObjectClass, tuple[tuple[float, float], ...]] = {  # least and most length, width and height of a box
    "pedestrian": ((0.2, 2.4), (0.2, 1.3), (0.6, 2.2)),  # children, and who carries or pushes something
    "cyclist": ((1.1, 3.2), (0.3, 1.3), (0.9, 2.3)),  # with a trailer or a load
    "vehicle": ((1.2, LONGEST_M), (0.5, WIDEST_M), (0.8, 4.2)),  # from motorcycles and small cars to buses with a joint
    "animal": ((0.2, 3.0), (0.1, 1.3), (0.1, 2.2)),  # cats to horses
}
EXPLAINED = {  # reasons of `propose`, as the review page explains them
    "few returns": "Returns in most sweeps. Its box and class rest on little; look in the image what it is.",
    "short": "Seconds that it moves. Look whether something moved at all, or was hidden before.",
    "at the edge of the range": "Metres from the lidar, where returns are few. What rests may pass for a slow mover.",
    "fragments joined": "Tracks that were put together, as mirrors and wheels. Look whether the box holds one object.",
    "seen from one end": "Length of the box, m. Only one end was seen, so the vehicle may be longer.",
    "longer than a rigid vehicle": "Length, m. A bus or lorry with a joint, or two vehicles close together.",
    "at the range of a larger one": "Share of its sweeps at a larger one's range. Maybe a ghost beside a reflector.",
    "top not seen": "Height that was seen, m. The lidar's highest beam cuts it; the box goes on to a likely height.",
    "seen through by few": "Share of its returns where other sweeps see through. Few: at rest, or long and slow.",
}
SIDES = (("short", "long"), ("narrow", "wide"), ("low", "high"))


def size_doubts(object_class: ObjectClass, size_m: NDArray[np.float64]) -> tuple[Doubt, ...]:
    """A doubt for each side of a box that objects of its class do not have.

    Args:
        object_class: of the object.
        size_m: (3,) float64, length, width and height.
    """
    return tuple(
        Doubt(reason=f"{value:.1f} m is {words[int(value > most)]} for {_a(object_class)}", value=value)
        for value, (least, most), words in zip(size_m.tolist(), USUAL_M[object_class], SIDES, strict=True)
        if not least <= value <= most
    )


def hole_doubts(times_ns: NDArray[np.int64], step_ns: int) -> tuple[Doubt, ...]:
    """A doubt where a track has no box in sweeps between its first and its last.

    Args:
        times_ns: (N,) int64, of its states, increasing.
        step_ns: usual time between two.
    """
    missing = [round((end - start) / step_ns) - 1 for start, end in holes(times_ns, step_ns)]
    if not missing:
        return ()
    count = max(sum(missing), 1)
    what = "hole" if len(missing) == 1 else f"{len(missing)} holes"
    return (Doubt(reason=f"{what} of {count} sweep{'s' if count > 1 else ''}", value=count),)


def holes(times_ns: NDArray[np.int64], step_ns: int) -> list[tuple[int, int]]:
    """The last time before each hole and the first time after it."""
    rows = np.flatnonzero(np.diff(times_ns) > HOLE * step_ns)
    return [(int(times_ns[row]), int(times_ns[row + 1])) for row in rows]


def _a(name: str) -> str:
    return f"an {name}" if name[0] in "aeiou" else f"a {name}"
