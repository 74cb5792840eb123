"""Digests of values, of files, and of the code that makes results."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache, partial
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path, PurePath
from types import BuiltinFunctionType, FunctionType
from typing import Any

import numpy as np
from pydantic import BaseModel
from scipy.spatial.transform import Rotation
from shapely.geometry.base import BaseGeometry

import bench
from bench.atomic import open_regular
from bench.errors import DataError
from bench.harness.provenance import library_versions
from bench.records.recording import StoredPart

SHORT_DIGEST_CHARS = 12


def short_digest(digest: str) -> str:
    """A digest or a commit as people are shown it; the "+" of a commit with changed files stays."""
    return digest.rstrip("+")[:SHORT_DIGEST_CHARS] + ("+" if digest.endswith("+") else "")


def digest_of(*values: object) -> str:
    """SHA-256, hexadecimal, over values of any depth.

    Arrays count with dtype, shape and every byte; data classes and models with their type and fields; functions with
    their name.

    Args:
        values: numbers, text, bytes, paths, None, enumerations, arrays, rotations, geometries, data classes, pydantic
            models, functions, partial functions, and sequences, sets and mappings of them.

    Raises:
        TypeError: anything else, since nothing may pass unseen.
    """
    digest = hashlib.sha256()
    for part in _parts(values):
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()


def _parts(value: Any) -> Iterator[bytes]:
    """The value as bytes that no other value has."""
    yield type(value).__name__.encode()
    match value:
        case None | bool() | int() | float() | complex() | np.generic():
            yield repr(value).encode()
        case Enum():
            yield f"{type(value).__qualname__}.{value.name}".encode()
        case str():
            yield value.encode()
        case bytes():
            yield value
        case PurePath():
            yield str(value).encode()
        case np.ndarray():
            yield f"{value.dtype.str} {value.shape}".encode()
            yield np.ascontiguousarray(value).tobytes()
        case Rotation():
            yield from _parts(value.as_quat())
        case BaseGeometry():
            yield value.wkb
        case FunctionType() | BuiltinFunctionType() | type():
            yield f"{value.__module__}:{value.__qualname__}".encode()
        case partial():
            yield from _parts((value.func, value.args, value.keywords))
        case BaseModel():
            names = type(value).model_fields  # and nothing that was worked out from them and kept beside them
            yield from _parts({name: getattr(value, name) for name in names} | (value.model_extra or {}))
        case Mapping():
            yield from _parts(sorted((digest_of(key), digest_of(item)) for key, item in value.items()))
        case Set():
            yield from _parts(sorted(digest_of(item) for item in value))
        case tuple() | list():
            yield str(len(value)).encode()
            for item in value:
                yield from _parts(item)
        case _ if is_dataclass(value):
            for field in fields(value):
                yield field.name.encode()
                yield from _parts(getattr(value, field.name))
        case _:
            raise TypeError(f"expected a value that a digest can be taken of, got {type(value)!r}")


def columns_of(values: Sequence[Any]) -> Any:
    """Values of one kind with the same content in few pieces, of which a digest is taken in a hundredth of the time.

    Args:
        values: data classes become a mapping of field to column, arrays of one shape and numbers of one type an array.
    """
    kinds = {type(value) for value in values}
    kind = kinds.pop() if len(kinds) == 1 else None
    if kind is not None and is_dataclass(kind):
        named = {field.name: columns_of([getattr(value, field.name) for value in values]) for field in fields(kind)}
        return kind, named
    if kind in (bool, float):
        return np.array(values, dtype=kind)
    if kind is int and max(map(abs, values)) < 1 << 63:
        return np.array(values, dtype=np.int64)
    if kind is np.ndarray and len({(value.dtype, value.shape) for value in values}) == 1:
        return np.stack(values)
    return tuple(values)


MISSING, UNREADABLE = "missing", "unreadable"


class FileDigests:
    """SHA-256 of files' contents, each read once for as long as this object lives, which is one unit of work.

    Neither size nor time of change stands for the content: clocks go back, and files are replaced by others as long.
    """

    def __init__(self) -> None:
        self._known: dict[Path, str] = {}

    def of(self, path: Path, stored: StoredPart | None = None) -> str:
        """The digest, hexadecimal; `MISSING` or the reason where the file cannot be read.

        Args:
            path: of the file, or the name of a part of one.
            stored: the part that goes by that name, whose content then counts.
        """
        if path not in self._known:
            self._known[path] = _digest(path) if stored is None else _part_digest(stored)
        return self._known[path]


def _part_digest(stored: StoredPart) -> str:
    try:
        return hashlib.sha256(stored.content()).hexdigest()
    except DataError as error:
        return f"{UNREADABLE}: {error}"


def _digest(path: Path) -> str:
    try:
        with open_regular(path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except FileNotFoundError:
        return MISSING
    except OSError as error:
        return f"{UNREADABLE}: {error.strerror}"


_READING = ("records", "recordings", "adapters")
REFERENCE_PACKAGES = ("errors.py", "geometry", "cameras", "lidar", "egomotion", *_READING, "reference")
REFERENCE_CODE = (*REFERENCE_PACKAGES, "harness/cache/steps.py", "harness/reference_files.py")  # and how it is cached
_TOLD = ("records", "recordings/input_errors.py")  # what a method is given, and the errors injected into it
METHOD_PACKAGES = ("errors.py", "geometry", "flow", "cameras", "egomotion", *_TOLD, "methods")
_GIVEN = tuple(sorted({*REFERENCE_PACKAGES, *METHOD_PACKAGES}))
SCORING_PACKAGES = (*_GIVEN, "evaluation")
COUNTING = ("counts", "image_map", "likelihood", "protocol", "rows", "scorer")  # other modules of `evaluation` reduce
UNIT_FILES = ("frames", "masks", "unit", "oracles", "reference_files", "unit_files", "wrong_masks")
_COUNTED_BY = (*(f"evaluation/{name}.py" for name in COUNTING), *(f"harness/{name}.py" for name in UNIT_FILES))
UNIT_CODE = (*_GIVEN, *_COUNTED_BY)
METRIC_CODE = (*UNIT_CODE, "evaluation")  # units, and their reduction to metrics


@cache
def code_digest(sources: tuple[str, ...]) -> str:
    """Digest of what `code_parts` lists.

    Args:
        sources: packages or files below `bench/`.
    """
    return digest_of(code_parts(sources))


def code_parts(sources: tuple[str, ...]) -> dict[str, str]:
    """Digests of source files of this package, its version, and those of the libraries that decide metrics, by name.

    Args:
        sources: packages or files below `bench/`.
    """
    python = "{}.{}".format(*sys.version_info[:2])
    return {"fisheye-bench": bench.__version__, "Python": python, **library_versions(), **source_digests(sources)}


@cache
def source_digests(sources: tuple[str, ...]) -> dict[str, str]:
    """SHA-256 of source files of this package by their name, as "bench/geometry/rigid.py"; see `code_parts`."""
    package = resources.files("bench")
    files = (found for source in sources for found in _sources(package.joinpath(source), f"bench/{source}"))
    return {name: hashlib.sha256(file.read_bytes()).hexdigest() for name, file in files}


def _sources(source: Traversable, name: str) -> Iterator[tuple[str, Traversable]]:
    if source.is_file():
        yield name, source
        return
    for entry in sorted(source.iterdir(), key=lambda entry: entry.name):
        if entry.is_dir() or entry.name.endswith((".py", ".yaml")):
            yield from _sources(entry, f"{name}/{entry.name}")
