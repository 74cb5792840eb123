"""Files that users write by hand, mistyped as people mistype them: refused in a line, or read as what they say now."""

import json
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from random import Random
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from bench.errors import BenchError
from bench.evaluation import load_protocol
from bench.gate.tolerances import load_tolerances
from bench.methods.predictions import PredictedMotion
from bench.methods.predictions.method import check_predictions
from bench.recordings import load_card, open_dataset
from bench.reference import ReferenceBuilder
from tests.support import tiny
from tests.support.limits import at_most

CASES = 15  # of each file
VALUES = (None, True, "", "nope", 0, -1, 1e300, 10**25, "5", "1_000", [], {}, [1], 1e-300, "\u0661", "a\nb", "../..")
FACTORS = (1000, 1e-3, 1e9, -1, 3.6, 57.29578, 1.01)
WRITTEN = {
    "card.yaml": {
        "name": "drives", "title": "t", "adapter": "native", "root": "data", "licence": "none", "splits": {"all": "*"},
        "exclusions": [{"recording": "drive", "frames": [0, 0], "reason": "the first"}],
        "annotated": {"timestamps_ns": [[0, None]], "left_out_m": [[[50, 50], [60, 50], [60, 60]]]},
    },
    "protocol.yaml": {"based_on": "surface-v1", "name": "mine", "version": 1, "reference": {"range_limit_m": 20.0}},
    "tolerances.yaml": {"based_on": "default-v1", "name": "ours", "slices": {"moving": {"iou": {"decides": True}}}},
    "masks/predictions.yaml": {"sixteen_bits": "score"},
}  # fmt: skip


def nodes(value: Any, parent: Any = None, key: Any = None) -> Iterator[tuple[Any, Any]]:
    """Every part of a document, as the part that holds it and its key there."""
    if parent is not None:
        yield parent, key
    for inner in value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ():
        yield from nodes(value[inner], value, inner)


def mistyped(document: Any, rng: Random) -> Any:
    changed = deepcopy(document)
    parent, key = rng.choice(list(nodes(changed)))
    value = parent[key]
    others = [rng.choice(VALUES), f"{value} "]
    others += [value * rng.choice(FACTORS)] if isinstance(value, int | float) else []
    kind = rng.choice(("another value", "left out", "another key"))
    if kind == "another value":
        parent[key] = rng.choice(others)
    else:
        del parent[key]
    if kind == "another key" and isinstance(parent, dict):
        place = rng.randrange(len(key))
        parent[key[:place] + rng.choice("abx") + key[place + 1 :]] = value
    return changed


def read(folder: Path) -> None:
    """Each of the files, and the reference that they lead to."""
    settings = load_protocol(folder / "protocol.yaml").reference_settings()
    load_tolerances(folder / "tolerances.yaml")
    card = load_card(folder / "card.yaml")
    for handle in open_dataset(card):
        recording = handle.open()
        for camera, images in recording.images.items():
            ReferenceBuilder(recording, camera, settings).build(images[-1])
    masks = PredictedMotion(name="masks", folder=str(folder / "masks"), dataset=str(card.file), split=None)
    check_predictions(card, method=masks)


@pytest.mark.parametrize("name", [*WRITTEN, "data/drive/recording.json", "data/drive/annotations.json"])
def test_mistyped_files(tmp_path, name):
    tiny.write_recording(tmp_path / "data" / "drive")
    (tmp_path / "masks" / "front").mkdir(parents=True)
    for time_ns in tiny.TIMES_NS:
        cv2.imwrite(str(tmp_path / f"masks/front/{time_ns}.png"), np.eye(tiny.HEIGHT, tiny.WIDTH, dtype=np.uint16))
    for file, content in WRITTEN.items():
        (tmp_path / file).write_text(yaml.safe_dump(content))
    read(tmp_path)
    document = yaml.safe_load((tmp_path / name).read_text())
    for case in range(CASES):
        changed = mistyped(document, Random(f"{name} {case}"))
        (tmp_path / name).write_text(json.dumps(changed))  # which is YAML, too
        told = name
        with at_most(seconds=30):
            try:
                read(tmp_path)
            except BenchError as error:
                told = str(error)
        assert "\n" not in told, case
        assert any(place in told for place in (name, "annotations", "drive", "masks")), (case, told)
