"""Commands with addresses of object storage in place of folders."""

import json

import pytest

from bench.evaluation import load_protocol
from bench.harness import RunRequest, run_benchmark
from bench.methods import build_method
from bench.recordings import load_card
from tests.support.commands import call
from tests.support.object_storage import bucket, object_server, remote_card

pytestmark = pytest.mark.slow

__all__ = ["bucket", "object_server", "remote_card"]

METHOD = ("--method", "nothing", "--workers", 1, "--no-cache")


@pytest.fixture(autouse=True)
def _elsewhere(monkeypatch, tmp_path):
    """Whatever is written to no named place is written here."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    yield
    assert not [path for path in (tmp_path / "here").rglob("*") if ":" in path.name], "an address taken for a path"


def test_a_run_from_storage_to_storage_is_reported_judged_and_compared(
    monkeypatch, capsys, remote_card, tiny_card, bucket, tmp_path
):
    url = "s3://bench/runs/nothing"
    assert call(monkeypatch, "run", remote_card, *METHOD, "--out", url) == 0
    shown = capsys.readouterr().out
    stored = {key.removeprefix("runs/nothing/") for key in bucket.names("runs/nothing/")}
    assert {"summary.json", "table.md", "range_map.png", "objects.parquet"} <= stored
    assert any(name.startswith("pictures/") for name in stored)
    assert f"{url}/summary.json" in shown
    assert str(tmp_path) not in shown

    own = tmp_path / "local"
    run_benchmark(
        RunRequest(
            card=load_card(str(tiny_card)), method=build_method("nothing"), protocol=load_protocol("paper-v1"), out=own
        )
    )
    assert bucket.get("runs/nothing/objects.parquet") == (own / "objects.parquet").read_bytes()

    assert call(monkeypatch, "report", url, "--no-pictures") == 0
    assert f"{url}/index.html" in capsys.readouterr().out
    assert bucket.get("runs/nothing/index.html").startswith(b"<!DOCTYPE html>")

    baseline = tmp_path / "baseline.json"
    assert call(monkeypatch, "gate", url, "--baseline", baseline, "--update", "--allow-dirty") == 0
    assert call(monkeypatch, "gate", url, "--baseline", baseline) == 3
    assert "without a verdict" in capsys.readouterr().out.lower()
    assert call(monkeypatch, "compare", own, url, "--no-pictures", "--out", tmp_path / "compared") == 0
    assert "0 newly detected, 0 newly missed" in capsys.readouterr().out
    assert list((tmp_path / "compared").iterdir())


def test_parts_are_merged_at_an_address(monkeypatch, capsys, remote_card, bucket, tmp_path):
    url = "s3://bench/runs/parts"
    for part in ("1/2", "2/2"):
        monkeypatch.setenv("FISHEYE_BENCH_REMOTE", str(tmp_path / part.replace("/", "-")))
        assert call(monkeypatch, "run", remote_card, *METHOD, "--out", url, "--shard", part) == 0
        assert f"merge {url}" in capsys.readouterr().out
    assert "runs/parts/summary.json" not in bucket.names()
    monkeypatch.setenv("FISHEYE_BENCH_REMOTE", str(tmp_path / "third"))
    assert call(monkeypatch, "merge", url, "--no-pictures") == 0
    assert json.loads(bucket.get("runs/parts/summary.json"))["images"]["evaluated"] > 0
    assert call(monkeypatch, "merge", tmp_path / "merged", url, "--no-pictures") == 0
    assert bucket.get("runs/parts/objects.parquet") == (tmp_path / "merged" / "objects.parquet").read_bytes()
    assert call(monkeypatch, "merge", "s3://bench/runs/copy", tmp_path / "merged", "--no-pictures") == 2
    assert call(monkeypatch, "merge", "s3://bench/runs/copy", url, "--no-pictures") == 0
    assert bucket.get("runs/copy/objects.parquet") == bucket.get("runs/parts/objects.parquet")
    assert len(bucket.names("runs/copy/units/")) == len(bucket.names("runs/parts/units/"))


def test_predictions_are_scored_to_an_address(monkeypatch, capsys, remote_card, tiny_card, bucket, tmp_path):
    import cv2
    import numpy as np

    for image in tiny_card.parent.glob("data/tiny/*/images/front/*"):
        mask = tmp_path / "masks" / image.parts[-4] / "front" / f"{image.stem}.png"
        mask.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(mask), np.zeros((240, 320), np.uint8))
    words = ("--predictions", tmp_path / "masks", "--out", "s3://bench/runs/masks", "--no-pictures", "--workers", 1)
    assert call(monkeypatch, "evaluate", remote_card, *words) == 0
    assert "s3://bench/runs/masks/summary.json" in capsys.readouterr().out
    assert {"runs/masks/predictions.json", "runs/masks/summary.json"} <= set(bucket.names())


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("report", "s3://bench/none"), "s3://bench/none: expected a folder with data"),
        (("gate", "s3://nobody/none", "--baseline", "b.json"), "s3://nobody/none: expected a folder with data"),
        (("compare", "s3://me:hidden@bench/a", "b"), "expected an address without a password"),
        (("merge", "s3://bench/none"), "expected"),
        (("report", ""), "expected a folder, got an empty name"),
    ],
)
def test_addresses_that_cannot_be_used_end_in_one_line(monkeypatch, capsys, bucket, words, told):
    assert call(monkeypatch, *words) == 2
    shown = capsys.readouterr().err
    assert shown.startswith("error: ")
    assert told in shown
    assert len(shown.strip().splitlines()) == 1
    assert "hidden" not in shown


def test_a_bucket_that_is_missing_ends_a_run_in_one_line(monkeypatch, capsys, tiny_card, bucket):
    assert call(monkeypatch, "run", tiny_card, *METHOD, "--out", "s3://nobody/run") == 2
    assert "s3://nobody/run: expected a folder that can be written" in capsys.readouterr().err


def test_a_scenario_is_not_rendered_into_an_address(monkeypatch, capsys, remote_card, bucket):
    before = bucket.names("sets/")
    assert call(monkeypatch, "validate", remote_card, "--errors-only") == 0
    assert bucket.names("sets/") == before
