"""Digests of the code that makes results."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable

import bench
from bench.harness.keys.values import digest_of
from bench.harness.provenance import library_versions

REFERENCE_ROOMS = ("errors.py", "geometry", "cameras", "lidar", "egomotion", "recordings", "reference")
REFERENCE_CODE = (*REFERENCE_ROOMS, "harness/cache/reference_arrays.py")  # and how a kept one is stored
METHOD_ROOMS = ("errors.py", "geometry", "flow", "cameras", "egomotion", "methods")
SCORING_ROOMS = (*sorted({*REFERENCE_ROOMS, *METHOD_ROOMS}), "evaluation")
UNIT_FILES = ("frames", "unit", "units", "reference_itself", "map_files")
UNIT_CODE = (*SCORING_ROOMS, *(f"harness/{name}.py" for name in UNIT_FILES))


@cache
def code_digest(places: tuple[str, ...]) -> str:
    """Digest of source files of this package, of its version, and of the libraries that decide figures.

    Args:
        places: packages or files below `bench/`.
    """
    return digest_of(bench.__version__, sys.version_info[:2], library_versions(), source_digest(places))


@cache
def source_digest(places: tuple[str, ...]) -> str:
    """Digest of source files of this package; see `code_digest`."""
    digest = hashlib.sha256()
    for place in places:
        for file in _sources(resources.files("bench").joinpath(place)):
            digest.update(file.name.encode() + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def _sources(place: Traversable) -> Iterable[Traversable]:
    if place.is_file():
        return [place]
    found: list[Traversable] = []
    for entry in sorted(place.iterdir(), key=lambda entry: entry.name):
        if entry.is_dir():
            found += _sources(entry)
        elif entry.name.endswith((".py", ".yaml")):
            found.append(entry)
    return found
