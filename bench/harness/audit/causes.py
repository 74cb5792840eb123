"""Why a cell is missed, and why a cell is a false alarm.

The method is run three times on a pair of images: as in the benchmark (R), with the exact ego-motion and calibration in
place of the recorded ones (M), and with the exact flow as well (E). What E does not find, the constraints cannot see;
what E finds and M does not, the flow has lost; what M finds and R does not, the ego-motion has. Each cell has one
cause, the first that applies, so that the shares add up to one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

Cells = NDArray[np.bool_]
Cause = TypeVar("Cause", bound=StrEnum)
BESIDE_PX = 15  # a flow window's width: as far as an object's motion bleeds into its surroundings


class MissCause(StrEnum):
    """Why a cell of a moving object is not found."""

    NEAR_EPIPOLE = "near_epipole"  # blind: no deviation is defined there
    ENTERED = "entered"  # blind: what it shows was outside of the previous image
    ABOVE_HORIZON = "above_horizon"  # blind: in the epipolar plane, and above the horizon no height constraint holds
    BELOW_THRESHOLD = "below_threshold"  # blind: in the epipolar plane, or too slow, where every constraint holds
    UNCOVERED = "uncovered"  # flow: what it shows was hidden in the previous image
    FLOW = "flow"  # flow: it was in view and the flow is wrong
    EGO_MOTION = "ego_motion"  # ego-motion or calibration


class FalseCause(StrEnum):
    """Why a cell of the static world is flagged."""

    ANTI_PARALLEL = "anti_parallel"  # the paper's own: a static point between the road and the camera's height
    OTHER_CONSTRAINT = "other_constraint"  # another constraint fires by the exact flow
    UNCOVERED = "uncovered"  # flow: what it shows was hidden in the previous image
    BESIDE_OBJECT = "beside_object"  # flow: an object's motion bleeds out
    FLOW = "flow"  # flow, elsewhere
    EGO_MOTION = "ego_motion"  # ego-motion or calibration


BLIND = (MissCause.NEAR_EPIPOLE, MissCause.ENTERED, MissCause.ABOVE_HORIZON, MissCause.BELOW_THRESHOLD)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evidence:
    """What the three runs say of each cell, all (rows, columns) bool.

    Attributes:
        by_exact_flow: E fires.
        by_exact_motion: M fires.
        seen: both images could see the cell's content, by the exact flow.
        defined: E's deviations are defined.
        below_horizon: both rays of the exact flow point below the horizon.
        anti_parallel: E's largest contribution is the anti-parallel one.
        visible: the previous image shows the same point.
        moving: the cell shows a moving object.
    """

    by_exact_flow: Cells
    by_exact_motion: Cells
    seen: Cells
    defined: Cells
    below_horizon: Cells
    anti_parallel: Cells
    visible: Cells
    moving: Cells


def miss_causes(evidence: Evidence) -> NDArray[np.int64]:
    """Index into `MissCause` of each cell, (rows, columns); it means something where R does not fire."""
    blind = ~evidence.by_exact_flow
    lost = ~evidence.by_exact_motion
    return _first(
        MissCause,
        {
            MissCause.ENTERED: blind & ~evidence.seen,
            MissCause.NEAR_EPIPOLE: blind & ~evidence.defined,
            MissCause.ABOVE_HORIZON: blind & ~evidence.below_horizon,
            MissCause.BELOW_THRESHOLD: blind,
            MissCause.UNCOVERED: lost & ~evidence.visible,
            MissCause.FLOW: lost,
        },
        otherwise=MissCause.EGO_MOTION,
    )


def false_causes(evidence: Evidence, *, cell_size_px: int) -> NDArray[np.int64]:
    """Index into `FalseCause` of each cell, (rows, columns); it means something where R fires on the static world."""
    reach = -(-BESIDE_PX // cell_size_px)
    beside = binary_dilation(evidence.moving, structure=np.ones((3, 3), dtype=bool), iterations=reach)
    return _first(
        FalseCause,
        {
            FalseCause.ANTI_PARALLEL: evidence.by_exact_flow & evidence.anti_parallel,
            FalseCause.OTHER_CONSTRAINT: evidence.by_exact_flow,
            FalseCause.UNCOVERED: evidence.by_exact_motion & ~evidence.visible,
            FalseCause.BESIDE_OBJECT: evidence.by_exact_motion & beside,
            FalseCause.FLOW: evidence.by_exact_motion,
        },
        otherwise=FalseCause.EGO_MOTION,
    )


def _first(kinds: type[Cause], where: Mapping[Cause, Cells], *, otherwise: Cause) -> NDArray[np.int64]:
    order = list(kinds)
    return np.select(list(where.values()), [order.index(kind) for kind in where], default=order.index(otherwise))
