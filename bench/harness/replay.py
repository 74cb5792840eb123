"""The name of before of `bench.harness.datasets.StoredFrames`."""

from bench.harness.datasets import StoredFrames

__all__ = ["StoredFrames"]
