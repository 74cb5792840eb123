"""The same images as every run of a group was scored on them, for a page that lays any two beside each other.

An image is stored once. What a run made of it is a layer of flat colours, one pixel in two, which takes a kilobyte.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.errors import BenchError
from bench.harness import FramePipeline, ProcessedFrame
from bench.harness.stages import Progress
from bench.harness.stored import read_run
from bench.reporting import canvas
from bench.reporting.formats import LABELS, frame_name
from bench.reporting.frame import AREA_COLOURS, detected_pixels, false_positive_text, pixel_classes
from bench.reporting.frame_pictures import ImageKey, draw_images, example_frames
from bench.reporting.leaderboard.reading import Group

WIDTH_PX, LAYER_PX = 480, 320
Example = dict[str, Any]  # an image and what each run made of it, as the page takes it
QUALITY, STRENGTH = 72, 170  # of JPEG; of the colours, of 255


def draw_examples(group: Group, *, progress: Progress | None = None) -> tuple[list[Example], list[str]]:
    """Draw one image of each kind of motion: that in which an object of it fills most pixels, whoever finds it.

    Args:
        group: of runs whose data set is there.
        progress: called with the runs done and their number.

    Returns:
        examples: `title` (kind of motion, and which image it is), `image` (`data:` address), and by run `layers` (its
            areas) and `notes` (its false positives), of those that could be drawn.
        problems: why others could not, one line each.
    """
    images: dict[ImageKey, str] = {}
    examples: dict[ImageKey, Example] = {}
    problems: dict[str, None] = {}

    def draw(key: ImageKey, frames: Sequence[ProcessedFrame], _: FramePipeline) -> tuple[str, str]:
        if key not in examples:
            title = f"{images[key]}: {frame_name(frames[0].reference)}"
            photograph = canvas.jpeg_uri(_photograph(frames[0].pixels), quality=QUALITY)
            examples[key] = {"title": title, "image": photograph, "layers": {}, "notes": {}}
        return _layer(frames[0]), false_positive_text(frames[0])

    for number, entry in enumerate(group.entries, start=1):
        try:
            run = read_run(entry.folder, label=entry.run)
            images = images or {key: LABELS[category] for category, key in example_frames(run.objects).items()}
            drawn, failed = draw_images([run], images, draw)
        except BenchError as error:
            drawn, failed = {}, [str(error)]
        problems |= dict.fromkeys(f"{entry.run}: {problem}" for problem in failed)
        for key, (layer, note) in drawn.items():
            examples[key]["layers"][entry.run], examples[key]["notes"][entry.run] = layer, note
        if progress is not None:
            progress(number, len(group.entries))
    return [examples[key] for key in images if key in examples], list(problems)


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
