"""A leaderboard: which runs stand in one table, who is best, what bounds them; its files, chart and page."""

import json

import pytest

from bench.errors import DataError
from bench.harness.exact import ORACLES
from bench.methods import build_method
from bench.methods.registry import METHODS
from bench.reporting.leaderboard import (
    NAMES,
    leaderboard_tables,
    read_leaderboard,
    with_shipped,
    write_leaderboard,
)
from bench.reporting.run_tables import SWEEP
from tests.reporting.compare.runs import drawn, write_run
from tests.reporting.printed import printed
from tests.support.counts import counts_file, write_seconds
from tests.support.stored_files import change_summary


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    runs = tmp_path_factory.mktemp("runs")
    write_run(runs / "weak", drawn(20), settings={"threshold": 2})
    write_run(runs / "deep" / "strong", drawn(80), settings={"threshold": 1})
    write_run(runs / "nothing", drawn(0), method="empty")
    write_run(runs / "extended", drawn(50), protocol="extended-v1")
    write_run(runs / "other-reference", drawn(50), region_px=90)
    write_run(runs / "broken", drawn(50))
    counts_file(runs / "broken" / "paper-v1", "objects").write_bytes(b"PAR1")
    write_run(runs / "unfinished", drawn(50))
    (runs / "unfinished" / "paper-v1" / "summary.json").unlink()
    return runs


def test_groups_hold_only_what_compares_best_first(folder):
    found = read_leaderboard(folder)
    names = sorted([entry.run for entry in group.entries] for group in found.groups)
    assert names == [["deep/strong", "weak", "nothing"], ["extended"], ["other-reference"]]
    (group,) = [group for group in found.groups if len(group.entries) == 3]
    values = [entry.metrics["iou"].value for entry in group.entries]
    assert values == sorted(values, reverse=True)
    assert [(entry.method, entry.key) for entry in group.entries] == [
        ("nothing, threshold=1", "nothing"), ("nothing, threshold=2", "nothing"), ("empty", "own:Own")
    ]  # fmt: skip
    assert (group.entries[0].cost_ms, group.entries[0].kind) == (None, "method")
    assert (group.entries[0].date, group.entries[0].code) == ("2026-01-02", "0 0123456789+")


def test_values_of_a_sweep_are_no_entries_but_of_their_own_folder(tmp_path):
    write_run(tmp_path / "run", drawn(50))
    sweep = tmp_path / "sweeps" / "error.speed"
    write_run(sweep / "10", drawn(20))
    write_run(sweep / "0", drawn(50))
    (sweep / SWEEP).touch()
    for place, runs in ((tmp_path, ["run"]), (sweep, ["0", "10"])):
        (group,) = read_leaderboard(place).groups
        assert [entry.run for entry in group.entries] == runs


def test_damaged_and_unfinished_runs_are_listed_with_their_fault(folder, tmp_path):
    found = read_leaderboard(folder)
    faults = dict(found.not_ranked)
    assert set(faults) == {"broken/paper-v1", "unfinished/paper-v1"}
    assert "objects.parquet" in faults["broken/paper-v1"]
    assert faults["unfinished/paper-v1"] == "not finished; the same `fisheye-bench run` goes on from there"
    write_leaderboard(found, tmp_path)
    for name in ("leaderboard.md", "leaderboard.json", "index.html"):
        assert "broken/paper-v1" in (tmp_path / name).read_text()


def test_a_run_without_a_scored_image_has_no_rank(tmp_path):
    change_summary(write_run(tmp_path / "failed", drawn(50)), lambda summary: summary["images"].update(evaluated=0))
    write_run(tmp_path / "run", drawn(50))
    found = read_leaderboard(tmp_path)
    assert found.not_ranked == (("failed/paper-v1", "no image of it was scored"),)
    assert [entry.run for group in found.groups for entry in group.entries] == ["run"]


def test_the_files_carry_the_same_numbers_and_the_same_bytes(folder, tmp_path):
    files = write_leaderboard(read_leaderboard(folder), tmp_path / "one")
    again = write_leaderboard(read_leaderboard(folder), tmp_path / "two")
    assert [file.read_bytes() for file in files] == [file.read_bytes() for file in again]
    page, content, markdown = (file.read_text() for file in files)
    groups = json.loads(content)["groups"]
    assert 0.8 in [group["entries"][0]["values"]["crossing"]["tpr_all"]["value"] for group in groups]
    assert markdown.count("\n## demo, all recordings, ") == 3
    assert "| 2 | nothing, threshold=2<br>--method nothing<br>weak | 18.2 %<br>[" in markdown
    assert "<strong>18.2 %</strong>" in page
    assert "//" not in page.replace("http://www.w3.org", "").partition("<script>")[0], "no network"


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    """Two methods with their costs, an oracle and the exact masks, by the protocol that judges."""
    runs = tmp_path_factory.mktemp("judged")
    told = {"sees_the_truth": True, "cell_size_px": 1}
    exact = write_run(runs / "exact", drawn(95), protocol="surface-v1", method="truth", settings=told, fp_px=0)
    write_run(runs / "cells", drawn(90), protocol="surface-v1", method="truth", settings=told | {"cell_size_px": 5})
    for name, px, ms in (("cheap", 40, 2.0), ("good", 70, 80.0)):
        folder = write_run(runs / name, drawn(px), protocol="surface-v1", method=name)
        write_seconds(folder, ms / 1e3)
    (exact / "surface-v1" / "index.html").touch()
    return runs


