"""The light of a recording."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from bench.recordings.validation import FileModel
from bench.synthesis.scenario.values import Number


class LightSpec(FileModel):
    """Sun and sky, or night.

    Attributes:
        kind: "sunny", a bright day; "overcast", no sun, no shadows; "low_sun", morning or evening, long shadows;
            "night", street lamps and the host's headlights.
        azimuth_deg: direction to the sun, to the left of the world's x axis; null draws one for the recording.
        elevation_deg: of the sun above the horizon; null draws one that fits the kind.
    """

    kind: Literal["sunny", "overcast", "low_sun", "night"] = "sunny"
    azimuth_deg: Number | None = None
    elevation_deg: float | None = Field(default=None, gt=0, le=90)
