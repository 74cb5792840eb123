"""Ego-motion: from the vehicle's bus or a pose file to `world_from_vehicle` at any time; or from images, without scale.

A `Trajectory` is a row of poses. Between them the vehicle moves with constant twist; across gaps and beyond the
ends nothing is invented: `valid` says so.
"""

from bench.egomotion.bus_faults import bus_signal_faults
from bench.egomotion.camera_motion import camera_motion
from bench.egomotion.odometry import BusSignals, planar_trajectory, read_bus_signals
from bench.egomotion.trajectory import POSES_AHEAD, Trajectory
from bench.egomotion.tum import read_tum, write_tum
from bench.egomotion.visual import VisualMotion, VisualOdometry

__all__ = [
    "POSES_AHEAD",
    "BusSignals",
    "Trajectory",
    "VisualMotion",
    "VisualOdometry",
    "bus_signal_faults",
    "camera_motion",
    "planar_trajectory",
    "read_bus_signals",
    "read_tum",
    "write_tum",
]
