"""The name of before of `bench.harness.manifest.MethodOfRun`."""

from bench.harness.manifest import MethodOfRun

__all__ = ["MethodOfRun"]
