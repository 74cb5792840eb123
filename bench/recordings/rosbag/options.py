"""What a card can say of ROS 2 bags."""

from __future__ import annotations

from typing import Literal

from bench.recordings.validation import FileModel, SidePx


class RosbagOptions(FileModel):
    """The card's `options`.

    Attributes:
        rig: the file that says which topics are which sensors, relative to the data set's root; `{recording}` stands
            for the recording's name.
        clock: "header", the time that a message carries, or "bag", the time at which it was recorded.
        accept_losses: open a bag of which a part cannot be read, and use the rest.
        evaluated_size_px: (width, height) at which images are evaluated; null for as stored.
        licence: of the data.
    """

    rig: str = "rig.yaml"
    clock: Literal["header", "bag"] = "header"
    accept_losses: bool = False
    evaluated_size_px: tuple[SidePx, SidePx] | None = None
    licence: str = ""