def test_what_sees_the_truth_is_no_method_and_bounds_them(judged):
    (group,) = read_leaderboard(judged).groups
    assert [(entry.run, entry.kind) for entry in group.entries] == [
        ("good", "method"),
        ("cheap", "method"),
        ("exact", "ceiling"),
        ("cells", "oracle"),
    ]
    assert [entry.run for entry in group.methods] == ["good", "cheap"]
    assert group.ceilings["crossing"]["tpr_all"] == 0.95
    assert group.ceilings["all_moving"]["false_positive_coverage"] == 0
    assert [entry.cost_ms for entry in group.methods] == pytest.approx([80.0, 2.0])


def test_the_page_says_who_is_best_and_what_bounds_it(judged, tmp_path):
    page, *_ = write_leaderboard(read_leaderboard(judged), tmp_path)
    text = page.read_text()
    for told in ("<small>best</small>", "<strong>63.6 %</strong>", "<strong>86.4 %</strong>", "80.0", "2026-"):
        assert told in text
    assert "Frames with a large false positive" in text
    assert "the exact masks, cell_size_px=1, ceiling<" in text
    assert "surface-v1/index.html" not in text, "pages of runs do not travel with the page"


def test_no_best_method_is_named_of_too_few_recordings(tmp_path):
    few = {key: px for key, px in drawn(50).items() if key[0] < 3}
    for name, times in (("one", 1), ("two", 2)):
        write_run(tmp_path / "runs" / name, {key: px // times for key, px in few.items()}, protocol="surface-v1")
    page, *_ = write_leaderboard(read_leaderboard(tmp_path / "runs"), tmp_path / "out")
    text = page.read_text()
    assert "<small>first</small>" in text
    assert "<small>or 1</small>" in text
    assert "<small>best</small>" not in text


def test_methods_are_named_as_readers_know_them_with_the_settings_that_tell_them_apart(tmp_path):
    defaults = build_method("spherical").settings()
    write_run(tmp_path / "usual", drawn(50), method="spherical", settings=defaults)
    write_run(tmp_path / "dis", drawn(40), method="spherical", settings=defaults | {"flow": "dis"})
    (group,) = read_leaderboard(tmp_path).groups
    assert [entry.method for entry in group.entries] == ["the paper's method", "the paper's method, flow=dis"]
    assert set(NAMES) <= {*METHODS, *ORACLES}


def test_the_terminal_tables_fit(folder):
    shown = printed(leaderboard_tables(read_leaderboard(folder)))
    assert "…" not in shown
    assert "deep/strong" in shown


def test_a_folder_without_runs_is_an_error(tmp_path):
    with pytest.raises(DataError, match="at least one run"):
        read_leaderboard(tmp_path)
    with pytest.raises(DataError, match="no such folder"):
        read_leaderboard(tmp_path / "nowhere")


def test_best_is_only_what_compare_shows_to_be_better_than_each_of_the_others(tmp_path):
    uneven = {key: 90 if key[0] % 2 else 20 for key in drawn(1)}
    for name, px in (("steady", drawn(50)), ("uneven", uneven), ("weak", drawn(5))):
        write_run(tmp_path / name, px, protocol="surface-v1", method=name)
    board = read_leaderboard(tmp_path)
    (group,) = board.groups
    assert [(entry.method, entry.rank, entry.behind) for entry in group.entries] == [
        ("uneven", 1, None), ("steady", 2, False), ("weak", 3, True)
    ]  # fmt: skip
    assert not group.best
    write_leaderboard(board, tmp_path / "board")
    page = (tmp_path / "board" / "index.html").read_text()
    assert (page.count("<small>first</small>"), page.count("<small>or 1</small>"), "best</small>" in page) == (
        2,
        2,
        False,
    )


def test_shipped_rows_stand_beside_what_compares_with_them(judged, tmp_path):
    write_leaderboard(read_leaderboard(judged), tmp_path)
    own = tmp_path / "own"
    write_run(own / "mine", drawn(60), protocol="surface-v1", method="mine")
    write_run(own / "other-reference", drawn(60), protocol="surface-v1", method="mine", region_px=90)
    board = with_shipped(read_leaderboard(own), tmp_path / "leaderboard.json")
    (beside,) = [group for group in board.groups if any(entry.shipped for entry in group.entries)]
    assert [(entry.method, entry.rank, entry.shipped) for entry in beside.entries if entry.kind == "method"] == [
        ("good", 1, True), ("mine", 2, False), ("cheap", 3, True)
    ]  # fmt: skip
    assert [entry.kind for entry in beside.entries[-2:]] == ["ceiling", "oracle"]
    assert beside.entries[0].cost_ms == pytest.approx(80.0)
    assert not beside.best, "shipped rows are not compared in pairs"
    assert "good, shipped" in printed(leaderboard_tables(board))
    again = write_leaderboard(board, tmp_path / "again")
    groups = json.loads((tmp_path / "again" / "leaderboard.json").read_text())["groups"]
    assert {entry["method"] for group in groups for entry in group["entries"]} == {"mine"}, "it is of own runs"
    page = again[0].read_text()
    assert "good, shipped" in page
    assert "<small>or 1</small>" not in page, "nobody has compared it with the first"
    (tmp_path / "leaderboard.json").write_text('{"schema_version": 2}')
    alone = with_shipped(read_leaderboard(own), tmp_path / "leaderboard.json")
    assert not any(entry.shipped for group in alone.groups for entry in group.entries)
