"""What a method is handed: images, calibration and ego-motion, as many images as it can use, errors if it is to."""

from collections import Counter
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from bench.errors import DataError, UsageError
from bench.harness.frames import FramePipeline
from bench.harness.stored import read_run
from bench.methods import Method, MethodInput, Segmentation
from bench.recordings import load_card, open_dataset, read_image
from bench.recordings.input_errors import named_input_errors
from bench.records.recording import InputErrors
from tests.support import runs
from tests.support.counts import read_tables
from tests.support.runs import IMAGES, PAPER


class Spy(Method):
    """Keeps what it is given."""

    name = "spy"

    def __init__(self, *, history=1, longest_history=1, colour=False):
        self.history, self.longest_history, self.colour, self.seen = history, longest_history, colour, []

    def __deepcopy__(self, memo):
        return self  # the test looks at what the copy of a task saw

    def segment(self, frame):
        assert len(frame.images) == len(frame.timestamps_ns) == len(frame.current_from_previous) + 1
        self.seen.append(frame)
        return Segmentation(cell_size_px=1, mask=np.zeros(frame.valid.shape, bool))


def seen_by(card, indices, **looks):
    """What a method is given at these images."""
    recording = next(handle for handle in open_dataset(load_card(str(card))) if handle.name == "crossing").open()
    method = Spy(**looks)
    pipeline = FramePipeline(recording, "front", method=method, protocol=PAPER)
    for index in indices:
        pipeline.process(index)
    return method.seen


def images_seen(card, indices):
    return [len(frame.images) for frame in seen_by(card, indices, longest_history=3)]


def test_history_colour_and_ego_motion_arrive_and_nothing_else(tiny_card):
    before, given = seen_by(tiny_card, [2, 3], history=2, colour=True)
    names = "images timestamps_ns camera road current_from_previous valid rolling_shutter recording camera_name"
    assert {field.name for field in fields(MethodInput)} == set(names.split())
    assert [image.shape for image in given.images] == [(240, 320, 3)] * 3
    np.testing.assert_array_equal(given.images[0], before.images[1])
    steps = [motion.translation_m for motion in given.current_from_previous]
    assert len(steps) == 2
    # 7 km/h at 15 images per second, straight ahead and seen by a camera pitched 20 degrees down: the previous
    # place lies behind (z < 0) and, in camera axes, below (y > 0).
    for step in steps:
        assert np.linalg.norm(step) == pytest.approx(7 / 3.6 / 15, abs=1e-3)
        assert step[2] < 0 < step[1]


def image_file(card: Path, index: int) -> Path:
    return sorted((card.parent / "data/tiny/crossing/images/front").iterdir())[index]


def test_as_many_images_as_there_are_up_to_the_longest(tiny_card):
    assert images_seen(tiny_card, [1, 2, 3, 4]) == [2, 3, 4, 4]
    assert images_seen(tiny_card, [4]) == [4]  # wherever a drive is entered


def test_an_older_image_that_cannot_be_read_shortens_what_is_seen_and_every_file_is_read_once(own_card, monkeypatch):
    image_file(own_card, 1).write_bytes(b"no picture")
    read = Counter()

    def counted(image, camera, *, colour):
        read[image.path.name] += 1
        return read_image(image, camera, colour=colour)

    monkeypatch.setattr("bench.harness.frames.read_image", counted)
    assert images_seen(own_card, [3, 4]) == [2, 3]
    assert set(read.values()) == {1}
    assert len(read) == 4


def test_a_gap_shortens_what_is_seen(own_card):
    image_file(own_card, 2).unlink()  # the images after it are now numbers 2 and 3, with a gap before the first
    assert images_seen(own_card, [1, 3]) == [2, 2]


@pytest.mark.parametrize("name", ["spherical", "background-subtraction"])
def test_chunks_give_the_same_tables(tiny_card, tmp_path, monkeypatch, name):
    def found(out):
        runs.score(tiny_card, tmp_path / out, method=name)
        key = lambda row: (row["recording"], row["timestamp_ns"], row.get("track_id") or "")  # noqa: E731
        return [sorted(table.to_pylist(), key=key) for table in read_tables(tmp_path / out)]

    whole = found("whole")
    monkeypatch.setattr("bench.harness.run.TASK_IMAGES", 1)
    assert found("chunks") == whole
    assert len(list((tmp_path / "chunks" / "answers").rglob("*.parquet"))) == len(whole[1]) == 12


# ---- errors of what a method is told reach the method alone


def test_a_run_with_errors_is_none_without_and_has_the_same_reference(tiny_card, tmp_path):
    """Answers and data are told apart, and a reader is told of the errors."""

    def score(overwrite=True, **errors):
        options = {"input_errors": named_input_errors(errors), "overwrite": overwrite}
        return runs.score(tiny_card, tmp_path / "run", **options), read_run(tmp_path / "run").manifest

    given = ({}, {"pitch_rate_degps": 3.0}, {"pitch_rate_degps": 4.0})
    found = [score(**errors) for errors in given]
    plain, *wrong = (summary for summary, _ in found)
    assert [summary.provenance.images_asked for summary, _ in found] == [IMAGES] * 3
    assert tuple(manifest.dataset.input_errors for _, manifest in found) == given
    assert len({summary.all_moving.model_dump_json() for summary, _ in found}) == 3
    assert wrong[1].caveats.endswith("The method was told errors of its input: pitch_rate_degps 4.")
    assert plain.caveats == load_card(str(tiny_card)).content.caveats
    assert wrong[1].false_positives.coverage.value > plain.false_positives.coverage.value + 0.1
    assert len({(manifest.reference, manifest.method.model_dump_json()) for _, manifest in found}) == 1
    with pytest.raises(DataError, match="pitch_rate_degps = 3"):
        score(overwrite=False, pitch_rate_degps=3.0)
    assert score()[0].model_dump_json(exclude={"provenance"}) == plain.model_dump_json(exclude={"provenance"})


def test_errors_are_finite_numbers():
    assert named_input_errors({"pitch_deg": 1}) == InputErrors(pitch_deg=1.0)
    for error in (True, float("nan"), float("inf")):
        with pytest.raises(UsageError, match="input error pitch_deg: expected a number, got "):
            named_input_errors({"pitch_deg": error})
