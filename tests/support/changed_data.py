"""Changes and damages of a recording's files and of stored units."""

import json
import os
import re
from pathlib import Path

import cv2
import numpy as np


def changed_in_place(file: Path, content: bytes) -> None:
    """Give a file another content and the times that it had."""
    state = file.stat()
    file.write_bytes(content)
    os.utime(file, ns=(state.st_atime_ns, state.st_mtime_ns))


def change_image(folder: Path) -> None:
    file = sorted((folder / "images" / "front").iterdir())[2]
    pixels = cv2.imread(str(file))
    pixels[120:200, 100:220] = 255 - pixels[120:200, 100:220]
    changed_in_place(file, cv2.imencode(file.suffix, pixels)[1].tobytes())


def change_sweep(folder: Path) -> None:
    for file in sorted((folder / "lidar").glob("*.npz")):
        with np.load(file) as stored:
            arrays = dict(stored)
        arrays["points_lidar"] = arrays["points_lidar"] * np.float32(1.01)
        np.savez_compressed(file, **arrays)


def change_annotation(folder: Path) -> None:
    file = folder / "annotations.json"
    content = json.loads(file.read_text())
    for frame in content["openlabel"]["frames"].values():
        for entry in frame["objects"].values():
            entry["object_data"]["cuboid"][0]["val"][7] *= 0.8
    changed_in_place(file, json.dumps(content).encode())


def change_egomotion(folder: Path) -> None:
    file = next(iter(folder.glob("egomotion.csv")))
    head, *rows = file.read_text().splitlines()
    column = head.split(",").index("yaw_rate_radps")
    cells = [row.split(",") for row in rows]
    for row in cells:
        row[column] = str(float(row[column]) + 0.05)
    changed_in_place(file, "\n".join([head, *(",".join(row) for row in cells)]).encode() + b"\n")


def change_calibration(folder: Path) -> None:
    file = folder / "recording.json"
    content = json.loads(file.read_text())
    content["cameras"]["front"]["model"]["principal_point"][0] += 3.0
    changed_in_place(file, json.dumps(content).encode())


def remove_image(folder: Path) -> None:
    sorted((folder / "images" / "front").iterdir())[-1].unlink()


def without_scenario(card: Path) -> None:
    """Let a card's data be as they are: what is changed in them is not rendered again."""
    card.write_text(re.sub("scenario:.*\n", "", card.read_text()))
