"""Image maps in the files of a run."""

import numpy as np
import pytest
from bench.harness.unit_files import image_maps_bytes, load_image_maps

from bench.errors import DataError
from bench.evaluation import ImageMap
from bench.harness import read_image_maps, read_tables
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


def test_a_runs_maps_sum_to_its_frames(tiny_card, tmp_path):
    score(tiny_card, tmp_path / "run")
    (found,) = read_image_maps(tmp_path / "run").values()
    _, frames = read_tables(tmp_path / "run")
    assert (found.width, found.height, found.frames) == (320, 240, 12)
    assert found.reference_px.shape == (30, 40)
    for name, column in (("reference_px", "reference_px"), ("missed_px", "fn_px"), ("false_px", "fp_px")):
        assert getattr(found, name).sum() == sum(frames[column].to_pylist()) > 0


def test_maps_of_an_older_run_do_not_stay_behind(tiny_card, tmp_path):
    score(tiny_card, tmp_path / "run", method="everything")
    score(tiny_card, tmp_path / "run", method="nothing", split="moving", overwrite=True)
    (found,) = read_image_maps(tmp_path / "run").values()
    assert found.frames == 8
    assert found.false_px.sum() == 0
    np.testing.assert_array_equal(found.missed_px, found.reference_px)


def test_maps_survive_their_file(tmp_path):
    maps = [image_map("front"), image_map("rear/left ü", width=33, seed=1)]
    (tmp_path / "maps.npz").write_bytes(image_maps_bytes(maps))
    for one, other in zip(maps, load_image_maps(tmp_path / "maps.npz"), strict=True):
        assert_equal(one, other)


def test_a_camera_of_several_sizes_has_a_map_of_each(tmp_path):
    (tmp_path / "image_maps.npz").write_bytes(image_maps_bytes([image_map(), image_map(width=64), image_map("left")]))
    assert list(read_image_maps(tmp_path)) == ["front, 20 x 9", "front, 64 x 9", "left"]


def test_missing_and_damaged_maps_are_named(tmp_path):
    with pytest.raises(DataError, match=r"image_maps\.npz: expected the image maps of a run, got no such file"):
        read_image_maps(tmp_path)
    file = tmp_path / "image_maps.npz"
    file.write_bytes(image_maps_bytes([image_map()]))
    whole = file.read_bytes()
    for damaged in (b"", b"words", whole[:200], whole[:-40]):
        file.write_bytes(damaged)
        with pytest.raises(DataError, match=r"image_maps\.npz: expected the image maps"):
            read_image_maps(tmp_path)
    np.savez(file, index=np.array('[{"camera": "front"}]'))
    with pytest.raises(DataError, match=r"image_maps\.npz"):
        read_image_maps(tmp_path)
