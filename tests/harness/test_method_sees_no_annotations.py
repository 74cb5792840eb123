"""What a method is handed, and that it cannot reach more."""

from dataclasses import fields

import numpy as np
import pytest

from bench.evaluation import load_protocol
from bench.harness import FramePipeline
from bench.methods import Method, MethodInput, Segmentation
from bench.recordings import load_card, open_dataset


class Spy(Method):
    name, history, colour = "spy", 2, True

    def __init__(self):
        self.seen = []

    def __deepcopy__(self, memo):
        return self  # the test looks at what the copy of a unit saw

    def segment(self, frame):
        self.seen.append(frame)
        return Segmentation(cell_size_px=1, mask=np.zeros(frame.valid.shape, bool))


def test_history_colour_and_ego_motion_arrive_and_nothing_else(tiny_card):
    recording = next(h for h in open_dataset(load_card(str(tiny_card))) if h.name == "crossing").open()
    spy = Spy()
    pipeline = FramePipeline(recording, "front", method=spy, protocol=load_protocol("paper-v1"))
    pipeline.process(2)
    pipeline.process(3)
    given = spy.seen[-1]
    assert {f.name for f in fields(MethodInput)} == {
        "images",
        "timestamps_ns",
        "camera",
        "road",
        "current_from_previous",
        "valid",
        "rolling_shutter",
        "recording",
        "camera_name",
    }
    assert [image.shape for image in given.images] == [(240, 320, 3)] * 3
    np.testing.assert_array_equal(given.images[0], spy.seen[0].images[1])
    steps = [motion.translation_m for motion in given.current_from_previous]
    assert len(steps) == 2
    # 7 km/h at 15 images per second, straight ahead and seen by a camera pitched 20 degrees down: the previous
    # place lies behind (z < 0) and, in camera axes, below (y > 0).
    for step in steps:
        assert np.linalg.norm(step) == pytest.approx(7 / 3.6 / 15, abs=1e-3)
        assert step[2] < 0 < step[1]
