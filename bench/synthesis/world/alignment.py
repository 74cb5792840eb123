"""The way of a lane over the ground, and places beside it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench.geometry import RigidTransform

STEP_M = 5.0  # length of the straight pieces that make a street
BEND_STEP_M = 1.0  # and of those that make it where it bends


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alignment:
    """A lane: straight up to its origin, then an arc, then straight again.

    Attributes:
        curvature_per_m: 1 / radius of the arc, positive to the left.
        bend_m: length of the arc.
        world_from_start: the lane's origin in the world, x along the lane.
        begin_m: where what is built begins, along the lane.
        end_m: where it ends.
    """

    curvature_per_m: float = 0.0
    bend_m: float = 0.0
    world_from_start: RigidTransform
    begin_m: float
    end_m: float

    def place(self, along_m: float, left_m: float, height_m: float = 0.0, *, turned_rad: float = 0.0) -> RigidTransform:
        """World from a frame beside the lane, x along the lane but for a turn."""
        x, y = self.points(along_m, left_m)[0]
        forward = self.world_from_start.rotation[:, 0]
        yaw = np.arctan2(forward[1], forward[0]) + self._turns(np.array([along_m]))[0] + turned_rad
        return RigidTransform.from_yaw(float(yaw), [float(x), float(y), height_m])

    def points(self, along_m: ArrayLike, left_m: ArrayLike) -> NDArray[np.float64]:
        """(N, 2) float64, m, world, of N ways along the lane and offsets to its left (or one for all)."""
        along, left = np.atleast_1d(along_m).astype(np.float64), np.asarray(left_m, dtype=np.float64)
        x, y = self._bent(along, left) if self.curvature_per_m else (along, left)
        ahead = np.empty((max(x.size, y.size), 2))
        ahead[:, 0], ahead[:, 1] = x, y
        start = self.world_from_start
        return np.asarray(ahead @ start.rotation[:2, :2].T + start.translation_m[:2])

    def _bent(
        self, along_m: NDArray[np.float64], left_m: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """x and y in the frame of the lane's origin."""
        turns = self._turns(along_m)
        arcs = np.clip(along_m, 0.0, self.bend_m)
        chords = arcs * np.sinc(turns / (2 * np.pi))
        beyond = along_m - arcs
        x = chords * np.cos(turns / 2) + beyond * np.cos(turns) - left_m * np.sin(turns)
        y = chords * np.sin(turns / 2) + beyond * np.sin(turns) + left_m * np.cos(turns)
        return x, y

    def cells(self, start_m: float, end_m: float, right_m: float, left_m: float) -> NDArray[np.float64]:
        """(N, 4, 2) float64, m, world: a band along the lane, cut into straight pieces that share their ends."""
        cuts = self.cuts(start_m, end_m)
        return self.pieces(cuts[:-1], cuts[1:], right_m, left_m)

    def pieces(
        self, starts_m: NDArray[np.float64], ends_m: NDArray[np.float64], right_m: float, left_m: float
    ) -> NDArray[np.float64]:
        """(N, 4, 2) float64, m, world: short stretches of a band along the lane."""
        corners = ((starts_m, right_m), (ends_m, right_m), (ends_m, left_m), (starts_m, left_m))
        return np.stack([self.points(along, left) for along, left in corners], axis=1)

    def cuts(self, start_m: float, end_m: float) -> NDArray[np.float64]:
        """Where a stretch is cut into straight pieces, ends included."""
        bounds = np.unique(np.clip([start_m, 0.0, self.bend_m, end_m], start_m, end_m))
        cuts = [np.array([start_m])]
        for a, b in pairwise(bounds):
            step_m = BEND_STEP_M if 0.0 <= a < self.bend_m else STEP_M
            cuts.append(np.linspace(a, b, max(1, int(np.ceil((b - a) / step_m))) + 1)[1:])
        return np.concatenate(cuts)

    def patches(self, centres_m: ArrayLike, corners_m: ArrayLike) -> NDArray[np.float64]:
        """Small flat shapes beside the lane.

        Args:
            centres_m: (N, 2), m, along the lane and to its left.
            corners_m: (N, K, 2), m, about each centre, x along the lane.

        Returns:
            (N, K, 2) float64, m, world.
        """
        centres = np.asarray(centres_m, dtype=np.float64).reshape(-1, 2)
        corners = np.asarray(corners_m, dtype=np.float64)
        forward = self.world_from_start.rotation[:, 0]
        yaws = np.arctan2(forward[1], forward[0]) + self._turns(centres[:, 0])
        cosine, sine = np.cos(yaws)[:, None], np.sin(yaws)[:, None]
        x, y = corners[..., 0], corners[..., 1]
        turned = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)
        return np.asarray(turned + self.points(centres[:, 0], centres[:, 1])[:, None])

    def _turns(self, along_m: NDArray[np.float64]) -> NDArray[np.float64]:
        if not self.curvature_per_m:
            return np.zeros_like(along_m)
        return self.curvature_per_m * np.clip(along_m, 0.0, self.bend_m)
