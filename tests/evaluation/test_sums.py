"""The table of sums: to check by hand, in parts, and as a file; maps of the same rows."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from bench.errors import DataError
from bench.evaluation.maps import RangeMap, RangeMaps, range_maps
from bench.evaluation.rows import to_frame
from bench.evaluation.sums import KEY, read_sums, sum_run, write_sums
from bench.harness import counts
from bench.harness.counts import read_parts
from bench.records.reference import Direction
from tests.evaluation.frames import ignored_object, mask, picture, reference_frame, reference_object, static_object
from tests.evaluation.runs import PAPER, joined, random_run, random_sums, scored, shuffled
from tests.support.counts import write_counts
from tests.support.result_rows import evaluated


def reduced(tables: tuple[pa.Table, pa.Table]) -> pd.DataFrame:
    return sum_run(*([to_frame(table)] for table in tables), protocol=PAPER)


def in_order(sums: pd.DataFrame) -> pd.DataFrame:
    return sums.sort_values(KEY, ignore_index=True)


def assert_same(one: pd.DataFrame, other: pd.DataFrame) -> None:
    pd.testing.assert_frame_equal(in_order(one), in_order(other), check_dtype=False, rtol=1e-12, atol=1e-12)


def of(sums: pd.DataFrame, breakdown: str, name: str, metric: str) -> dict[str, tuple[float, float]]:
    """Numerator and denominator by recording."""
    rows = sums[(sums["breakdown"] == breakdown) & (sums["slice"] == name) & (sums["metric"] == metric)]
    return {row.recording: (row.numerator, row.denominator) for row in rows.itertuples()}


def total(sums: pd.DataFrame, breakdown: str, name: str, metric: str) -> float:
    return sum(numerator for numerator, _ in of(sums, breakdown, name, metric).values())


def test_sums_and_counts_to_check_by_hand() -> None:
    objects = [reference_object("a"), static_object("s"), ignored_object("i")]
    one = reference_frame(picture("11..\n11.."), objects=objects, recording="one")
    two = reference_frame(picture("1111"), recording="two")
    sums = reduced(joined([scored([(one, mask(".x..\n.x.x"))]), scored([(two, mask("...."))])]))
    crossing = ("category", "crossing")
    assert of(sums, *crossing, "detection_rate") == {"one": (1, 1), "two": (0, 1)}
    assert of(sums, *crossing, "tpr") == {"one": (0.5, 1), "two": (0, 0)}
    assert of(sums, *crossing, "tpr_all") == {"one": (0.5, 1), "two": (0, 1)}
    assert of(sums, "frames", "frames", "false_positive_coverage") == {"one": (1 / 8, 1), "two": (0, 1)}
    assert of(sums, "frames", "frames", "segmentation_iou") == {"one": (2, 5), "two": (0, 4)}
    assert of(sums, "category", "overtaking", "iou") == {}
    assert of(sums, "all_moving", "all_moving", "tracks") == {"one": (1, 1), "two": (1, 1)}
    assert {name: total(sums, "status", name, "annotated") for name in ("evaluated", "static", "ignored")} == {
        "evaluated": 2, "static": 1, "ignored": 1,
    }  # fmt: skip
    assert total(sums, "status", "evaluated", "images") == total(sums, "camera", "front", "images") == 2


def test_an_object_of_unknown_speed_is_in_no_bin_of_speed() -> None:
    objects = [reference_object("a", speed_mps=math.nan), reference_object("b", speed_mps=1.0)]
    sums = reduced(scored([(reference_frame(picture("12"), objects=objects), mask("xx"))]))
    slices = sums.groupby("breakdown")["slice"].unique()
    assert [*slices["speed_mps"], *slices["class_and_speed"]] == ["[0, 1.5)", "pedestrian, [0, 1.5)"]


def test_a_track_in_two_cameras_is_one_object() -> None:
    frames = [reference_frame(picture("1."), camera=camera) for camera in ("front", "left")]
    sums = reduced(joined([scored([(frame, mask("x."))]) for frame in frames]))
    assert of(sums, "category", "crossing", "tracks") == {"drive": (1, 2)}
    assert of(sums, "camera", "left", "tracks") == {"drive": (1, 1)}


def test_a_cause_that_a_recordings_images_do_not_name_has_none_of_its_pixels_but_is_a_share_of_all() -> None:
    _, frames = random_run(3)
    kind = frames.schema.field("fp_by_cause").type
    causes = [[("static", px)] if name == "drive-0" else list(found) for name, px, found in zip(
        *(frames[column].to_pylist() for column in ("recording", "fp_px", "fp_by_cause")), strict=True)]  # fmt: skip
    place = frames.schema.names.index("fp_by_cause")
    sums = reduced((random_run(3)[0], frames.set_column(place, "fp_by_cause", pa.array(causes, kind))))
    of_static, of_depth = (of(sums, "frames", "frames", f"false_positives_by_{name}") for name in ("static", "depth"))
    assert {name: below for name, (_, below) in of_static.items()} == {n: below for n, (_, below) in of_depth.items()}
    assert of_depth["drive-0"][0] == of_static["drive-1"][0] == 0
    assert of_static["drive-0"][0] == of_static["drive-0"][1] > 0


def test_stored_rows_in_any_order_and_in_parts_give_the_same(tmp_path: Path) -> None:
    tables = random_run(3)
    disordered = shuffled(tables[0], 1), shuffled(tables[1], 2)
    assert_same(reduced(disordered), random_sums(3))
    write_counts(tmp_path, *disordered)
    parts = [[*read_parts(tmp_path, table, rows_at_once=30)] for table in counts.TABLES]
    assert [len(part) > 1 for part in parts] == [True, True]
    assert [sum(map(len, part)) for part in parts] == [len(table) for table in tables]
    assert_same(sum_run(*parts, protocol=PAPER), random_sums(3))


def test_a_table_of_sums_survives_its_file(tmp_path: Path) -> None:
    sums = random_sums(3)
    write_sums(sums, tmp_path / "sums.csv")
    pd.testing.assert_frame_equal(read_sums(tmp_path / "sums.csv"), in_order(sums), check_dtype=False, check_exact=True)
    write_sums(sums.sample(frac=1, random_state=1), tmp_path / "again.csv")
    assert (tmp_path / "again.csv").read_bytes() == (tmp_path / "sums.csv").read_bytes()


GOOD = "breakdown,slice,recording,metric,numerator,denominator\nframes,frames,NA,recall,1.0,2.0\n"

NUMBERS = "each key once, with terms from 0 to 1e+15"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected a table of sums with the columns breakdown, slice"),
        ("a,b\n1,2\n", "got a, b"),
        (GOOD.replace("1.0", "one"), "expected a table of sums"),
        *[(GOOD.replace("1.0", number), f"line 2: expected {NUMBERS}") for number in ("nan", "inf", "-1.0", "1e308")],
        (GOOD.replace("recall", "recal"), "metric: expected known metrics, got 'recal'"),
        (GOOD + GOOD.splitlines()[1] + "\n", f"line 3: expected {NUMBERS}"),
    ],
)
def test_what_is_no_table_of_sums_is_refused(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "sums.csv"
    file.write_text(GOOD)
    assert read_sums(file).loc[0, "recording"] == "NA"
    file.write_text(text)
    with pytest.raises(DataError) as refused:
        read_sums(file)
    assert message in str(refused.value)
    assert str(file) in str(refused.value)
    assert not message.startswith("line 2") or "got frames, frames, NA, " in str(refused.value)
    file.write_bytes(bytes(range(256)))
    for damaged in (file, tmp_path / "missing.csv"):
        with pytest.raises(DataError, match=damaged.name):
            read_sums(damaged)


# Maps of the detection rate by place.


def map_of(found: RangeMaps, object_class: str, direction: Direction) -> RangeMap:
    return next(m for m in found.maps if (m.object_class, m.direction) == (object_class, direction))


def placed(*places_m: tuple[float, float]) -> pd.DataFrame:
    """Pedestrians at these places; the first alone is detected."""
    objects = [reference_object(chr(97 + k), centroid_m=np.array(place)) for k, place in enumerate(places_m)]
    labels = np.arange(1, len(places_m) + 1, dtype=np.int32)[None]
    return evaluated(scored([(reference_frame(labels, objects=objects), labels == 1)])[0])


def test_cells_are_half_open_and_counted_from_the_vehicle() -> None:
    found = range_maps([placed((3.0, -0.5), (3.99, -1.0), (4.0, -0.5))], protocol=PAPER)
    lateral = map_of(found, "pedestrian", Direction.LATERAL)
    assert lateral.edges_m.tolist() == list(range(-8, 9))
    ahead, right = 3 + 8, -1 + 8
    assert lateral.object_frames[ahead, right] == 2
    assert lateral.rate[ahead, right] == 0.5
    assert lateral.object_frames[ahead + 1, right] == 1
    assert lateral.object_frames.sum() == 3
    assert np.isnan(lateral.rate[0, 0])
    far = range_maps([placed((11.0, 0.0))], protocol=PAPER)
    assert far.maps[0].edges_m[-1] == 12.0, "the grid grows to the furthest object"


def test_a_cell_with_few_object_frames_is_marked() -> None:
    found = range_maps([placed(*[(2.5, 1.5)] * 5, *[(5.5, 1.5)] * 4)], protocol=PAPER)
    assert np.argwhere(map_of(found, "pedestrian", Direction.LATERAL).enough).tolist() == [[2 + 8, 1 + 8]]


@pytest.mark.parametrize("seed", range(3))
def test_no_object_frame_is_lost(seed: int) -> None:
    objects = random_run(seed)[0]
    found = range_maps([evaluated(objects)], protocol=PAPER)
    expected = sum(status == "evaluated" for status in objects["status"].to_pylist())
    assert sum(int(m.object_frames.sum()) for m in found.maps) + found.unplaced == expected
