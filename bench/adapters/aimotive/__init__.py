"""The aiMotive multimodal data set as recordings; see `adapter`."""

from bench.adapters.aimotive.adapter import aimotive_recordings

__all__ = ["aimotive_recordings"]
