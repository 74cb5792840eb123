"""Parts of the JSON files of other tools, which may hold more than is used here."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import ConfigDict, Field

from bench.recordings.validation import FileModel

LARGEST_M = 1e8  # coordinates of any map are below


class ToolModel(FileModel):
    """Part of a file of another tool: keys that are not used are passed over."""

    model_config = ConfigDict(extra="ignore")


Length = Annotated[float, Field(ge=-LARGEST_M, le=LARGEST_M)]


class Vector(ToolModel):
    """Three numbers along or about x, y and z."""

    x: Length
    y: Length
    z: Length

    def numbers(self) -> tuple[float, float, float]:
        """x, y and z."""
        return self.x, self.y, self.z


def finite_number(value: object) -> float | None:
    """A number of a file as float; None for anything else, also NaN, infinity and what float cannot hold."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None
