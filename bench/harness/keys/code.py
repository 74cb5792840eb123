"""Digests of the code that makes results."""

from __future__ import annotations

import hashlib
import inspect
import sys
from collections.abc import Iterable
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

import bench
from bench.harness.keys.files import FileDigests
from bench.harness.keys.values import digest_of
from bench.harness.provenance import library_versions
from bench.methods import Method

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
        places: rooms or files below `bench/`.
    """
    digest = hashlib.sha256(digest_of(bench.__version__, sys.version_info[:2], library_versions()).encode())
    for place in places:
        for file in _sources(resources.files("bench").joinpath(place)):
            digest.update(file.name.encode() + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def method_digest(method: Method) -> str:
    """Digest of what a method is beside its settings: the code of this package, or of its own, and files that it reads.

    A method from elsewhere counts with the source files beside its own, for as far as they lie in the same folder. A
    method that reads files, for example weights, lists their paths in an attribute `files`; their content counts.
    """
    digests, read = FileDigests(), tuple(Path(file) for file in getattr(method, "files", ()))
    return digest_of(source_digest(type(method)), [(file.name, digests.of(file)) for file in read])


def source_digest(kind: type) -> str:
    """Digest of a method's class and, where it is not of this package, of its source files."""
    files: Iterable[Path] = ()
    if kind.__module__.partition(".")[0] != "bench":
        try:
            source = Path(inspect.getfile(kind))
        except (OSError, TypeError):  # typed at a prompt
            source = Path()
        files = [source] if not (source.parent / "__init__.py").exists() else sorted(source.parent.rglob("*.py"))
    digests = FileDigests()
    return digest_of(kind, [(file.name, digests.of(file)) for file in files])


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
