"""Digests of values, of a recording's content, and of the code that makes results."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PurePath
from types import BuiltinFunctionType, FunctionType, MappingProxyType
from typing import Any

import numpy as np
from pydantic import BaseModel
from scipy.spatial.transform import Rotation

import bench
from bench.atomic import open_regular
from bench.errors import DataError
from bench.records.recording import Recording, StoredPart

PACKAGE = Path(bench.__file__).parent
SHORT_DIGEST_CHARS = 12
METRIC_LIBRARIES = ("numpy", "scipy", "numba", "opencv-python-headless", "shapely", "pandas", "pyarrow")
OPTIONAL_LIBRARIES = (
    *("kornia-rs", "laspy", "lazrs", "open3d", "open3d-cpu", "rosbags", "mcap", "lz4", "backports.zstd"),
    "onnxruntime",
)

_READING = ("errors.py", "geometry.py", "cameras", "lidar", "egomotion", "records", "recordings", "adapters")
REFERENCE_CODE = (*_READING, "reference", "harness/references.py")
ANSWER_CODE = (*_READING, "flow", "methods", "harness/frames.py", "harness/answers.py", "harness/exact.py")
_COUNTING = ("counts", "protocol", "rows", "scorer")  # other modules of `evaluation` reduce
COUNT_CODE = (
    *REFERENCE_CODE,
    *(f"evaluation/{name}.py" for name in _COUNTING),
    "harness/counts.py",
    "harness/exact.py",
)


def short_digest(digest: str) -> str:
    """A digest or a commit as people are shown it; the "+" of a commit with changed files stays."""
    return digest.rstrip("+")[:SHORT_DIGEST_CHARS] + ("+" if digest.endswith("+") else "")


def digest_of(*values: object) -> str:
    """SHA-256, hexadecimal, over values of any depth.

    Arrays count with dtype, shape and every byte; data classes and models with their type and fields; functions with
    their name.

    Args:
        values: numbers, text, bytes, paths, None, enumerations, arrays, rotations, data classes, pydantic models,
            functions, partial functions, and lists, tuples and mappings of them.

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
        case None | bool() | int() | float() | np.generic():
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
        case FunctionType() | BuiltinFunctionType() | type():
            yield f"{value.__module__}:{value.__qualname__}".encode()
        case partial():
            yield from _parts((value.func, value.args, value.keywords))
        case BaseModel():
            names = type(value).model_fields  # and nothing that was worked out from them and kept beside them
            yield from _parts({name: getattr(value, name) for name in names} | (value.model_extra or {}))
        case Mapping():
            yield from _parts(sorted((digest_of(key), digest_of(item)) for key, item in value.items()))
        case tuple() | list():
            yield str(len(value)).encode()
            for item in value:
                yield from _parts(item)
        case _ if is_dataclass(value):
            for field in fields(value):
                if field.init:  # others were worked out from these
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


def digest_recording(recording: Recording) -> str:
    """Digest of a recording's content, every file of which is read once; none of its name, nor of where it lies.

    Calibration and annotations count as they were read.
    """
    images = [image for name in sorted(recording.images) for image in recording.images[name]]
    reference = digest_of(
        digest_ego_motion(recording),
        {name: digest_of(camera) for name, camera in recording.cameras.items()},
        recording.annotated,
        [(columns_of([replace(track, states=())]), columns_of(track.states)) for track in recording.tracks],
        digest_sweeps(recording),
        [None if image.moving_path is None else digest_file(image.moving_path) for image in images],
    )
    return digest_of(
        reference,
        recording.frame_interval_ns,
        [(image.camera, image.timestamp_ns, image.scored, digest_file(image.path, image.stored)) for image in images],
        [None if image.truth_path is None else digest_file(image.truth_path) for image in images],
    )


def digest_ego_motion(recording: Recording) -> str:
    """Digest of the trajectory, as it is interpolated."""
    way = recording.trajectory
    return digest_of(way.timestamps_ns, way.rotations, way.positions_m, way.max_gap_ns, way.max_extrapolation_ns)


def digest_sweeps(recording: Recording) -> str:
    """Digest of the lidar's mounting and of every sweep's content."""
    sweeps = [
        (sweep.timestamp_ns, None if sweep.stored else sweep.reader, digest_file(sweep.path, sweep.stored))
        for sweep in recording.sweeps
    ]
    return digest_of(recording.vehicle_from_lidar, recording.lidar_from_sensor, sweeps)


def digest_file(path: Path, stored: StoredPart | None = None) -> str:
    """SHA-256 of a file's content, hexadecimal, or the reason why it cannot be read.

    Args:
        path: of the file, or the name of a part of one.
        stored: the part that goes by that name, whose content then counts.
    """
    try:
        if stored is not None:
            return hashlib.sha256(stored.content()).hexdigest()
        with open_regular(path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except DataError as error:
        return f"unreadable: {error}"
    except OSError as error:
        return f"unreadable: {error.strerror}"


@cache
def library_versions() -> Mapping[str, str]:
    """Versions of the interpreter and of the libraries that decide metrics, or decode what is read."""
    found = {"Python": "{}.{}".format(*sys.version_info[:2])}
    found |= {name: version(name) for name in METRIC_LIBRARIES}
    for name in OPTIONAL_LIBRARIES:  # which of them there are depends on the platform and the interpreter
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return MappingProxyType(found)


@cache
def code_digest(sources: tuple[str, ...]) -> str:
    """Digest of source files of this package.

    Args:
        sources: packages or files below `bench/`.
    """
    places = [PACKAGE / source for source in sources]
    files = [file for place in places for file in (place.rglob("*") if place.is_dir() else [place])]
    names = {file.relative_to(PACKAGE).as_posix(): file for file in files if file.suffix in (".py", ".yaml")}
    return digest_of({name: hashlib.sha256(file.read_bytes()).hexdigest() for name, file in names.items()})
