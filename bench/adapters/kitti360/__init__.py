"""KITTI-360 as recordings; see `adapter`."""

from bench.adapters.kitti360.adapter import kitti360_recordings

__all__ = ["kitti360_recordings"]
