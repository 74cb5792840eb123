"""A copy of a native data set with larger images, for memory at other sizes; calibration and masks grow along."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import cv2

CARD = """
adapter: native
licence: {licence}
name: enlarged
root: {root}
title: larger images
splits: {{part: "*"}}
"""


def enlarge(recordings: Sequence[Path], out: Path, *, width: int, height: int) -> Path:
    """Write the copy; give back its card.

    Images are enlarged by `width` over theirs; rows are then repeated or cut at the bottom to make the height.

    Args:
        recordings: folders of native recordings with radial-polynomial lenses.
        out: folder that is made.
        width: of the new images, px.
        height: of the new images, px.
    """
    licence = ""
    for source in recordings:
        folder = out / "data" / source.name
        shutil.copytree(source, folder, ignore=shutil.ignore_patterns("images", "truth", "ego_body", "synthesis.json"))
        content = json.loads((source / "recording.json").read_text())
        licence = content["licence"]
        for name, camera in content["cameras"].items():
            model = camera["model"]
            scale = width / camera["image_size"][0]
            model["coefficients"] = [scale * term for term in model["coefficients"]]
            model["principal_point"] = [scale * (value + 0.5) - 0.5 for value in model["principal_point"]]
            camera["image_size"] = [width, height]
            files = [*(source / "images" / name).iterdir()]
            if camera.get("ego_body_mask"):
                files.append(source / camera["ego_body_mask"])
            for file in files:
                _write_larger(file, folder / file.relative_to(source), width=width, height=height)
        (folder / "recording.json").write_text(json.dumps(content))
    card = out / "enlarged.yaml"
    card.write_text(CARD.format(licence=licence, root=out / "data"))
    return card


def _write_larger(source: Path, target: Path, *, width: int, height: int) -> None:
    pixels = cv2.imread(str(source), cv2.IMREAD_UNCHANGED)
    way = cv2.INTER_NEAREST if "ego_body" in source.parts else cv2.INTER_CUBIC
    larger = cv2.resize(pixels, (width, round(pixels.shape[0] * width / pixels.shape[1])), interpolation=way)[:height]
    missing = height - larger.shape[0]
    target.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(target), cv2.copyMakeBorder(larger, 0, missing, 0, 0, cv2.BORDER_REPLICATE))
