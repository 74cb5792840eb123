"""Detection rate by place."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from bench.evaluation.maps import RangeMap, RangeMaps, range_maps
from bench.records.reference import Direction
from tests.evaluation.frames import mask, picture, reference_frame, reference_object
from tests.evaluation.runs import PAPER, random_run, scored


def map_of(found: RangeMaps, object_class: str, direction: Direction) -> RangeMap:
    return next(m for m in found.maps if (m.object_class, m.direction) == (object_class, direction))


def placed(*places_m: tuple[float, float]) -> pa.Table:
    """Pedestrians at these places; the first alone is detected."""
    objects = [reference_object(chr(97 + k), centroid_m=np.array(place)) for k, place in enumerate(places_m)]
    labels = np.arange(1, len(places_m) + 1, dtype=np.int32)[None]
    return scored([(reference_frame(labels, objects=objects), labels == 1)])[0]


def test_cells_are_half_open_and_counted_from_the_vehicle() -> None:
    found = range_maps(placed((3.0, -0.5), (3.99, -1.0), (4.0, -0.5)), protocol=PAPER)
    lateral = map_of(found, "pedestrian", Direction.LATERAL)
    assert lateral.edges_m.tolist() == list(range(-8, 9))
    ahead, right = 3 + 8, -1 + 8
    assert lateral.object_frames[ahead, right] == 2
    assert lateral.rate[ahead, right] == 0.5
    assert lateral.object_frames[ahead + 1, right] == 1
    assert lateral.object_frames.sum() == 3
    assert np.isnan(lateral.rate[0, 0])


def test_a_cell_with_few_object_frames_is_marked() -> None:
    lateral = map_of(
        range_maps(placed(*[(2.5, 1.5)] * 5, *[(5.5, 1.5)] * 4), protocol=PAPER), "pedestrian", Direction.LATERAL
    )
    assert np.argwhere(lateral.enough).tolist() == [[2 + 8, 1 + 8]]


def test_the_grid_grows_to_the_furthest_object() -> None:
    found = range_maps(placed((11.0, 0.0)), protocol=PAPER)
    assert found.maps[0].edges_m[-1] == 12.0


def test_a_map_for_every_class_and_direction() -> None:
    found = range_maps(random_run(1)[0], protocol=PAPER)
    kinds = [(m.object_class, m.direction) for m in found.maps]
    assert kinds == [(name, direction) for name in PAPER.reference.classes for direction in Direction]


@pytest.mark.parametrize("seed", range(3))
def test_no_object_frame_is_lost(seed: int) -> None:
    objects = random_run(seed)[0]
    found = range_maps(objects, protocol=PAPER)
    evaluated = sum(status == "evaluated" for status in objects["status"].to_pylist())
    assert sum(int(m.object_frames.sum()) for m in found.maps) + found.unplaced == evaluated


def test_an_empty_run_has_empty_maps() -> None:
    found = range_maps(scored([(reference_frame(picture("..")), mask(".."))])[0], protocol=PAPER)
    assert all(m.object_frames.sum() == 0 for m in found.maps)
