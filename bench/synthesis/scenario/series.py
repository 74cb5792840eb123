"""Series: many recordings from one description."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from bench.recordings.validation import FileModel
from bench.synthesis.scenario.draws import Dice, DrawError
from bench.synthesis.scenario.values import Name

LARGEST_REPEAT = 40


class SeriesSpec(FileModel):
    """A series of recordings; any value of its template may be a draw (see `draws`).

    Attributes:
        name: its recordings are called name-01, name-02 ...
        about: one line for the reader of the file.
        count: recordings.
        values: name -> draw, for numbers that several fields share, as a speed and the bend that is driven with it.
        frames: as in a recording, and so are the fields below; each may hold draws.
        host: how the host drives.
        street: the static world.
        light: sun, clouds or night.
        actors: everything that is annotated; `repeat` says how often one occurs, as name-1, name-2 ...
    """

    name: Name
    about: str = ""
    count: int = Field(ge=1, le=999)
    values: dict[str, Any] = Field(default_factory=dict)
    frames: Any = 30
    host: Any
    street: Any = Field(default_factory=dict)
    light: Any = Field(default_factory=dict)
    actors: Any = ()

    def recording(self, index: int, *, seed: int, attempt: int = 0) -> tuple[dict[str, Any], list[int]]:
        """Draw one recording.

        Args:
            index: of the recording in the series, from 0.
            seed: of the scenario.
            attempt: 0, then 1 and so on to draw it anew.

        Returns:
            values: of a `RecordingSpec`.
            origins: for each of its actors, which of the series' it comes from.

        Raises:
            DrawError: something that is not a draw.
        """
        dice = Dice(seed=seed, series=self.name, index=index, count=self.count, attempt=attempt, values=self.values)
        actors: list[Any] = []
        origins: list[int] = []
        for k, node in enumerate(self.actors if isinstance(self.actors, list | tuple) else []):
            found = _actors(node, dice, f"actors.{k}")
            actors += found
            origins += [k] * len(found)
        drawn = {key: dice.drawn(getattr(self, key), key) for key in ("frames", "host", "street", "light")}
        name = f"{self.name}-{index + 1:0{max(2, len(str(self.count)))}d}"
        return {"name": name, "about": self.about, **drawn, "actors": actors}, origins


def _actors(node: Any, dice: Dice, path: str) -> list[Any]:
    """An actor, or its repeats."""
    if not isinstance(node, dict) or "repeat" not in node:
        return [dice.drawn(node, path)]
    repeat = dice.drawn(node["repeat"], f"{path}.repeat")
    if isinstance(repeat, bool) or not isinstance(repeat, int) or not 0 <= repeat <= LARGEST_REPEAT:
        raise DrawError(f"{path}.repeat", f"a whole number from 0 to {LARGEST_REPEAT}", repeat)
    template = {key: part for key, part in node.items() if key != "repeat"}
    found = []
    for k in range(repeat):
        actor = dice.drawn(template, path, repeat=k)
        found.append({**actor, "name": f"{actor.get('name')}-{k + 1}"})
    return found
