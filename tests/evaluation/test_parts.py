"""A run reduced in parts: neither the order of the rows nor the size of the parts changes a byte."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from bench.evaluation import (
    Rows,
    changes_in_parts,
    coverage_curves,
    object_changes,
    range_maps,
    recording_sums,
    summarise,
    threshold_sweep,
)
from bench.evaluation.maps import THRESHOLDS
from bench.evaluation.row_source import ChosenRows, Columns, TableRows, group_recordings
from bench.harness import StoredRows, open_tables
from tests.evaluation.runs import PAPER, random_run, shuffled
from tests.support.large_runs import write_tables

Tables = tuple[Rows, Rows]


def reduced(tables: Tables, rows_at_once: int | None = None) -> tuple[str, str]:
    """Everything that is a sum, as text."""
    options = {"protocol": PAPER, "rows_at_once": rows_at_once}
    return summarise(*tables, **options).model_dump_json(), recording_sums(*tables, **options).model_dump_json()


def stored(tables: tuple[pa.Table, pa.Table], folder: Path, *, row_group_size: int) -> tuple[StoredRows, StoredRows]:
    for name, table in zip(("objects", "frames"), tables, strict=True):
        pq.write_table(table, folder / f"{name}.parquet", row_group_size=row_group_size)
    return open_tables(folder)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("rows_at_once", [1, 30, 10_000])
def test_the_size_of_the_parts_changes_no_byte(seed: int, rows_at_once: int) -> None:
    tables = random_run(seed)
    assert reduced(tables, rows_at_once) == reduced(tables)


@pytest.mark.parametrize("row_group_size", [7, 100, 10_000])
def test_stored_and_shuffled_rows_change_no_byte(tmp_path: Path, row_group_size: int) -> None:
    tables = random_run(3)
    turned = shuffled(tables[0], 1), shuffled(tables[1], 2)
    kept = stored(turned, tmp_path, row_group_size=row_group_size)
    assert reduced(kept, 25) == reduced(tables)
    assert kept[0].table() == turned[0]


def test_rows_without_order_give_the_same_curves_and_maps(tmp_path: Path) -> None:
    write_tables(tmp_path, recordings=3, images=60, seed=1)
    in_order = open_tables(tmp_path)
    (tmp_path / "turned").mkdir()
    tables = (shuffled(in_order[0].table(), 1), shuffled(in_order[1].table(), 2))
    turned = stored(tables, tmp_path / "turned", row_group_size=50)
    one, other = threshold_sweep(in_order[1]), threshold_sweep(turned[1])
    assert one is not None
    assert other is not None
    assert one.auprc == other.auprc
    assert np.array_equal(one.false_positive_coverage, other.false_positive_coverage)
    maps = [range_maps(rows[0], protocol=PAPER).maps for rows in (in_order, turned)]
    assert all(np.array_equal(a.detected, b.detected) for a, b in zip(*maps, strict=True))
    assert reduced(in_order) == reduced(turned, 100)


def test_a_recording_is_never_cut() -> None:
    counts = {"c": 5, "a": 3, "b": 4, "d": 1, "e": 1}
    assert group_recordings(counts, rows_at_once=4) == [("a",), ("b",), ("c",), ("d", "e")]
    assert group_recordings(counts, rows_at_once=100) == [("a", "b", "c", "d", "e")]
    assert group_recordings({}) == []


def test_the_same_row_in_two_groups_of_rows_is_our_own_mistake(tmp_path: Path) -> None:
    objects, frames = random_run(4)
    twice = pa.concat_tables([objects, objects.slice(5, 1)])
    with pytest.raises(AssertionError, match="names each row once"):
        reduced(stored((twice, frames), tmp_path, row_group_size=10), 20)


def test_an_object_that_is_neither_scored_nor_ignored_for_a_reason_is_our_own_mistake() -> None:
    objects, frames = random_run(4)
    place = objects["status"].to_pylist().index("ignored")
    reasons = objects["reason"].to_pylist()
    reasons[place] = "no such reason"
    lost = objects.set_column(objects.schema.names.index("reason"), "reason", pa.array(reasons, pa.string()))
    with pytest.raises(AssertionError, match="evaluated, static or ignored"):
        reduced((lost, frames), 30)


def test_chosen_rows_are_those_of_a_filtered_table() -> None:
    objects, frames = random_run(5)
    filtered = objects.filter(pa.compute.equal(objects["category"], "crossing"))
    chosen = ChosenRows(TableRows(objects), column="category", word="crossing")
    assert reduced((chosen, frames), 20) == reduced((filtered, frames))
    assert chosen.distinct("category") == ("crossing",)


def test_changes_in_parts_are_those_of_the_whole() -> None:
    (before, _), (after, _) = random_run(1), random_run(2)
    parts = list(changes_in_parts(shuffled(before, 1), shuffled(after, 2), rows_at_once=25))
    assert len(parts) > 1
    assert pa.concat_tables(parts).combine_chunks() == object_changes(before, after).combine_chunks()


def test_coverage_curves_count_at_least() -> None:
    objects, _ = random_run(6)
    rows = [r for r in objects.to_pylist() if r["status"] == "evaluated" and r["category"] == "crossing"]
    found, chance = coverage_curves(shuffled(objects, 3), protocol=PAPER)["crossing"]
    covered = np.array([r["tp"] / (r["tp"] + r["fn"]) for r in rows])
    assert found.object_frames == len(rows) > 0
    assert found.at_least[0] == np.count_nonzero(covered > 0)
    assert found.at_least[1:].tolist() == [np.count_nonzero(covered >= level) for level in THRESHOLDS[1:]]
    assert chance.object_frames == sum(r["chance_tp"] is not None for r in rows)


def test_codes_compare_as_their_words_do() -> None:
    words = ["b", None, "a", "ä", "b", "Z"]
    codes, found = Columns(pa.table({"w": pa.chunked_array([words[:2], words[2:]])})).words("w")
    assert [None if code < 0 else found[code] for code in codes.tolist()] == words
    assert list(found) == sorted(found)
