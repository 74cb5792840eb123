"""Digest of values: the same for equal values in every process, another one for any change."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Set
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import partial
from pathlib import PurePath
from types import BuiltinFunctionType, FunctionType
from typing import Any

import numpy as np
from pydantic import BaseModel
from scipy.spatial.transform import Rotation
from shapely.geometry.base import BaseGeometry


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
