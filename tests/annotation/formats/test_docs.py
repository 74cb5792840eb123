"""The lines of pandas that the docs show, on small files of each tool."""

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.annotation.formats.conversion import LabelOptions, import_labels
from bench.commands.annotate import open_unannotated
from bench.recordings import load_card
from tests.support import tiny
from tests.support.cards import write_card

SECTION = (Path(__file__).parents[3] / "docs/your-data.md").read_text("utf-8").partition("### A table of boxes")[2]
HEAD, *EXAMPLES = re.findall(r"```python\n(.*?)```", SECTION, flags=re.DOTALL)
TIME_NS = tiny.TIMES_NS[0]
PLACE, SIZE, YAW = (8.0, -2.0, -0.5), (4.5, 1.75, 1.5), 0.5


def sustechpoints(time_ns):
    psr = {key: dict(zip("xyz", numbers, strict=True)) for key, numbers in
           (("position", PLACE), ("scale", SIZE), ("rotation", (0.0, 0.0, YAW)))}  # fmt: skip
    box = {"obj_id": "7", "obj_type": "Car", "psr": psr}
    Path("label").mkdir()
    Path(f"label/{time_ns}.json").write_text(json.dumps([box]))
    return "7"


def argoverse(time_ns):
    row = {"timestamp_ns": time_ns, "track_uuid": "a-b", "category": "REGULAR_VEHICLE", "num_interior_pts": 5}
    row |= dict(zip(("length_m", "width_m", "height_m"), SIZE, strict=True))
    row |= {"qw": np.cos(YAW / 2), "qx": 0.0, "qy": 0.0, "qz": np.sin(YAW / 2)}
    row |= dict(zip(("tx_m", "ty_m", "tz_m"), PLACE, strict=True))
    pd.DataFrame([row]).to_feather("annotations.feather")
    return "a-b"


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_the_example_makes_a_table_that_is_imported(tmp_path, monkeypatch, number):
    tool = (sustechpoints, argoverse)[number]
    tiny.write_recording(tmp_path / "data/drive-1")
    write_card(tmp_path, file="my-data.yaml")
    monkeypatch.chdir(tmp_path)
    name = tool(TIME_NS)
    exec(HEAD + EXAMPLES[number], {})
    recording = open_unannotated(load_card("my-data.yaml"), "drive-1")
    options = LabelOptions(classes={"REGULAR_VEHICLE": "vehicle"})
    (track,) = import_labels("boxes", tmp_path / "boxes.csv", recording, options).tracks
    assert track.track_id == name
    (state,) = track.states
    assert state.timestamp_ns == TIME_NS
    box = state.shape.vehicle_from_object
    if tool is sustechpoints:
        box = recording.vehicle_from_lidar.inverse() @ box
    assert box.translation_m == pytest.approx(PLACE)
    assert np.arctan2(box.rotation[1, 0], box.rotation[0, 0]) == pytest.approx(YAW)
    assert state.shape.size_m == pytest.approx(SIZE)
