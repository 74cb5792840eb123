"""Trackers of experiments: what MLflow and Weights & Biases hold after a run was logged, by their own libraries."""

import json
import os
import subprocess
import sys

import pytest

from bench.api.runs import load_run
from bench.reporting.formats import headline_metrics
from tests.support.commands import called_here

LIBRARIES = {"mlflow": "mlflow-skinny>=3.1", "wandb": "wandb>=0.19"}
READ_MLFLOW = """
import json, mlflow
(run,) = mlflow.search_runs(search_all_experiments=True, output_format="list")
client = mlflow.MlflowClient()
files = [file.path for folder in (None, "figures") for file in client.list_artifacts(run.info.run_id, folder)]
name = client.get_experiment(run.info.experiment_id).name
print(json.dumps([name, run.info.run_name, run.data.metrics, run.data.params, run.data.tags, files]))
"""
READ_WANDB = """
import json, pathlib
from wandb.proto.wandb_internal_pb2 import Record

def records(data, at=7, whole=b""):  # a log as LevelDB writes it: blocks of 32 kB, each piece with its length and kind
    while at < len(data):
        length, kind = int.from_bytes(data[at + 4 : at + 6], "little"), data[at + 6]
        whole += data[at + 7 : at + 7 + length]
        at += 7 + length
        at += -at % 32768 if -at % 32768 < 7 else 0
        if kind in (1, 4):  # all of it, or its end
            yield Record.FromString(whole)
            whole = b""

(file,) = pathlib.Path("wandb").glob("offline-run-*/*.wandb")
found = {}
for record in records(file.read_bytes()):
    if record.HasField("run"):
        project, name = record.run.project, record.run.display_name
        config = {one.key: json.loads(one.value_json) for one in record.run.config.update}
    if record.HasField("history"):
        for one in record.history.item:
            found["/".join(one.nested_key) or one.key] = json.loads(one.value_json)
    if record.HasField("artifact"):
        files = [one.path for one in record.artifact.manifest.contents]
metrics = {key: value for key, value in found.items() if not key.startswith("_")}
print(json.dumps([project, name, metrics, config, config["manifest"], files]))
"""


@pytest.fixture(scope="module")
def run(tiny_card, tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "tiny run"
    words = ("--set", "flow=dis", "--split", "moving", "--out", folder, "--no-pictures")
    assert called_here("run", tiny_card, *words).returncode == 0
    return folder


@pytest.fixture(scope="module", params=LIBRARIES)
def installed(request, tmp_path_factory):
    """A library where only commands that are told find it: it asks for other versions than ours."""
    folder = tmp_path_factory.mktemp(request.param)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--target", folder, LIBRARIES[request.param]]
    subprocess.run(pip, check=True)
    return request.param, folder


@pytest.mark.slow
def test_a_run_is_logged_with_its_headlines_settings_manifest_and_files(installed, run, tmp_path):
    tracker, folder = installed
    own = {"MLFLOW_TRACKING_URI": f"file://{tmp_path}/runs", "MLFLOW_ALLOW_FILE_STORE": "true", "WANDB_MODE": "offline"}
    environment = os.environ | own | {"PYTHONPATH": os.pathsep.join([str(folder), os.getcwd()])}  # noqa: PTH109

    def call(*words):
        done = subprocess.run(
            [sys.executable, *words], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    shown = call("-m", "bench", "report", run, "--no-pictures", "--log", tracker)
    assert "MLflow run" in shown or "W&B run" in shown
    program = READ_MLFLOW if tracker == "mlflow" else READ_WANDB
    project, name, metrics, parameters, tags, files = json.loads(call("-c", program).splitlines()[-1])
    stored = load_run(run)
    summary, manifest = stored.summary, stored.manifest
    assert (project, name) == ("fisheye-bench", "tiny run")
    overall = {name: metric.value for name, metric in headline_metrics(summary).items()}
    assert overall.items() <= metrics.items()
    assert metrics["crossing/iou"] == summary.categories["crossing"].iou.value
    assert not {name for name in metrics if name.startswith("preceding/")}  # without cases
    asked = {"dataset": "tiny", "split": "moving", "protocol": "paper-v1", "method": "spherical", "method.flow": "dis"}
    assert asked.items() <= parameters.items()
    assert tags["dataset.data"] == manifest.dataset.data
    assert tags["code.libraries.numpy"] == manifest.code.libraries["numpy"]
    assert {"index.html", "table.md", "summary.json", "manifest.json", "figures/range_map.pdf"} <= set(files)


@pytest.mark.parametrize("command", ["run", "report"])
def test_without_the_library_nothing_is_computed(command, run, tiny_card, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wandb").mkdir()  # as the library leaves it
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    words = ("run", tiny_card, "--out", tmp_path / "new") if command == "run" else ("report", run, "--out", "new.html")
    for tracker in LIBRARIES:
        done = called_here(*words, "--log", tracker)
        assert (done.returncode, f"pip install 'fisheye-bench[{tracker}]'" in done.stderr) == (2, True)
    assert "did you mean 'mlflow'" in called_here(*words, "--log", "mlfow").stderr
    assert [path.name for path in tmp_path.iterdir()] == ["wandb"]


@pytest.fixture
def unreachable(tmp_path, monkeypatch):
    """A tracker whose server is away."""
    (tmp_path / "mlflow.py").write_text(
        "def set_experiment(name):\n    raise ConnectionError('no server at 10.0.0.1')\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    yield
    sys.modules.pop("mlflow", None)


@pytest.mark.usefixtures("unreachable")
def test_a_run_that_cannot_be_logged_is_stored_and_says_how_to_log_it(tiny_card, tmp_path):
    out = tmp_path / "run"
    words = ("run", tiny_card, "--split", "moving", "--out", out, "--no-pictures", "--log", "mlflow")
    done = called_here(*words)
    assert done.returncode == 2
    assert "no server at 10.0.0.1" in done.stderr
    assert f"log it with: fisheye-bench report {out} --log mlflow" in done.stderr
    assert load_run(out).summary.all_moving.object_frames > 0
    assert (out / "index.html").is_file()
    assert "--shard" in called_here(*words, "--shard", "1/2").stderr
