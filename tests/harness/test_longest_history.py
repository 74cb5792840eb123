"""Methods that can use more images than they need: as many as there are, and scored on the same images."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from bench.harness import FramePipeline, read_image_maps, read_tables
from bench.methods import Method, Segmentation
from bench.recordings import load_card, open_dataset, read_image
from tests.support.runs import PAPER, score


class Greedy(Method):
    name, longest_history = "greedy", 3

    def __init__(self):
        self.seen = []

    def __deepcopy__(self, memo):
        return self  # the test looks at what the copy of a unit saw

    def segment(self, frame):
        assert len(frame.images) == len(frame.timestamps_ns) == len(frame.current_from_previous) + 1
        self.seen.append(len(frame.images))
        return Segmentation(cell_size_px=1, mask=np.zeros(frame.valid.shape, bool))


def images_seen(card, indices):
    recording = next(h for h in open_dataset(load_card(str(card))) if h.name == "crossing").open()
    method = Greedy()
    pipeline = FramePipeline(recording, "front", method=method, protocol=PAPER)
    for index in indices:
        pipeline.process(index)
    return method.seen


def image_file(card: Path, index: int) -> Path:
    return sorted((card.parent / "data/tiny/crossing/images/front").iterdir())[index]


def test_as_many_images_as_there_are_up_to_the_longest(tiny_card):
    assert images_seen(tiny_card, [1, 2, 3, 4]) == [2, 3, 4, 4]
    assert images_seen(tiny_card, [4]) == [4]  # wherever a drive is entered


def test_an_older_image_that_cannot_be_read_shortens_what_is_seen(own_card):
    image_file(own_card, 1).write_bytes(b"no picture")
    assert images_seen(own_card, [3, 4]) == [2, 3]


def test_every_image_file_is_read_once(own_card, monkeypatch):
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
def test_chunks_give_the_same_tables_and_maps(tiny_card, tmp_path, monkeypatch, name):
    def found(out):
        score(tiny_card, tmp_path / out, method=name)
        key = lambda row: (row["recording"], row["timestamp_ns"], row.get("track_id") or "")  # noqa: E731
        rows = [sorted(table.to_pylist(), key=key) for table in read_tables(tmp_path / out)]
        (image_map,) = read_image_maps(tmp_path / out / "paper-v1").values()
        return *rows, image_map.false_px.tolist(), image_map.missed_px.tolist()

    whole = found("whole")
    monkeypatch.setattr("bench.harness.tasks.TASK_IMAGES", 1)
    assert found("chunks") == whole
    assert len(list((tmp_path / "chunks" / "answers").rglob("*.parquet"))) == len(whole[1]) == 12
