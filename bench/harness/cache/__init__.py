"""Steps of a run, cached for the next one: flow, likelihood, reference.

Each is a file of arrays named by a digest of all that it depends on, so it is up to date or not found. The folder may
be deleted at any time, and processes may share it.
"""

from bench.harness.cache.folder import DEFAULT_LIMIT_BYTES, CacheFolder, CacheUse, default_folder
from bench.harness.cache.steps import StepCache

__all__ = ["DEFAULT_LIMIT_BYTES", "CacheFolder", "CacheUse", "StepCache", "default_folder"]
