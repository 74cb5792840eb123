import csv
import io
import json

import pytest
from rich.console import Console

from bench.errors import DataError
from bench.harness.sweep import MARK
from bench.reporting.compare.leaderboard import leaderboard_tables, read_leaderboard, write_leaderboard
from tests.reporting.compare.runs import drawn, write_run


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    runs = tmp_path_factory.mktemp("runs")
    write_run(runs / "weak", drawn(20), settings={"threshold": 2})
    write_run(runs / "deep" / "strong", drawn(80), settings={"threshold": 1})
    write_run(runs / "nothing", drawn(0), method="empty")
    write_run(runs / "extended", drawn(50), protocol="extended-v1")
    write_run(runs / "other-reference", drawn(50), region_px=90)
    write_run(runs / "broken", drawn(50))
    (runs / "broken" / "objects.parquet").write_bytes(b"PAR1")
    (runs / "unfinished" / "units").mkdir(parents=True)
    return runs


def test_groups_hold_only_what_compares_best_first(folder):
    found = read_leaderboard(folder)
    names = sorted([entry.run for entry in group.entries] for group in found.groups)
    assert names == [["deep/strong", "weak", "nothing"], ["extended"], ["other-reference"]]
    (group,) = [group for group in found.groups if len(group.entries) == 3]
    values = [entry.metrics["iou"].value for entry in group.entries]
    assert values == sorted(values, reverse=True)
    assert [entry.method for entry in group.entries] == ["nothing (threshold=1)", "nothing (threshold=2)", "empty"]
    assert group.entries[0].frames_per_second == 16
    assert (group.entries[0].date, group.entries[0].code) == ("2026-01-02", "0 01234567+")


def test_values_of_a_sweep_are_no_entries_but_of_their_own_folder(tmp_path):
    write_run(tmp_path / "run", drawn(50))
    sweep = tmp_path / "sweeps" / "error.speed"
    write_run(sweep / "10", drawn(20))
    write_run(sweep / "0", drawn(50))
    (sweep / MARK).touch()
    (group,) = read_leaderboard(tmp_path).groups
    assert [entry.run for entry in group.entries] == ["run"]
    (group,) = read_leaderboard(sweep).groups
    assert [entry.run for entry in group.entries] == ["0", "10"]


def test_damaged_runs_are_listed_with_their_fault(folder, tmp_path):
    found = read_leaderboard(folder)
    faults = dict(found.damaged)
    assert set(faults) == {"broken", "unfinished"}
    assert "objects.parquet" in faults["broken"]
    assert "No such file" in faults["unfinished"]
    write_leaderboard(found, tmp_path)
    assert "- broken: " in (tmp_path / "leaderboard.md").read_text()
    assert [run["run"] for run in json.loads((tmp_path / "leaderboard.json").read_text())["damaged"]] == [
        "broken",
        "unfinished",
    ]


def test_the_files_carry_the_same_numbers_and_the_same_bytes(folder, tmp_path):
    files = write_leaderboard(read_leaderboard(folder), tmp_path / "one")
    again = write_leaderboard(read_leaderboard(folder), tmp_path / "two")
    assert [file.read_bytes() for file in files] == [file.read_bytes() for file in again]
    rows = list(csv.DictReader(io.StringIO(files[1].read_text())))
    (row,) = [r for r in rows if (r["run"], r["figure"]) == ("weak", "tpr_all")]
    assert float(row["value"]) == 0.2
    text = files[0].read_text()
    assert text.count("\n## demo, all recordings, ") == 3
    assert "| weak | nothing (threshold=2) | 32 | 8 | 0.0 [0.0, 31.2] |" in text


def test_the_terminal_tables_fit(folder):
    console = Console(width=110, record=True, file=io.StringIO())
    for table in leaderboard_tables(read_leaderboard(folder)):
        console.print(table)
    shown = console.export_text()
    assert "…" not in shown
    assert "deep/strong" in shown


def test_a_folder_without_runs_is_an_error(tmp_path):
    with pytest.raises(DataError, match="at least one run"):
        read_leaderboard(tmp_path)
    with pytest.raises(DataError, match="no such folder"):
        read_leaderboard(tmp_path / "nowhere")
