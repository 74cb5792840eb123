"""A run on a Dask cluster gives what a run here gives, whatever dies meanwhile."""

import shutil
import signal
import socket
from pathlib import Path

import cv2
import pytest

import bench
from bench.errors import DataError, UsageError
from bench.harness.cluster import ClusterExecutor, WorkerRequirements
from bench.methods.baselines import Nothing
from tests.harness.cluster.conftest import stop
from tests.harness.cluster.dask_processes import PATIENCE_S, command, in_background, wait_until
from tests.support.commands import called_here
from tests.support.runs import bytes_of

pytestmark = pytest.mark.slow

ALL = 3  # units of the small data set


@pytest.mark.parametrize("method", ["spherical", "misbehaving:Bright"])
def test_a_cluster_gives_the_bytes_of_a_run_in_turn(cluster, score, tmp_path, method):
    score("serial", method=method)
    done = score("cluster", cluster.address, method=method)
    assert bytes_of(tmp_path / "cluster") == bytes_of(tmp_path / "serial")
    assert done.provenance.work.units_computed == ALL
    again = score("cluster", cluster.address, method=method).provenance.work
    assert (again.units_computed, again.units_reused) == (0, ALL)


def test_a_worker_that_is_killed_costs_one_more_try(cluster, score, tmp_path):
    done = score("cluster", cluster.address, happening="killed")
    assert (tmp_path / "killed").exists()
    assert done.failures == ()
    score("serial", happening="killed")
    assert bytes_of(tmp_path / "cluster") == bytes_of(tmp_path / "serial")


def test_a_unit_that_ends_its_worker_every_time_is_named_and_the_rest_is_scored(cluster, score, tmp_path):
    done = score("cluster", cluster.address, happening="aborts")
    assert len(done.failures) == 1
    assert "recording 'standing', camera 'front', images 1 to 4: its worker ended" in done.failures[0]
    assert (tmp_path / "attempts").read_text() == "xx", "the scheduler allows one failure"
    assert done.provenance.work.units_computed == ALL - 1


def test_a_bug_of_a_method_fails_its_images_as_here(cluster, score):
    there, here = score("cluster", cluster.address, happening="wrong"), score("here", happening="wrong")
    assert there.failures == here.failures
    assert "ZeroDivisionError: a bug of the method" in there.failures[0]


def test_when_the_scheduler_dies_the_run_says_so_and_goes_on_from_there(own_cluster, score, tmp_path):
    own_cluster.add_worker()
    own_cluster.add_worker()
    (tmp_path / "scheduler-pid").write_text(str(own_cluster.scheduler.pid))
    with pytest.raises(DataError, match="connection that was lost; start it and its workers"):
        score("run", own_cluster.address, happening="without_scheduler")
    stored = len(list((tmp_path / "run" / "units").glob("*.unit")))
    assert 0 < stored < ALL
    work = score("run", happening="without_scheduler").provenance.work
    assert (work.units_reused, work.units_computed) == (stored, ALL - stored)
    score("serial", happening="without_scheduler")
    assert bytes_of(tmp_path / "run") == bytes_of(tmp_path / "serial")


def test_without_workers_a_run_waits_and_then_says_so(own_cluster, score):
    with pytest.raises(DataError, match="expected workers, got none for 1 s; start some"):
        score("run", own_cluster.address, patience_s=1.0)


def test_a_scheduler_that_is_not_there(score, monkeypatch):
    monkeypatch.setattr("bench.harness.cluster.connection.CONNECTION_S", 1.0)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(DataError, match="expected a Dask scheduler, got none within 1 s"):
            score("run", address)


@pytest.mark.parametrize("address", ["nonsense://localhost:1", "tcp://no-such-ego.invalid:8786", "tcp://:::"])
def test_an_address_that_is_none(score, monkeypatch, address):
    monkeypatch.setattr("bench.harness.cluster.connection.CONNECTION_S", 1.0)
    with pytest.raises(DataError, match="expected a Dask scheduler"):
        score("run", address)


def test_a_worker_with_other_code_is_refused(own_cluster, score, tmp_path):
    other = tmp_path / "other"
    shutil.copytree(Path(bench.__file__).parent, other / "bench", ignore=shutil.ignore_patterns("__pycache__"))
    with (other / "bench" / "evaluation" / "ratios.py").open("a") as file:
        file.write("# changed\n")
    own_cluster.add_worker(python_path=f"{other}:{own_cluster.python_path}")
    with pytest.raises(UsageError, match=r"it has other code of fisheye-bench, in .*other/bench; install the same"):
        score("run", own_cluster.address)


