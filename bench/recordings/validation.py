"""Validation of files by pydantic; each fault is one line: file, field, what was expected and what was found."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from reprlib import Repr
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from bench.errors import MOST_FAULTS, DataError, ShapeError
from bench.recordings.files import read_whole

LONGEST_VALUE = 80  # characters of a wrong value that a message shows
BRIEF = Repr()
BRIEF.maxstring = BRIEF.maxlong = BRIEF.maxother = LONGEST_VALUE
BRIEF.maxlist = BRIEF.maxtuple = BRIEF.maxdict = 10
BRIEF.maxlevel = 3


class FileModel(BaseModel):
    """A part of a file: unknown keys, NaN and infinity are refused."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


class ForeignModel(FileModel):
    """A part of a file of others: keys that are not used are passed over."""

    model_config = ConfigDict(extra="ignore")


Span = TypeVar("Span", tuple[int, int], tuple[int | None, int | None])
LATEST_NS = 2**62  # in the year 2116; room is left for sums
LARGEST_SIDE_PX = 16_384
LONGEST_NUMBER = 40  # characters
LARGEST_MEASURED = 1e8  # places on any map in metres, and speeds in m/s, are within


def in_order(span: Span) -> Span:
    """Refuse a first and last of which the first is later; None is open."""
    first, last = span
    if first is not None and last is not None and first > last:
        raise ValueError(f"first and last in order, not {first} before {last}")
    return span


def number_from_text(value: object) -> object:
    """The number that a data set writes as text; everything else as it is."""
    if isinstance(value, str) and len(value) <= LONGEST_NUMBER:
        for kind in (int, float):
            with suppress(ValueError):
                return kind(value)
    return value


TimeNs = Annotated[int, Field(ge=-LATEST_NS, le=LATEST_NS)]
SidePx = Annotated[int, Field(gt=0, le=LARGEST_SIDE_PX)]
Measured = Annotated[float, Field(ge=-LARGEST_MEASURED, le=LARGEST_MEASURED)]

Model = TypeVar("Model", bound=BaseModel)


def read_json(model: type[Model], file: Path) -> Model:
    """Read and validate a JSON file; numbers must be numbers and times whole.

    Raises:
        DataError: missing, not JSON, or not what the model asks for.
    """
    return parse_json(model, read_whole(file), file)


def parse_json(model: type[Model], content: bytes, file: Path) -> Model:
    """Validate the content of a JSON file, which may begin with a byte-order mark.

    Raises:
        DataError: not JSON, or not what the model asks for.
    """
    try:
        return model.model_validate_json(content.removeprefix(codecs.BOM_UTF8), strict=True)
    except ValidationError as error:
        raise _data_error(error, file) from None


def validated(model: type[Model], values: Mapping[str, Any], *, file: Path, field: str = "") -> Model:
    """Validate values that came from a file.

    Args:
        model: what they must be.
        values: the values.
        file: where they came from.
        field: path of the values in the file.

    Raises:
        DataError: they are not.
    """
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise _data_error(error, file, field) from None


@contextmanager
def located(file: Path, field: str) -> Iterator[None]:
    """Give a `ShapeError` of the block its place in a file; "focal: expected a, got b" is of `field.focal`.

    Raises:
        DataError: instead of the `ShapeError`.
    """
    try:
        yield
    except ShapeError as error:
        parts = re.fullmatch(r"(?:(\w+): )?.*?expected (.*?), got (.*)", str(error), re.DOTALL)
        if parts is None:
            raise DataError(file, field=field, expected="values that fit together", got=str(error)) from error
        name, expected, got = parts.groups()
        raise DataError(file, field=f"{field}.{name}" if name else field, expected=expected, got=got) from error


def _data_error(error: ValidationError, file: Path, prefix: str = "") -> DataError:
    """The first fault, which carries the others."""
    faults = error.errors(include_url=False, include_context=False)
    hint = f"{len(faults) - 1} more faults in this file" if len(faults) > 1 else ""
    first = _one_error(faults[0], file, prefix, hint)
    first.others = tuple(_one_error(fault, file, prefix) for fault in faults[1:MOST_FAULTS])
    return first


def _one_error(fault: ErrorDetails, file: Path, prefix: str, hint: str = "") -> DataError:
    path = ".".join(str(part) for part in (*([prefix] if prefix else []), *fault["loc"]))
    expected, got = _expected_and_got(fault["type"], fault["msg"], fault.get("input"))
    return DataError(file, field=path or None, expected=expected, got=got, hint=hint)


def _expected_and_got(kind: str, message: str, value: object) -> tuple[str, str]:
    if kind == "missing":
        return "a value", "nothing"
    if kind == "extra_forbidden":
        return "no such key", _short(value)
    if kind == "json_invalid":
        return "JSON", message.removeprefix("Invalid JSON: ")
    expected = message.removeprefix("Value error, ").removeprefix("Input should be ")
    return expected, _short(value)


def _short(value: object) -> str:
    text = BRIEF.repr(value)  # never the whole of a value that refers to itself a billion times
    return text if len(text) <= LONGEST_VALUE else text[: LONGEST_VALUE - 3] + "..."
