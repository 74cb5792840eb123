"""A run on a cluster with its data and its results on object storage: no common disk."""

import shutil
from pathlib import Path

import pytest

from tests.harness.cluster.dask_processes import METHODS, command, dask_processes
from tests.support.object_storage import bucket, object_server, remote_card

pytestmark = pytest.mark.slow

__all__ = ["bucket", "object_server", "remote_card"]

TABLES = ("objects.parquet", "frames.parquet", "image_maps.npz")
URL = "s3://bench/runs/first"


@pytest.fixture
def cluster(bucket, tmp_path, monkeypatch):
    """Two workers whose copies of remote data lie elsewhere than those of the command."""
    (tmp_path / "cluster").mkdir()
    with monkeypatch.context() as elsewhere:
        elsewhere.setenv("FISHEYE_BENCH_REMOTE", str(tmp_path / "of-workers"))
        with dask_processes(tmp_path / "cluster", workers=2, python_path=METHODS) as started:
            elsewhere.undo()
            yield started


def images(folder: Path) -> int:
    return len(list(folder.rglob("images/*/*.png")))


def test_a_cluster_scores_from_storage_to_storage_and_goes_on_there(remote_card, tiny_card, bucket, cluster, tmp_path):
    words = ("--method", "frame-difference", "--no-pictures")
    there = (*words, "--scheduler", cluster.address, "--out", URL)
    done = command("run", remote_card, *there, folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    assert "units computed 3, found done 0" in done.stdout
    assert f"{URL}/summary.json" in done.stdout
    assert images(tmp_path / "of-workers") == 15
    assert images(tmp_path / "remote") == 0, "this process reads no data"

    serial = command("run", tiny_card, *words, "--workers", 1, "--out", tmp_path / "serial", folder=tmp_path)
    assert serial.returncode == 0
    for name in TABLES:
        assert bucket.get(f"runs/first/{name}") == (tmp_path / "serial" / name).read_bytes(), name

    shutil.rmtree(tmp_path / "remote")
    bucket.remove(next(name for name in bucket.names("runs/first/units/") if name.endswith(".unit")))
    again = command("run", remote_card, *there, folder=tmp_path)
    assert (again.returncode, again.stderr) == (0, ""), again.stdout
    assert "units computed 1, found done 2" in again.stdout
    for name in TABLES:
        assert bucket.get(f"runs/first/{name}") == (tmp_path / "serial" / name).read_bytes(), name
