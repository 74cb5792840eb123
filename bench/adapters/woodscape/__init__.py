"""WoodScape as recordings; see `adapter`."""

from bench.adapters.woodscape.adapter import woodscape_recordings

__all__ = ["woodscape_recordings"]
