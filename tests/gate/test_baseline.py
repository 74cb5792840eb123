"""Baselines: written with care, read for ever."""

import json
import pickle
import re
from pathlib import Path

import pytest

from bench.errors import DataError, UsageError
from bench.gate import MissingBaselineError, read_baseline, write_baseline
from bench.harness import provenance
from tests.gate.factories import one, scored, sums, verdict_of

BASELINES = Path(__file__).parents[2] / "reports" / "baselines"
STORED = Path(__file__).parent / "stored" / "baseline-v1.json"


def test_a_baseline_is_read_as_it_was_written(tmp_path):
    run = scored(
        {"crossing": {"tpr_all": sums([1 / 3, 0.1])}},
        counts={"crossing": {"object_frames": 20}},
        recordings={"drive-0": "0" * 16, "drive-1": "1" * 16},
    )
    write_baseline(run, tmp_path / "baselines" / "demo.json")
    assert read_baseline(tmp_path / "baselines" / "demo.json") == run
    assert [path.name for path in (tmp_path / "baselines").iterdir()] == ["demo.json"]


def test_a_metric_of_a_slice_is_one_line_of_the_file(tmp_path):
    write_baseline(one([0.5] * 3), tmp_path / "b.json")
    (line,) = [line for line in (tmp_path / "b.json").read_text().splitlines() if "tpr_all" in line]
    assert json.loads(f"{{{line}}}")["tpr_all"]["denominators"] == {"drive-0": 10.0, "drive-1": 10.0, "drive-2": 10.0}


@pytest.mark.parametrize("file", sorted(BASELINES.glob("*.json")), ids=lambda file: file.stem)
def test_the_form_of_a_baseline_is_stable(file, tmp_path):
    write_baseline(read_baseline(file), tmp_path / "again.json")
    again, stored = (re.sub(r',\n "sha256": "\w+"', "", path.read_text()) for path in (tmp_path / "again.json", file))
    assert again == stored


def test_a_dirty_tree_is_refused_unless_told(tmp_path):
    dirty = scored({}, commit="c0ffee+")
    with pytest.raises(UsageError, match="--allow-dirty"):
        write_baseline(dirty, tmp_path / "b.json")
    assert not (tmp_path / "b.json").exists()
    write_baseline(dirty, tmp_path / "b.json", allow_dirty=True)
    assert read_baseline(tmp_path / "b.json").origin.commit == "c0ffee+"


def test_a_run_outside_of_a_checkout_is_not_dirty(tmp_path):
    write_baseline(scored({}, commit=None), tmp_path / "b.json")
    assert read_baseline(tmp_path / "b.json").origin.commit is None


def test_the_commit_of_an_installed_package_is_the_one_that_pip_noted(tmp_path, monkeypatch):
    info = tmp_path / "fisheye_bench-9.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: fisheye-bench\nVersion: 9\n")
    (info / "direct_url.json").write_text('{"url": "file:///x", "vcs_info": {"vcs": "git", "commit_id": "c0ffee"}}')
    monkeypatch.syspath_prepend(str(tmp_path))
    assert provenance.package_commit() != "c0ffee"  # another copy runs
    monkeypatch.setattr(provenance.bench, "__file__", str(tmp_path / "bench" / "__init__.py"))
    assert provenance.package_commit() == "c0ffee"


def test_a_run_with_failures_makes_no_baseline(tmp_path):
    with pytest.raises(UsageError, match="no lidar"):
        write_baseline(scored({}, failures=("recording 'a': no lidar",)), tmp_path / "b.json", allow_dirty=True)


def test_a_missing_baseline_is_an_error_of_its_own(tmp_path):
    with pytest.raises(MissingBaselineError, match="nothing was judged") as fault:
        read_baseline(tmp_path / "b.json")
    assert str(pickle.loads(pickle.dumps(fault.value))) == str(fault.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [("{", "expected a baseline, got no JSON"), ("{}", "schema_version"), ('{"schema_version": 2}', "schema_version")],
)
def test_a_damaged_baseline_names_the_field(tmp_path, text, message):
    (tmp_path / "b.json").write_text(text)
    with pytest.raises(DataError, match=message):
        read_baseline(tmp_path / "b.json")


def test_the_first_version_loads_and_judges():
    stored = read_baseline(STORED)
    assert stored.dataset == "gated"
    assert stored.sheet.slices["overtaking"]["tpr_all"].cases == 16
    assert verdict_of(stored, stored).passed
