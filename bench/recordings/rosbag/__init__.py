"""Bags of ROS 2, MCAP and SQLite, as recordings; see `adapter`."""

from bench.recordings.rosbag.adapter import rosbag_recordings

__all__ = ["rosbag_recordings"]
