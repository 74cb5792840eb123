"""Baselines: written with care, read for ever."""

from pathlib import Path

import pandas as pd
import pytest

from bench.errors import DataError, UsageError
from bench.gate.baseline import read_baseline, write_baseline
from tests.gate.factories import one, scored, sums

BASELINES = Path(__file__).parents[2] / "reports" / "baselines"


def test_a_baseline_is_read_as_it_was_written_and_replaces_no_run(tmp_path):
    run = scored({"crossing": {"tpr_all": sums([1 / 3, 0.1])}}, recordings={"drive-0": "0" * 16, "drive-1": "1" * 16})
    write_baseline(run, tmp_path / "baselines" / "demo")
    read = read_baseline(tmp_path / "baselines" / "demo")
    assert read.manifest == run.manifest
    pd.testing.assert_frame_equal(read.sums, run.sums, check_dtype=False, check_exact=True)
    assert sorted(path.name for path in (tmp_path / "baselines" / "demo").iterdir()) == ["manifest.json", "sums.csv"]
    lines = (tmp_path / "baselines" / "demo" / "sums.csv").read_text().splitlines()
    assert lines[2] == "category,crossing,drive-1,tpr_all,1.0,10.0"
    for name in ("run.json", "surface-v1/summary.json"):  # a run, and its results by a protocol
        file = tmp_path / "run" / name
        file.parent.mkdir(exist_ok=True)
        file.touch()
        with pytest.raises(UsageError, match="expected a folder for a baseline, got that of a run"):
            write_baseline(run, file.parent)


@pytest.mark.parametrize("folder", sorted(BASELINES.iterdir()), ids=lambda folder: folder.name)
def test_the_form_of_a_baseline_is_stable(folder, tmp_path):
    write_baseline(read_baseline(folder), tmp_path / "again")
    for name in ("sums.csv", "manifest.json"):
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes()


def test_a_run_with_failures_makes_no_baseline(tmp_path):
    with pytest.raises(UsageError, match=r"a run with failures makes no baseline.*no lidar"):
        write_baseline(scored({}, failures=("recording 'a': no lidar",)), tmp_path / "b")
    assert not (tmp_path / "b").exists()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("sums.csv", r"sums\.csv: expected a table of sums"),
        ("manifest.json", r"expected a folder with sums\.csv and manifest\.json"),
    ],
)
def test_a_missing_file_of_a_baseline_is_named(tmp_path, name, message):
    write_baseline(one([0.5] * 6), tmp_path / "b")
    (tmp_path / "b" / name).unlink()
    with pytest.raises(DataError, match=message):
        read_baseline(tmp_path / "b")
