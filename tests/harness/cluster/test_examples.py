"""The files for SLURM and Kubernetes, tried as far as that goes without either."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from distributed.cli import dask_scheduler, dask_worker
from typer.main import get_command

from bench.cli.app import app
from bench.harness.cluster.examples import EXAMPLES, cluster_example
from tests.harness.cluster.dask_processes import PATIENCE_S, SETTINGS
from tests.support.commands import call, called_here
from tests.support.runs import bytes_of

pytestmark = pytest.mark.slow

PROGRAMS = Path(sys.executable).parent
PARTS = 3

SRUN = """#!/bin/bash
# Does here what srun does on many nodes.
count=1
while [[ $1 == --* ]]; do
    case $1 in --ntasks=*) count=${1#*=} ;; esac
    shift
done
for _ in $(seq "$count"); do "$@" & done
trap 'kill $(jobs -p)' TERM
wait
"""


def script(name: str, folder: Path, **variables: object) -> subprocess.CompletedProcess[str]:
    """Run an example in a folder."""
    file = folder / f"{name}.sh"
    file.write_text(cluster_example(name))
    programs = folder / "programs"
    programs.mkdir(exist_ok=True)
    (programs / "srun").write_text(SRUN)
    (programs / "srun").chmod(0o755)
    environment = {name: str(value) for name, value in variables.items()}
    path = f"{programs}:{PROGRAMS}:{os.environ['PATH']}"
    return subprocess.run(
        ["bash", file],
        cwd=folder,
        env={**os.environ, **SETTINGS, **environment, "PATH": path},
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )


@pytest.fixture(scope="module")
def serial(tiny_card, tmp_path_factory) -> dict[str, bytes]:
    """What the run comes to in one piece."""
    out = tmp_path_factory.mktemp("serial") / "run"
    words = ("--method", "frame-difference", "--workers", 1, "--no-cache", "--no-pictures")
    assert called_here("run", tiny_card, *words, "--out", out).returncode == 0
    return bytes_of(out)


def test_an_array_of_jobs_makes_a_whole_run(serial, tiny_card, tmp_path):
    out = tmp_path / "run"
    for number in range(1, PARTS + 1):
        done = script(
            "slurm-array",
            tmp_path,
            DATASET=tiny_card,
            METHOD="frame-difference",
            OUT=out,
            SLURM_ARRAY_TASK_ID=number,
            SLURM_ARRAY_TASK_COUNT=PARTS,
            TMPDIR=tmp_path,
        )
        assert (done.returncode, done.stderr) == (0, "")
    done = script("slurm-array", tmp_path, DATASET=tiny_card, METHOD="frame-difference", OUT=out, TMPDIR=tmp_path)
    assert "units computed 0, found done 3" in done.stdout
    assert bytes_of(out) == serial


def test_a_job_with_dask_makes_a_whole_run(serial, tiny_card, tmp_path):
    done = script(
        "slurm-dask",
        tmp_path,
        DATASET=tiny_card,
        METHOD="frame-difference",
        OUT=tmp_path / "run",
        SLURM_JOB_ID=7,
        SLURM_NTASKS=3,
        TMPDIR=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert bytes_of(tmp_path / "run") == serial
    assert not list(tmp_path.glob("scheduler-*.json"))


@pytest.mark.parametrize("name", ["slurm-array", "slurm-dask"])
def test_what_has_to_be_set_is_named(name, tmp_path):
    done = script(name, tmp_path, SLURM_ARRAY_TASK_ID=1, SLURM_ARRAY_TASK_COUNT=1, SLURM_JOB_ID=1, SLURM_NTASKS=2)
    assert done.returncode != 0
    assert "DATASET: the card of the data set" in done.stderr


def containers() -> dict[str, list[str]]:
    """Every command of the Kubernetes file, by the name of its container."""
    parts = list(yaml.safe_load_all(cluster_example("kubernetes")))
    pods = [part["spec"]["template"]["spec"] for part in parts if "template" in part["spec"]]
    return {container["name"]: container["command"] for pod in pods for container in pod["containers"]}


def test_the_commands_of_the_kubernetes_file_have_the_options_that_they_use():
    found = containers()
    assert set(found) == {"scheduler", "worker", "run"}
    assert found["scheduler"][:2] == ["dask", "scheduler"]
    assert found["worker"][:2] == ["dask", "worker"]
    assert found["run"][:2] == ["fisheye-bench", "run"]
    dask_scheduler.main.make_context("scheduler", found["scheduler"][2:])
    assert dask_worker.main.make_context("worker", found["worker"][2:]).params["nthreads"] == 1
    commands = get_command(app).commands  # type: ignore[attr-defined]
    options = commands["run"].make_context("run", found["run"][2:]).params
    assert options["scheduler"] == found["worker"][2], "the run and the workers call the same scheduler"


def test_the_kubernetes_file_hangs_together():
    parts = list(yaml.safe_load_all(cluster_example("kubernetes")))
    service = next(part for part in parts if part["kind"] == "Service")
    labels = [part["spec"]["template"]["metadata"]["labels"] for part in parts if "template" in part["spec"]]
    assert labels.count(service["spec"]["selector"]) == 1
    host = service["metadata"]["name"]
    assert f"tcp://{host}:{service['spec']['ports'][0]['port']}" in containers()["run"]
    for part in parts:
        if part["kind"] == "Deployment":
            assert part["spec"]["selector"]["matchLabels"] == part["spec"]["template"]["metadata"]["labels"]
        if "template" in part["spec"]:
            pod = part["spec"]["template"]["spec"]
            mounted = {mount["name"] for container in pod["containers"] for mount in container.get("volumeMounts", ())}
            assert mounted == {volume["name"] for volume in pod.get("volumes", ())}


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_command_prints_each_of_them(monkeypatch, capsys, name):
    assert call(monkeypatch, "cluster-example", name) == 0
    assert capsys.readouterr().out == cluster_example(name)


def test_the_command_names_what_there_is(monkeypatch, capsys):
    assert call(monkeypatch, "cluster-example", "slurm-aray") == 2
    shown = capsys.readouterr().err
    assert "unknown example 'slurm-aray': known are kubernetes, slurm-array, slurm-dask" in shown
    assert "did you mean 'slurm-array'?" in shown
