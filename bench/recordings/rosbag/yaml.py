"""YAML files beside messages: plain values only, and never without a limit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bench.errors import DataError
from bench.plain_yaml import parse_yaml
from bench.recordings.text_files import read_text


def read_yaml(file: Path, *, most_bytes: int) -> dict[str, Any]:
    """Read keys and values.

    Args:
        file: UTF-8 text.
        most_bytes: a larger file is refused.

    Raises:
        DataError: missing, too large, not YAML, or with tags that stand for objects.
    """
    content = parse_yaml(read_text(file, largest_bytes=most_bytes), file=file)
    if not isinstance(content, dict):
        raise DataError(file, expected="keys and values", got=type(content).__name__)
    return content
