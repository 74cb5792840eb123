"""Trackers of experiments: a stored run goes to MLflow or to Weights & Biases, whose libraries are optional.

Both find their server, project and account by their own environment variables.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from shlex import quote

from bench.errors import UnknownNameError, UsageError
from bench.harness import RunSummary, read_run
from bench.harness.manifest import Manifest, all_settings
from bench.harness.method_of_run import flat_settings
from bench.plug_ins import describe_error
from bench.reporting.formats import headline_metrics

PROJECT = "fisheye-bench"  # where the environment names no other
# Files that people read: not the tables of single objects, nor masks.
TO_READ = {".csv", ".html", ".json", ".md", ".pdf", ".png", ".svg", ".tex"}
NO_TAGS = ("dataset.recordings.", "method.settings.", "method.asked.")  # of the manifest: long, or told as parameters


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """A run as trackers take it.

    Attributes:
        name: of the run.
        metrics: the headlines, over all moving objects as "iou" and of a kind of motion as "crossing/iou"; those
            without cases are left out.
        parameters: what was asked for.
        tags: the rest of the manifest, by dotted name.
        files: to read, by their name in the run's folder.
    """

    name: str
    metrics: dict[str, float]
    parameters: dict[str, object]
    tags: dict[str, object]
    files: dict[str, Path]


def log_run(folder: Path, tracker: str) -> str:
    """Log a stored run: its headlines, settings, manifest, tables and page.

    Args:
        folder: of the run.
        tracker: of `TRACKERS`.

    Returns:
        Where it can be seen, in the tracker's words.

    Raises:
        UsageError: the tracker is not installed, or refuses the run.
        DataError: a stored result is missing or damaged.
    """
    require_tracker(tracker)
    record = _record(folder)
    try:
        return TRACKERS[tracker](record)
    except Exception as error:  # a server that is away, an account that is missing: each library has its own
        again = f"the run is stored; log it with: fisheye-bench report {quote(str(folder))} --log {tracker}"
        raise UsageError(f"--log {tracker}: {describe_error(error)}; {again}") from error


def require_tracker(name: str) -> None:
    """Refuse a tracker that cannot be used.

    Raises:
        UnknownNameError: there is none of this name.
        UsageError: its library is not installed.
    """
    if name not in TRACKERS:
        raise UnknownNameError("tracker", name, TRACKERS)
    spec = find_spec(name)
    if spec is None or spec.origin is None:  # W&B writes a folder of its own name, which Python would import
        hint = f"install it: pip install 'fisheye-bench[{name}]'"
        raise UsageError(f"--log {name}: expected the library {name}, which is optional, got none; {hint}")


def _record(folder: Path) -> Record:
    run = read_run(folder)
    every = flat_settings(run.manifest.model_dump(mode="json"))
    return Record(
        name=run.label,
        metrics=_metrics(run.summary),
        parameters=_parameters(run.manifest),
        tags={name: value for name, value in every.items() if not name.startswith(NO_TAGS)},
        files={
            file.relative_to(folder).as_posix(): file
            for file in sorted(folder.rglob("*"))
            if file.suffix in TO_READ and file.is_file()
        },
    )


def _metrics(summary: RunSummary) -> dict[str, float]:
    found = headline_metrics(summary)
    for kind, row in summary.categories.items():
        found |= {f"{kind}/{name}": row.metric(name) for name in row.metric_names() if name in found}
    return {name: metric.value for name, metric in found.items() if not math.isnan(metric.value)}


def _parameters(manifest: Manifest) -> dict[str, object]:
    asked = {
        "dataset": manifest.dataset.name,
        "split": manifest.dataset.split or "all",
        "protocol": manifest.protocol.name,
        "method": manifest.method.name,
    }
    return asked | manifest.dataset.input_errors | {f"method.{n}": v for n, v in all_settings(manifest.method).items()}


def _to_mlflow(record: Record) -> str:
    import mlflow

    mlflow.set_experiment(os.environ.get("MLFLOW_EXPERIMENT_NAME", PROJECT))
    with mlflow.start_run(run_name=record.name) as run:
        mlflow.log_params(record.parameters)
        mlflow.set_tags(record.tags)
        mlflow.log_metrics(record.metrics)
        for name, file in record.files.items():
            mlflow.log_artifact(str(file), artifact_path=name.rpartition("/")[0] or None)
    return f"MLflow run {run.info.run_id} in {mlflow.get_tracking_uri()}"


def _to_wandb(record: Record) -> str:
    import wandb

    settings = wandb.Settings(silent=True)
    project = os.environ.get("WANDB_PROJECT", PROJECT)
    config = {**record.parameters, "manifest": record.tags}
    with wandb.init(project=project, name=record.name, config=config, settings=settings) as run:
        run.log(record.metrics)
        results = wandb.Artifact(f"run-{run.id}", type="run")
        for name, file in record.files.items():
            results.add_file(str(file), name=name)
        run.log_artifact(results)
    return f"W&B run {run.url or run.dir}"


TRACKERS: dict[str, Callable[[Record], str]] = {"mlflow": _to_mlflow, "wandb": _to_wandb}
