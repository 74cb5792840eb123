"""JSON files of results that hold a digest of their own content: one that was damaged or edited is not read.

The digest is the SHA-256 of the rest of the content as canonical JSON (sorted keys, no spaces), under the key `sha256`.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel

from bench.atomic import read_regular, write_text
from bench.errors import DataError
from bench.recordings.validation import parse_json

DIGEST = "sha256"

Model = TypeVar("Model", bound=BaseModel)


def write_checked(file: Path, content: BaseModel) -> None:
    """Write a record with its digest; NaN becomes what the record's fields say.

    Args:
        file: to write.
        content: the record.

    Raises:
        OutputError: it cannot be written.
    """
    plain = json.loads(content.model_dump_json())
    write_text(file, json.dumps(with_digest(plain), indent=1, ensure_ascii=False) + "\n")


def with_digest(content: dict[str, Any]) -> dict[str, Any]:
    """The content of a file, with its digest."""
    rest = {name: value for name, value in content.items() if name != DIGEST}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
    return rest | {DIGEST: hashlib.sha256(text.encode()).hexdigest()}


def read_checked(model: type[Model], file: Path, *, expected: str) -> Model:
    """Read a record.

    Args:
        model: of the record.
        file: that holds it.
        expected: what the file is, for messages.

    Raises:
        DataError: missing, not JSON, changed since it was written, or not what the model asks for; names the field.
    """
    try:
        content = json.loads(read_regular(file))
    except OSError as error:
        raise DataError(file, expected=expected, got=error.strerror or str(error)) from error
    except (ValueError, RecursionError) as error:
        got = f"no JSON ({' '.join(str(error).split())})"
        raise DataError(file, expected=expected, got=got, hint="make it again") from error
    if not isinstance(content, dict) or with_digest(content) != content:
        got = "other content than was written: the file is damaged, or was edited"
        raise DataError(file, expected=expected, got=got, hint="make it again")
    del content[DIGEST]
    return parse_json(model, json.dumps(content).encode(), file)
