"""The same images as every run of a group was scored on them, for a page that lays any two beside each other.

An image is stored once. What a run made of it is a layer of flat colours, one pixel in two, which takes a kilobyte.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.errors import BenchError
from bench.harness import FramePipeline, ProcessedFrame
from bench.reporting import canvas
from bench.reporting.count_view import AREA_COLOURS, detected_pixels, false_positive_text, pixel_classes
from bench.reporting.formats import LABELS, frame_name
from bench.reporting.frame_pictures import example_frames
from bench.reporting.leaderboard.reading import Group
from bench.reporting.side_by_side import ImageKey, Progress, draw_images
from bench.reporting.stored_run import read_stored_run

WIDTH_PX, LAYER_PX = 480, 320
QUALITY, STRENGTH = 72, 170  # of JPEG; of the colours, of 255


@dataclass(frozen=True, slots=True, kw_only=True)
class Example:
    """An image and what each run made of it.

    Attributes:
        title: kind of motion, and which image it is.
        image: `data:` address.
        layers: run -> `data:` address of its areas.
        notes: run -> its false positives.
    """

    title: str
    image: str
    layers: dict[str, str]
    notes: dict[str, str]


def draw_examples(group: Group, *, progress: Progress | None = None) -> tuple[tuple[Example, ...], tuple[str, ...]]:
    """Draw one image of each kind of motion: that in which an object of it fills most pixels, whoever finds it.

    Args:
        group: of runs whose data set is there.
        progress: called with the runs done and their number.

    Returns:
        examples: with the layers of those runs that could be drawn.
        problems: why others could not, one line each.
    """
    images: dict[ImageKey, str] = {}
    examples: dict[ImageKey, Example] = {}
    problems: dict[str, None] = {}

    def draw(key: ImageKey, frames: Sequence[ProcessedFrame], _: FramePipeline) -> tuple[str, str]:
        if key not in examples:
            title = f"{images[key]}: {frame_name(frames[0].reference)}"
            photograph = canvas.jpeg_uri(_photograph(frames[0].pixels), quality=QUALITY)
            examples[key] = Example(title=title, image=photograph, layers={}, notes={})
        return _layer(frames[0]), false_positive_text(frames[0])

    for number, entry in enumerate(group.entries, start=1):
        try:
            run = read_stored_run(entry.folder, label=entry.run)
            images = images or {key: LABELS[category] for category, key in example_frames(run.objects).items()}
            drawn, failed = draw_images([run], images, draw)
        except BenchError as error:
            drawn, failed = {}, [str(error)]
        problems |= dict.fromkeys(f"{entry.run}: {problem}" for problem in failed)
        for key, (layer, note) in drawn.items():
            examples[key].layers[entry.run], examples[key].notes[entry.run] = layer, note
        if progress is not None:
            progress(number, len(group.entries))
    return tuple(examples[key] for key in images if key in examples), tuple(problems)


def _photograph(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    grey = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    height = round(grey.shape[0] * WIDTH_PX / grey.shape[1])
    return np.asarray(cv2.resize(grey, (WIDTH_PX, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _layer(frame: ProcessedFrame) -> str:
    classes = pixel_classes(frame.reference, detected=detected_pixels(frame))
    step = max(1, round(classes.shape[1] / LAYER_PX))
    classes = classes[step // 2 :: step, step // 2 :: step]
    layer = np.zeros((*classes.shape, 4), dtype=np.uint8)
    for kind, colour in AREA_COLOURS.items():
        layer[classes == kind] = (*canvas.rgb(colour)[::-1], STRENGTH)
    return canvas.layer_uri(layer)
