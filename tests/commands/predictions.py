"""Predictions of the tiny data set: the reference itself, nothing, everything, and those of the paper's method."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.evaluation import load_protocol
from bench.harness import FramePipeline
from bench.methods import build_method
from bench.recordings import load_card, open_dataset
from bench.reference import ReferenceFrame

CAMERA = "front"


@dataclass(frozen=True, kw_only=True, eq=False)
class Image:
    """An image of the data set and what may be predicted of it."""

    recording: str
    frame: int
    timestamp_ns: int
    reference: ReferenceFrame
    method: NDArray[np.bool_]
    likelihood: NDArray[np.float32]

    @property
    def moving(self) -> NDArray[np.uint8]:
        return (self.reference.labels > 0).astype(np.uint8) * 255

    @property
    def place(self) -> str:
        return f"{self.recording}/{CAMERA}"


def images_of(card: Path) -> list[Image]:
    """All images that have one before them."""
    method, found = build_method("spherical"), []
    for handle in open_dataset(load_card(str(card))):
        pipeline = FramePipeline(handle.open(), CAMERA, method=method, protocol=load_protocol("paper-v1"))
        for frame in range(1, len(pipeline.images)):
            processed = pipeline.process(frame)
            assert processed.segmentation.likelihood is not None
            found.append(
                Image(
                    recording=handle.name,
                    frame=frame,
                    timestamp_ns=processed.image.timestamp_ns,
                    reference=processed.reference,
                    method=processed.segmentation.mask,
                    likelihood=processed.segmentation.likelihood,
                )
            )
    return found


def write_map(folder: Path, place: str, name: object, values: NDArray) -> Path:
    """Write a PNG file at its place."""
    file = folder / place / f"{name}.png"
    file.parent.mkdir(parents=True, exist_ok=True)
    if values.dtype == np.uint16:
        (folder / "predictions.yaml").write_text("sixteen_bits: score\n")
    assert cv2.imwrite(str(file), values)
    return file


def write_maps(folder: Path, images: list[Image], values_of) -> Path:
    """Write a PNG file of every image, named by its time."""
    shutil.rmtree(folder, ignore_errors=True)
    for image in images:
        write_map(folder, image.place, image.timestamp_ns, values_of(image))
    return folder
