"""Data sets on object storage; runs are folders, and addresses in their place are refused."""

from pathlib import Path

import pytest

from bench.evaluation import load_protocol
from bench.methods import build_method
from bench.recordings import load_card
from tests.harness.cluster.dask_processes import METHODS, command, dask_processes
from tests.support.commands import call
from tests.support.object_storage import bucket, object_server, remote_card
from tests.support.runs import run_one

pytestmark = pytest.mark.slow

__all__ = ["bucket", "object_server", "remote_card"]

CARD = Path(__file__).parents[2] / "datasets" / "tiny.yaml"
METHOD = ("--method", "nothing", "--workers", 1, "--no-cache", "--no-pictures")
TABLES = ("objects.parquet", "frames.parquet", "image_maps.npz")


@pytest.fixture(autouse=True)
def _elsewhere(monkeypatch, tmp_path):
    """Whatever is written to no named place is written here."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    yield
    assert not [path for path in (tmp_path / "here").rglob("*") if ":" in path.name], "an address taken for a path"


@pytest.fixture
def local(tiny_card, tmp_path) -> Path:
    """A run of the same data on disk."""
    out = tmp_path / "local"
    run_one(card=load_card(tiny_card), method=build_method("nothing"), protocol=load_protocol("paper-v1"), out=out)
    return out


def test_a_run_of_data_on_storage_is_that_of_data_on_disk(monkeypatch, remote_card, local, tmp_path):
    out = tmp_path / "remote-run"
    assert call(monkeypatch, "run", remote_card, *METHOD, "--out", out) == 0
    for name in TABLES:
        assert (out / name).read_bytes() == (local / name).read_bytes(), name
    assert call(monkeypatch, "compare", local, out, "--no-pictures", "--out", tmp_path / "compared") == 0
    assert list((tmp_path / "compared").iterdir())


def test_a_cluster_scores_data_on_storage(monkeypatch, remote_card, local, tmp_path):
    """Copies of the workers lie elsewhere than those of the command, which reads no data."""
    (tmp_path / "cluster").mkdir()
    with monkeypatch.context() as elsewhere:
        elsewhere.setenv("FISHEYE_BENCH_REMOTE", str(tmp_path / "of-workers"))
        with dask_processes(tmp_path / "cluster", workers=2, python_path=METHODS) as cluster:
            elsewhere.undo()
            out = tmp_path / "clustered"
            words = ("--method", "nothing", "--no-pictures", "--scheduler", cluster.address, "--out", out)
            done = command("run", remote_card, *words, folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    assert "units computed 3, found done 0" in done.stdout
    assert len(list((tmp_path / "of-workers").rglob("images/*/*.png"))) == 15
    assert not list((tmp_path / "remote").rglob("images/*/*.png"))
    for name in TABLES:
        assert (out / name).read_bytes() == (local / name).read_bytes(), name


@pytest.mark.parametrize(
    "words",
    [
        ("run", CARD, "--out", "s3://me:hidden@bench/run"),
        ("report", "s3://bench/none"),
        ("gate", "s3://bench/none", "--baseline", "b"),
        ("compare", "s3://me:hidden@bench/a", "b"),
        ("report", ""),
    ],
)
def test_a_run_at_an_address_ends_in_one_line(monkeypatch, capsys, words):
    assert call(monkeypatch, *words) == 2
    shown = capsys.readouterr().err
    assert shown.startswith("error: expected a folder")
    assert len(shown.strip().splitlines()) == 1
    assert "hidden" not in shown


def test_a_scenario_is_not_rendered_into_an_address(monkeypatch, remote_card, bucket):
    before = bucket.names("sets/")
    assert call(monkeypatch, "validate", remote_card, "--errors-only") == 0
    assert bucket.names("sets/") == before
