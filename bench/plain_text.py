"""Text from outside, written so that it is seen and does nothing.

Names of recordings, objects, methods and files, titles and licences may hold anything: line breaks, commands of a
terminal, marks that turn the direction of writing, characters of no width, syntax of the file that they are written to.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Sequence

_SHORT = {"\n": r"\n", "\r": r"\r", "\t": r"\t"}
_UNDERSCORE_AT_EDGE = re.compile(r"(?<![^\W_])_|_(?![^\W_])")  # inside of a word it emphasises nothing
_TAG = re.compile(r"<(?=[A-Za-z/!?])")
_ENTITY = re.compile(r"&(?=#?\w+;)")


def plain(text: str) -> str:
    r"""Text as one line of visible characters; others are shown as in JSON, an escape character as `\u001b`."""
    return text if text.isprintable() else "".join(c if _is_visible(c) else _shown(c) for c in text)


def escape_markdown(text: str) -> str:
    """Text for a cell or a paragraph of GitHub's Markdown, in which it stands for itself on one line."""
    escaped = re.sub(r"([\\`*|~$])", r"\\\1", plain(text)).replace("](", r"]\(")
    escaped = _UNDERSCORE_AT_EDGE.sub(r"\\_", escaped)
    return _TAG.sub("&lt;", _ENTITY.sub("&amp;", escaped))


def parsed_number(text: str) -> float:
    """A number as other programs write it; NaN for all else, such as `1_000`, which Python takes for one."""
    try:
        return float(text) if "_" not in text and text.isascii() else math.nan
    except ValueError:
        return math.nan


def counted(count: int, what: str) -> str:
    """A number of things: "1 error", "2 errors", "2 processes", "2 patches"."""
    ending = "es" if what.endswith(("s", "x", "z", "ch", "sh")) else "s"
    return f"{count} {what}{'' if count == 1 else ending}"


def listed(names: Sequence[str], most: int = 5) -> str:
    """The first few of many names."""
    rest = len(names) - most
    return ", ".join(names[:most]) + (f" and {rest} more" if rest > 0 else "")


def _is_visible(character: str) -> bool:
    return character.isprintable() or unicodedata.category(character) == "Zs"


def _shown(character: str) -> str:
    number = ord(character)
    return _SHORT.get(character) or (f"\\u{number:04x}" if number < 0x10000 else f"\\U{number:08x}")
