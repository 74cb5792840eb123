"""The units of work of a run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from bench.errors import DataError
from bench.methods import Method
from bench.recordings import Recording

CHUNK_IMAGES = 100  # bounds the rows that are held before they are written; many times the lag of the chance level


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """Images `start` to `stop` (itself out) of a camera; the method may read images before `start`.

    Attributes:
        recording: name.
        camera: name.
        start: index of the first image to score.
        stop: index after the last.
    """

    recording: str
    camera: str
    start: int
    stop: int


def plan_units(recording: Recording, method: Method, *, chunk_images: int = CHUNK_IMAGES) -> Iterator[Unit]:
    """Cut a recording into units; a camera's first images, without history or not to be scored, belong to none.

    Raises:
        DataError: the recording has images, but none to be scored, as one has that is not annotated.
    """
    images_of_all = [image for images in recording.images.values() for image in images]
    if images_of_all and not any(image.scored for image in images_of_all):
        do = f"write {recording.name}.json into the folder that the card's annotations names (annotations/README.md)"
        raise DataError(recording.root, field=recording.name, expected="annotations", got="none", do=do)
    for camera in sorted(recording.cameras):
        images = len(recording.images[camera])
        first = next((i for i, image in enumerate(recording.images[camera]) if image.scored), images)
        for start in range(max(method.history, first), images, chunk_images):
            yield Unit(recording=recording.name, camera=camera, start=start, stop=min(start + chunk_images, images))
