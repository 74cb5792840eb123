"""Damage as disks, transfers and editors do it to files; the same seed does the same."""

from __future__ import annotations

import re
from random import Random

NUMBERS = (
    "0",
    "-1",
    "1e999",
    "NaN",
    "null",
    '"5"',
    "1e40",
    "99999999999999999999",
    "[]",
    "0.5",
    "-0.0001",
    "1e-300",
    "1e300",
    "1_000",
)


def flip_bits(content: bytes, rng: Random) -> bytes:
    """One to four bits are the other way round."""
    changed = bytearray(content)
    for _ in range(rng.randint(1, 4)):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def cut_short(content: bytes, rng: Random) -> bytes:
    """The end is missing."""
    return content[: rng.randrange(len(content))]


def lose_a_piece(content: bytes, rng: Random) -> bytes:
    """Some bytes in the middle are missing."""
    start = rng.randrange(len(content))
    return content[:start] + content[start + rng.randint(1, 64) :]


def zero_a_block(content: bytes, rng: Random) -> bytes:
    """A block was never written."""
    start = rng.randrange(len(content))
    length = min(rng.choice((8, 64, 512)), len(content) - start)
    return content[:start] + bytes(length) + content[start + length :]


def insert_noise(content: bytes, rng: Random) -> bytes:
    """Bytes of something else are in the middle."""
    start = rng.randrange(len(content) + 1)
    return content[:start] + rng.randbytes(rng.randint(1, 64)) + content[start:]


def repeat_a_piece(content: bytes, rng: Random) -> bytes:
    """A piece is there twice."""
    start = rng.randrange(len(content))
    stop = start + rng.randint(1, 64)
    return content[:stop] + content[start:stop] + content[stop:]


def write_another_number(content: bytes, rng: Random) -> bytes:
    """One number of a text is another, or none."""
    found = list(re.finditer(rb"-?\d+(\.\d+)?([eE][+-]?\d+)?", content))
    if not found:
        return flip_bits(content, rng)
    place = rng.choice(found)
    return content[: place.start()] + rng.choice(NUMBERS).encode() + content[place.end() :]


def lose_a_line(content: bytes, rng: Random) -> bytes:
    """One line of a text is missing."""
    lines = content.splitlines(keepends=True)
    del lines[rng.randrange(len(lines))]
    return b"".join(lines)


def lose_a_word(content: bytes, rng: Random) -> bytes:
    """One word of a text, a key for example, is missing."""
    found = list(re.finditer(rb"\w+", content))
    if not found:
        return cut_short(content, rng)
    place = rng.choice(found)
    return content[: place.start()] + content[place.end() :]


OF_BYTES = (flip_bits, cut_short, lose_a_piece, zero_a_block, insert_noise, repeat_a_piece)
OF_TEXT = (*OF_BYTES, write_another_number, write_another_number, lose_a_line, lose_a_word)


def damaged(content: bytes, rng: Random) -> tuple[bytes, str]:
    """Another content, and what was done to it; text gets the damage of texts too."""
    for _ in range(100):
        kind = rng.choice(OF_TEXT if _is_text(content) else OF_BYTES)
        changed = kind(content, rng)
        if changed != content:
            return changed, kind.__name__
    raise AssertionError("nothing to damage")


def _is_text(content: bytes) -> bool:
    try:
        content[:1000].decode("ascii")
    except UnicodeDecodeError:
        return False
    return b"\0" not in content[:1000]
