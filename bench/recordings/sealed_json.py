"""JSON files of results that hold a digest of their own content: one that was damaged or edited is not read.

The digest is the SHA-256 of the rest of the content as canonical JSON (sorted keys, no spaces), under the key `sha256`.
Files of older versions hold none and are read as they are.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel

from bench.atomic import write_text
from bench.errors import DataError
from bench.recordings.validation import parse_json

SEAL = "sha256"

Model = TypeVar("Model", bound=BaseModel)


def _indented(content: dict[str, Any]) -> str:
    return json.dumps(content, indent=1, ensure_ascii=False)


def write_sealed(
    file: Path,
    content: BaseModel,
    *,
    exclude_defaults: bool = False,
    layout: Callable[[dict[str, Any]], str] = _indented,
) -> None:
    """Write a record with its digest; NaN becomes what the record's fields say.

    Args:
        file: to write.
        content: the record.
        exclude_defaults: leave out what has its default.
        layout: from the content to the text of the file.

    Raises:
        OutputError: it cannot be written.
    """
    plain = json.loads(content.model_dump_json(exclude_defaults=exclude_defaults))
    write_text(file, layout(plain | {SEAL: _digest(plain)}) + "\n")


def read_sealed(model: type[Model], file: Path, *, expected: str, strict: bool = False) -> Model:
    """Read a record.

    Args:
        model: of the record.
        file: that holds it.
        expected: what the file is, for messages.
        strict: whether numbers must be numbers.

    Raises:
        DataError: missing, not JSON, changed since it was written, or not what the model asks for; names the field.
    """
    try:
        content = json.loads(file.read_bytes())
    except OSError as error:
        raise DataError(file, expected=expected, got=error.strerror or str(error)) from error
    except (ValueError, RecursionError) as error:
        got = f"no JSON ({' '.join(str(error).split())})"
        raise DataError(file, expected=expected, got=got, do="make it again") from error
    if isinstance(content, dict) and SEAL in content:
        seal = content.pop(SEAL)
        if seal != _digest(content):
            got = "other content than was written: the file is damaged, or was edited"
            raise DataError(file, expected=expected, got=got, do="make it again")
    return parse_json(model, json.dumps(content).encode(), file, strict=strict)


def _digest(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
