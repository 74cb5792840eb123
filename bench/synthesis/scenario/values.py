"""Kinds of values that scenario files hold."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated

from pydantic import Field

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")]
Number = Annotated[float, Field(ge=-1e4, le=1e4)]  # metres, degrees, seconds: nothing of a scene lies beyond
NotNegative = Annotated[float, Field(ge=0, le=1e6)]
Positive = Annotated[float, Field(ge=1e-6, le=1e6)]
Place = tuple[Number, Number, Number]


def refuse_twice(names: list[str], field: str) -> None:
    """Raise ValueError unless every name occurs once."""
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"{field}: names that occur once; {', '.join(twice)} does not")


def refuse_misfit(times_s: tuple[float, ...], **profiles: tuple[float, ...] | float) -> None:
    """Raise ValueError unless times increase and every profile has one value, or one for each time."""
    if any(b <= a for a, b in pairwise(times_s)):
        raise ValueError("times_s that increase")
    for name, values in profiles.items():
        if isinstance(values, tuple) and (len(values) not in {1, len(times_s)} or not values):
            raise ValueError(f"{name}: one value, or one for each of the {len(times_s)} times")


def interval_ns(rate_hz: float) -> int:
    """Time between two images or revolutions."""
    return math.floor(1e9 / rate_hz + 0.5)
