"""Clusters for tests, and how a run is scored on one."""

import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from bench.evaluation import load_protocol
from bench.execution import SerialExecutor, TaskExecutor
from bench.harness import RunSummary
from bench.harness.cluster import ClusterExecutor, WorkerRequirements
from bench.methods import build_method
from bench.recordings import load_card
from tests.harness.cluster.dask_processes import METHODS, DaskProcesses, dask_processes
from tests.support.runs import run_one

Score = Callable[..., RunSummary]


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskProcesses]:
    """Two workers, which come back when they are killed."""
    with dask_processes(tmp_path_factory.mktemp("cluster"), workers=2, python_path=METHODS) as started:
        yield started


@pytest.fixture
def own_cluster(tmp_path: Path) -> Iterator[DaskProcesses]:
    """A scheduler without workers, which a test may kill."""
    folder = tmp_path / "cluster"
    folder.mkdir()
    with dask_processes(folder, workers=0, python_path=METHODS) as started:
        yield started


@pytest.fixture
def score(tiny_card: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Score:
    """Scores the small data set with a method of this folder, here or on a cluster."""
    monkeypatch.syspath_prepend(str(METHODS))

    def scored(
        out: str,
        address: str | None = None,
        *,
        method: str = "misbehaving:Bright",
        patience_s: float = 60.0,
        **settings,
    ) -> RunSummary:
        ours = {"folder": str(tmp_path)} if method == "misbehaving:Bright" else {}
        chosen, card = build_method(method, ours | settings), load_card(tiny_card)
        executor: TaskExecutor = SerialExecutor()
        if address is not None:
            requirements = WorkerRequirements.of(chosen, reads=(card.root,), cache=None)
            executor = ClusterExecutor.connect(address, requirements, patience_s=patience_s)
        return run_one(
            card=card, method=chosen, protocol=load_protocol("paper-v1"), out=tmp_path / out, executor=executor
        )

    return scored


def stop(cluster: DaskProcesses) -> None:
    """End the scheduler as a machine that goes down does."""
    cluster.scheduler.send_signal(signal.SIGKILL)
    cluster.scheduler.wait()