def test_a_worker_without_this_package_is_refused(own_cluster, score, tmp_path):
    (tmp_path / "empty" / "bench").mkdir(parents=True)
    (tmp_path / "empty" / "bench" / "__init__.py").touch()
    own_cluster.add_worker(python_path=str(tmp_path / "empty"))
    with pytest.raises(UsageError, match=r"worker tcp://.*: it cannot import fisheye-bench .*; install it"):
        score("run", own_cluster.address)
    with pytest.raises(UsageError, match=r"worker tcp://.*: it cannot import fisheye-bench .*; install it"):
        ClusterExecutor.connect(own_cluster.address, WorkerRequirements.of(Nothing(), reads=(), cache=None))


def test_a_worker_that_cannot_import_the_method_is_refused(own_cluster, score):
    own_cluster.add_worker(python_path="")
    with pytest.raises(UsageError, match=r"cannot import the method misbehaving:Bright .*; set PYTHONPATH"):
        score("run", own_cluster.address)


def test_the_command_takes_relative_paths_and_the_file_of_a_scheduler(cluster, tiny_card, tmp_path):
    folder = tiny_card.parent
    words = ("run", tiny_card.name, "--method", "frame-difference", "--no-pictures")
    file, cache = cluster.folder / "scheduler.json", tmp_path / "cache"
    done = command(*words, "--scheduler", file, "--out", tmp_path / "run", "--cache", cache, folder=folder)
    assert (done.returncode, done.stderr) == (0, "")
    assert "units computed 3, found done 0" in done.stdout
    assert list(cache.glob("reference/*/*.npz")), "workers of this machine share its cache"
    here = called_here(*words, "--workers", 1, "--no-cache", "--out", tmp_path / "serial", folder=folder)
    assert here.returncode == 0
    assert bytes_of(tmp_path / "run") == bytes_of(tmp_path / "serial")


def test_the_command_ends_with_2_and_one_line_without_a_scheduler(own_cluster, tiny_card, tmp_path):
    stop(own_cluster)
    done = command("run", tiny_card, "--scheduler", own_cluster.address, "--out", tmp_path / "run", folder=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: {own_cluster.address}: expected a Dask scheduler")
    assert done.stderr.count("\n") == 1


def test_workers_beside_a_scheduler_are_refused(tiny_card, tmp_path):
    words = ("--scheduler", "tcp://localhost:1", "--workers", 2, "--out", tmp_path / "run")
    done = called_here("run", tiny_card, *words)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "--workers: expected none beside --scheduler" in done.stderr


def test_an_interrupted_command_ends_and_the_same_one_goes_on(own_cluster, tiny_card, tmp_path):
    own_cluster.add_worker()
    own_cluster.add_worker()
    settings = ("--set", f"folder={tmp_path}", "--set", "happening=sleeps")
    words = ("run", tiny_card, "--method", "misbehaving:Bright", *settings, "--out", tmp_path / "run", "--no-pictures")
    units = tmp_path / "run" / "units"
    with in_background(*words, "--scheduler", own_cluster.address, folder=tmp_path) as running:
        wait_until((tmp_path / "asleep").exists)
        wait_until(lambda: len(list(units.glob("*.unit"))) == ALL - 1)
        running.send_signal(signal.SIGINT)
        said, wrong = running.communicate(timeout=PATIENCE_S)
    assert (running.returncode, wrong) == (130, "")
    assert "interrupted; what is done is in" in said
    assert len(list(units.glob("*.unit"))) == ALL - 1


def test_predictions_are_scored_on_a_cluster(cluster, tiny_card, tmp_path):
    for folder in sorted(path.parent for path in (tiny_card.parent / "data" / "tiny").glob("*/recording.json")):
        for image in sorted((folder / "images" / "front").iterdir()):
            mask = cv2.imread(str(image), cv2.IMREAD_GRAYSCALE) // 128 * 255
            file = tmp_path / "masks" / folder.name / "front" / f"{image.stem}.png"
            file.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(file), mask)
    words = ("evaluate", tiny_card, "--predictions", "masks", "--no-pictures")
    done = command(*words, "--scheduler", cluster.address, "--out", tmp_path / "run", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert called_here(*words, "--workers", 1, "--out", tmp_path / "serial", folder=tmp_path).returncode == 0
    assert bytes_of(tmp_path / "run") == bytes_of(tmp_path / "serial")
