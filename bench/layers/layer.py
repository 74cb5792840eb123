"""What an annotation layer is, and what reads and writes one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from bench.errors import UsageError
from bench.recordings import OBJECT_CLASSES, Recording, Track


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Layer:
    """Annotations of one recording, and when the scene was annotated.

    Attributes:
        tracks: objects; their states are in the vehicle frame at each state's time.
        timestamps_ns: all annotated times, also those at which the scene held nothing, increasing.
        lost: one line for each thing that the source did not tell or that did not survive the translation.
    """

    tracks: tuple[Track, ...]
    timestamps_ns: tuple[int, ...]
    lost: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerOptions:
    """What the user says about a tool's files.

    Attributes:
        classes: the tool's class -> one of `OBJECT_CLASSES`, or None to leave its objects out on purpose; on top of
            what a format knows by itself.
        first_frame: number of the first sweep in the tool's frames; see `bench.layers.frames`.

    Raises:
        UsageError: a class that is none of ours.
    """

    classes: Mapping[str, str | None] = field(default_factory=dict)
    first_frame: int = 0

    def __post_init__(self) -> None:
        for tool_class, ours in self.classes.items():
            if ours is not None and ours not in OBJECT_CLASSES:
                raise UsageError(f"class {tool_class!r}: expected one of {', '.join(OBJECT_CLASSES)}, got {ours!r}")


class LayerFormat(Protocol):
    """Translates between the files of a tool and a layer; without state.

    Attributes:
        name: as the registry knows it, for example "kitti-tracklets".
        description: one line, for the listing.
    """

    name: str
    description: str

    def read(self, source: Path, recording: Recording, options: LayerOptions) -> Layer:
        """Read a layer.

        Args:
            source: the tool's file or folder.
            recording: what was annotated; its own tracks are not looked at.
            options: what the user says about the files.

        Raises:
            DataError: not what the format asks for, frames that do not pair with the recording's, unknown classes.
        """
        ...

    def write(self, layer: Layer, recording: Recording, out: Path, options: LayerOptions) -> tuple[str, ...]:
        """Write a layer, each file whole or not at all.

        Args:
            layer: the annotations.
            recording: what they belong to.
            out: folder of this recording's files; made if missing, nothing is written outside.
            options: what the tool's files should look like.

        Returns:
            One line for each thing that the format cannot hold.

        Raises:
            DataError: frames that do not pair with the recording's.
        """
        ...
