"""Damage as disks, transfers and editors do it to files; the same seed does the same."""

from __future__ import annotations

import re
from random import Random

NUMBERS = ("0", "-1", "1e999", "NaN", "null", '"5"', "1e40", "99999999999999999999", "[]", "-0.0001", "1e-300", "1_000")


def flip_bits(content: bytes, rng: Random) -> bytes:
    changed = bytearray(content)
    for _ in range(rng.randint(1, 4)):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def cut_short(content: bytes, rng: Random) -> bytes:
    return content[: rng.randrange(len(content))]


def zero_a_block(content: bytes, rng: Random) -> bytes:
    start = rng.randrange(len(content))
    length = min(rng.choice((8, 64, 512)), len(content) - start)
    return content[:start] + bytes(length) + content[start + length :]


def write_another_number(content: bytes, rng: Random) -> bytes:
    places = list(re.finditer(rb"-?\d+(\.\d+)?([eE][+-]?\d+)?", content))
    if not places:
        return flip_bits(content, rng)
    place = rng.choice(places)
    return content[: place.start()] + rng.choice(NUMBERS).encode() + content[place.end() :]


def lose_a_word(content: bytes, rng: Random) -> bytes:
    """A key, for example."""
    places = list(re.finditer(rb"\w+", content))
    if not places:
        return cut_short(content, rng)
    place = rng.choice(places)
    return content[: place.start()] + content[place.end() :]


OF_BYTES = (flip_bits, cut_short, zero_a_block)
OF_TEXT = (*OF_BYTES, write_another_number, lose_a_word)


def damaged(content: bytes, rng: Random) -> tuple[bytes, str]:
    """Another content, and what was done to it; text gets the damage of texts too."""
    is_text = content[:1000].isascii() and b"\0" not in content[:1000]
    for _ in range(100):
        kind = rng.choice(OF_TEXT if is_text else OF_BYTES)
        changed = kind(content, rng)
        if changed != content:
            return changed, kind.__name__
    raise AssertionError("nothing to damage")
