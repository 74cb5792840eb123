"""Joints: how the parts of a body turn about each other as the body goes along.

A joint holds its angles over one cycle as a table over the way. Parts stand in the build posture, in which every angle
is 0; a joint turns its parts, and all joints that hang on it, about an axis through its pivot.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

STEPS = 96  # of a cycle in a table; linear in between


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Joint:
    """A turn about an axis, driven by the way that the body has travelled.

    Attributes:
        name: parts and joints hang on it by this name.
        pivot_m: (3,) a place on the axis, object frame, build posture.
        cycle_m: way of one full cycle.
        angles_rad: (STEPS + 1,) over one cycle, right-handed about the axis; the last may be whole turns off the first.
        axis: (3,) unit vector, build posture.
        parent: the joint that this one hangs on; None for the body's own frame.
        shifts_m: (STEPS + 1, 3) or None: how the joint moves in its parent's axes, over the same cycle.
        standing_rad: its angle when the body does not go; None where that makes no difference, as for wheels.
        standing_shift_m: (3,) its shift then.
    """

    name: str
    pivot_m: tuple[float, float, float]
    cycle_m: float
    angles_rad: NDArray[np.float64]
    axis: tuple[float, float, float] = (0.0, 1.0, 0.0)
    parent: str | None = None
    shifts_m: NDArray[np.float64] | None = None
    standing_rad: float | None = None
    standing_shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


def wheel(name: str, x_m: float, radius_m: float, *, parent: str | None = None) -> Joint:
    """A wheel on the road: it turns once while the body goes its circumference."""
    turn = np.linspace(0, 2 * np.pi, STEPS + 1)
    return Joint(name=name, pivot_m=(x_m, 0.0, radius_m), cycle_m=2 * np.pi * radius_m, angles_rad=turn, parent=parent)


def still(value: float = 0.0) -> NDArray[np.float64]:
    """The table of an angle that does not change."""
    return np.full(STEPS + 1, value)


class Linkage:
    """All joints of a body, stacked for speed.

    Args:
        joints: parents before their children.
    """

    def __init__(self, joints: Sequence[Joint]) -> None:
        names = [joint.name for joint in joints]
        self.joints = tuple(joints)
        self.parents = tuple(-1 if joint.parent is None else names.index(joint.parent) for joint in joints)
        assert all(parent < row for row, parent in enumerate(self.parents))
        self._pivots_m = np.array([joint.pivot_m for joint in joints], dtype=np.float64).reshape(-1, 3)
        self._cycles_m = np.array([joint.cycle_m for joint in joints])
        self._crosses = _cross_matrices(np.array([joint.axis for joint in joints], dtype=np.float64).reshape(-1, 3))
        self._tables = np.array([_table(joint) for joint in joints]).reshape(-1, STEPS + 1, 4)
        self._standing = np.array([_standing(joint) for joint in joints]).reshape(-1, 4)

    def moved(self, shift_m: NDArray[np.float64]) -> Linkage:
        """The same linkage in a frame whose origin lies elsewhere: pivots move by `shift_m`."""
        moved = copy(self)
        moved._pivots_m = self._pivots_m + shift_m
        moved.joints = tuple(
            replace(joint, pivot_m=(float(x), float(y), float(z)))
            for joint, (x, y, z) in zip(self.joints, moved._pivots_m, strict=True)
        )
        return moved

    def transforms(
        self, ways_m: float | NDArray[np.float64], going: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Posed from build posture.

        Args:
            ways_m: travelled so far: one way, or (W,).
            going: 1 in full motion, 0 standing.

        Returns:
            rotations: (J, 3, 3), or (W, J, 3, 3).
            translations_m: (J, 3), or (W, J, 3): a point of joint j goes to `rotations[j] @ point + translations_m[j]`.
        """
        place = np.asarray(ways_m)[..., None] / self._cycles_m
        place = (place - np.floor(place)) * STEPS
        step = np.minimum(place.astype(np.intp), STEPS - 1)
        rows = np.arange(len(self._cycles_m))
        low, high = self._tables[rows, step], self._tables[rows, step + 1]
        values = low + (place - step)[..., None] * (high - low)
        values = np.where(np.isnan(self._standing), values, self._standing + going * (values - self._standing))
        rotations = self._turns(values[..., 0])
        places_m = self._pivots_m + values[..., 1:]
        for row, parent in enumerate(self.parents):
            if parent >= 0:
                arms_m = places_m[..., row, :] - self._pivots_m[parent]
                turned_m = (rotations[..., parent, :, :] @ arms_m[..., None])[..., 0]
                places_m[..., row, :] = places_m[..., parent, :] + turned_m
                rotations[..., row, :, :] = rotations[..., parent, :, :] @ rotations[..., row, :, :]
        return rotations, places_m - (rotations @ self._pivots_m[..., None])[..., 0]

    def _turns(self, angles_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rodrigues' formula for (..., J) angles about the axes: (..., J, 3, 3)."""
        sine, cosine = np.sin(angles_rad)[..., None, None], np.cos(angles_rad)[..., None, None]
        return np.asarray(np.eye(3) + sine * self._crosses + (1 - cosine) * (self._crosses @ self._crosses))


def _table(joint: Joint) -> NDArray[np.float64]:
    shifts = np.zeros((STEPS + 1, 3)) if joint.shifts_m is None else joint.shifts_m
    return np.column_stack([joint.angles_rad, shifts])


def _standing(joint: Joint) -> NDArray[np.float64]:
    if joint.standing_rad is None:
        return np.full(4, np.nan)
    return np.array([joint.standing_rad, *joint.standing_shift_m])


def _cross_matrices(axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(J, 3, 3): the vector product with each of (J, 3) axes."""
    x, y, z = axes.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
