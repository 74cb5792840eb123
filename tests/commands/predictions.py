"""Predictions of the tiny data set: the reference itself, nothing, everything, and those of the paper's method."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import bench
from bench.methods import Segmentation, build_method
from bench.reference import ReferenceFrame

CAMERA = "front"


@dataclass(frozen=True, kw_only=True, eq=False)
class Image:
    """An image of the data set and what the paper's method answers."""

    recording: str
    timestamp_ns: int
    reference: ReferenceFrame
    answer: Segmentation

    @property
    def moving(self) -> NDArray[np.uint8]:
        return (self.reference.labels > 0).astype(np.uint8) * 255

    @property
    def place(self) -> str:
        return f"{self.recording}/{CAMERA}"


def images_of(card: Path) -> list[Image]:
    """All images that have one before them."""
    method = build_method("spherical")
    return [
        Image(
            recording=frame.recording,
            timestamp_ns=frame.timestamp_ns,
            reference=frame.reference,
            answer=method.segment(frame.input),
        )
        for frame in bench.open_dataset(card).frames(protocol="paper-v1")
    ]


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
