"""Bags of ROS 2, MCAP and SQLite, as recordings; see `adapter`."""

from bench.adapters.rosbag.adapter import rosbag_recordings

__all__ = ["rosbag_recordings"]
