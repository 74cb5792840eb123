"""Ablation of training by groups of channels and kinds of images.

It is no part of the other tests; `pytest benchmarks/tests/torch_ablation.py` needs the extra `train`, for PyTorch.
"""

from dataclasses import replace

import pandas as pd
import pytest

from bench.methods.learned.inputs import GROUPS
from bench.recordings import load_card
from bench.synthesis.production import read_scenario
from bench.training.pairs import prepare
from bench.training.train import Plan
from benchmarks.ablation import KINDS, Drives, of_kind, score, seen_drives, tables, variants
from tests.conftest import DATASETS

PLAN = Plan(epochs=1, batch=4, crop_px=(96, 128))  # the tiny images are half as large as those of the training data


@pytest.fixture(scope="module")
def drives(tiny_card, tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    return prepare(tiny_card, "all", folder, disturbed=True, workers=1, progress=lambda *_: None)


def test_a_kind_of_training_image_is_left_out_and_others_come_twice(drives):
    card = load_card(DATASETS / "training.yaml")
    specs = {spec.name: spec for spec in read_scenario(card.scenario).recordings}
    of_camera = [replace(drives[0], recording=name, camera=camera) for name in specs for camera in ("front", "high")]
    assert seen_drives(of_camera, specs, None) == of_camera
    for kind in KINDS:
        seen = seen_drives(of_camera, specs, kind)
        assert len(seen) == len(of_camera)
        assert not of_kind(kind, seen, specs), kind
        assert 0.5 * len(seen) <= len({(drive.recording, drive.camera) for drive in seen}) < len(seen), kind


def test_an_ablation_trains_without_and_tells_what_is_lacking(drives, tmp_path, monkeypatch):
    of_training = read_scenario(load_card(DATASETS / "training.yaml").scenario).recordings
    night, low = (
        next(spec for spec in of_training if spec.name.startswith("farther-away") and spec.light.kind == kind)
        for kind in ("night", "low_sun")
    )
    wet = night.model_copy(update={"street": night.street.model_copy(update={"wet": True})})
    specs = {"crossing": night, "overtaking": wet, "standing": low}
    monkeypatch.setitem(KINDS, "rolling shutter", lambda drive, _: drive is low)
    held = Drives(training={True: drives, False: drives}, rendered=drives, disturbed=drives, specs=specs)
    plans = variants(PLAN)
    assert [*plans] == ["nothing", *GROUPS, *KINDS, "worse cameras"]
    assert plans["fine"].plan.without == ("fine",)
    assert not plans["worse cameras"].plan.disturbed
    rows = []
    for name in ("nothing", "scene", "low sun"):
        (tmp_path / name).mkdir()
        rows.append({"left out": name, "seed": 1, **score(plans[name], held, tmp_path / name)})
    assert rows[0]["IoU of images, night"] == rows[0]["IoU of images, wet roads"] != rows[0]["IoU of images, low sun"]
    whole, less = rows[0]["IoU of images, as rendered"], rows[1]["IoU of images, as rendered"]
    everywhere, kinds = tables(pd.DataFrame(rows)).split("\n\n")
    assert f"| scene | {100 * less:.1f} | {100 * (less - whole):+.1f} |" in everywhere
    assert len(everywhere.splitlines()) == 2 + len(rows)
    seen, unseen = (rows[row]["IoU of images, low sun"] * 100 for row in (0, 2))
    assert kinds.splitlines()[-1] == f"| low sun | {seen:.1f} | {unseen:.1f} | {unseen - seen:+.1f} |"
