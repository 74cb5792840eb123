"""Ego-motion: from the vehicle's bus or a pose file to `world_from_vehicle` at any time; or from images, without scale.

A `Trajectory` is a sequence of poses. Between them the vehicle moves with constant twist; across gaps and beyond the
ends no pose is valid.
"""

from bench.egomotion.files import read_bus_signals, read_tum, write_tum
from bench.egomotion.trajectory import Trajectory, camera_motion, planar_trajectory
from bench.egomotion.visual import VisualOdometry

__all__ = [
    "Trajectory",
    "VisualOdometry",
    "camera_motion",
    "planar_trajectory",
    "read_bus_signals",
    "read_tum",
    "write_tum",
]
