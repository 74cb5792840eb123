"""Baselines that every table should carry: what the constraints must beat, and the ends of the scale.

None has a parameter that was tuned on data of ours; each file says where its threshold comes from.
"""

from bench.methods.baselines.background import BackgroundSubtraction
from bench.methods.baselines.ends import Everything, Nothing
from bench.methods.baselines.flow_angle import FlowMagnitude, RotationCompensatedFlow
from bench.methods.baselines.frame_difference import FrameDifference

__all__ = [
    "BackgroundSubtraction",
    "Everything",
    "FlowMagnitude",
    "FrameDifference",
    "Nothing",
    "RotationCompensatedFlow",
]
