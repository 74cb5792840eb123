"""Image maps in the files of a run."""

import numpy as np
import pytest

from bench.errors import DataError
from bench.evaluation import FRAMES_SCHEMA, OBJECTS_SCHEMA, ImageMap
from bench.harness import read_image_maps
from bench.harness.counts import counts_folder, write_counts
from tests.support.runs import score

GRIDS = ("reference_px", "missed_px", "false_px")


def image_map(camera="front", *, width=20, height=9, seed=0) -> ImageMap:
    draw = np.random.default_rng(seed)
    grids = {name: draw.integers(0, 2**40, (-(-height // 8), -(-width // 8))) for name in GRIDS}
    return ImageMap(camera=camera, width=width, height=height, cell_px=8, frames=7, **grids)


def assert_equal(one: ImageMap, other: ImageMap) -> None:
    for name in ("camera", "width", "height", "cell_px", "frames"):
        assert getattr(one, name) == getattr(other, name)
    for name in GRIDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        assert getattr(other, name).dtype == np.int64


def test_maps_of_an_older_run_do_not_stay_behind(tiny_card, tmp_path):
    score(tiny_card, tmp_path / "run", method="everything")
    score(tiny_card, tmp_path / "run", method="nothing", split="moving", overwrite=True)
    (found,) = read_image_maps(tmp_path / "run" / "paper-v1").values()
    assert found.frames == 8
    assert found.false_px.sum() == 0
    np.testing.assert_array_equal(found.missed_px, found.reference_px)


def store(results, *maps):
    empty = OBJECTS_SCHEMA.empty_table(), FRAMES_SCHEMA.empty_table()
    for number, one in enumerate(maps):
        write_counts(counts_folder(results, "drive"), f"front-{number:08d}", *empty, one)
    return results / "counts" / "drive" / "front-00000000.map.npz"


def test_maps_survive_their_files_and_are_added_by_camera_and_size(tmp_path):
    other = image_map("rear/left ü", width=33, seed=1)
    store(tmp_path, image_map("front"), other, image_map("front"))
    front, left = read_image_maps(tmp_path).values()
    assert_equal(image_map("front") + image_map("front"), front)
    assert_equal(other, left)


def test_a_camera_of_several_sizes_has_a_map_of_each(tmp_path):
    store(tmp_path, image_map(), image_map(width=64), image_map("left"))
    assert list(read_image_maps(tmp_path)) == ["front, 20 x 9", "front, 64 x 9", "left"]


def test_damaged_maps_are_named(tmp_path):
    assert read_image_maps(tmp_path) == {}
    file = store(tmp_path, image_map())
    whole = file.read_bytes()
    for damaged in (b"", b"words", whole[:200], whole[:-40]):
        file.write_bytes(damaged)
        with pytest.raises(DataError, match=r"map\.npz: expected where in the image a run was right and wrong"):
            read_image_maps(tmp_path)
    np.savez(file, camera=np.array("front"))
    with pytest.raises(DataError, match=r"map\.npz"):
        read_image_maps(tmp_path)
