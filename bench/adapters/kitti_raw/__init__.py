"""KITTI's raw drives; see `adapter`."""

from bench.adapters.kitti_raw.adapter import kitti_raw_recordings

__all__ = ["kitti_raw_recordings"]
