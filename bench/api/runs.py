"""Score a method on a data set and read what was stored."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import pyarrow as pa

from bench.api.datasets import as_card
from bench.errors import BenchError, UsageError
from bench.evaluation import ObjectMetrics, load_protocol
from bench.harness import RunRequest, RunSummary, StoredRun, build_scorable, read_run, read_tables
from bench.harness.exact import require_scorable
from bench.harness.manifest import Manifest
from bench.harness.method_of_run import flat_settings
from bench.methods import Scorable
from bench.recordings import DatasetCard
from bench.recordings.input_errors import named_input_errors

if TYPE_CHECKING:
    import pandas as pd

RUNS = Path("reports/runs")
DEFAULT_PROTOCOL = "paper-v1"
LONGEST_NAME = 120  # characters of a folder's name


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A stored run, as tables of pandas.

    Attributes:
        stored: the run as it lies on disk, with its protocol and its table of sums.
    """

    stored: StoredRun

    @property
    def folder(self) -> Path:
        """Folder of the results, tables and maps in it."""
        return self.stored.folder

    @property
    def manifest(self) -> Manifest:
        """Data, method, protocol and code of the run."""
        return self.stored.manifest

    @property
    def summary(self) -> RunSummary:
        """All metrics with intervals, failures, provenance."""
        return self.stored.summary

    @cached_property
    def metrics(self) -> pd.DataFrame:
        """The table of the run: one row per kind of motion and "all_moving", shares in [0, 1], NaN without cases."""
        import pandas as pd  # 0.3 s, and a command that scores needs none of it

        rows = {**self.summary.categories, "all_moving": self.summary.all_moving}
        return pd.DataFrame.from_dict({name: _row(row) for name, row in rows.items()}, orient="index")

    @cached_property
    def objects(self) -> pd.DataFrame:
        """One row per annotated object and image, whatever its status; columns as in `objects.parquet`."""
        objects: pd.DataFrame = self._tables[0].to_pandas()
        return objects

    @cached_property
    def frames(self) -> pd.DataFrame:
        """One row per image; columns as in `frames.parquet`, without histograms."""
        frames: pd.DataFrame = self._tables[1].to_pandas()
        return frames.dropna(axis="columns", how="all")

    @cached_property
    def _tables(self) -> tuple[pa.Table, pa.Table]:
        return read_tables(self.folder, histograms=False)

    def flat(self) -> dict[str, float | str]:
        """Metrics, as "crossing.iou", and settings, as "settings.threshold", for a tracker of experiments."""
        method = flat_settings(self.manifest.method.settings)
        settings = {f"settings.{name}": str(value) for name, value in method.items()}
        rows = {
            f"{row}.{name}": float(value)
            for row, values in self.metrics.to_dict(orient="index").items()
            for name, value in values.items()
        }
        return {**settings, **rows, "false_positives": self.false_positives}

    @property
    def false_positives(self) -> float:
        """Mean share of the image that is marked wrongly."""
        return self.summary.false_positives.coverage.value


def run_request(
    dataset: str | Path | DatasetCard,
    method: str | Scorable,
    *,
    settings: Mapping[str, object] | None = None,
    protocols: Sequence[str | Path] = (DEFAULT_PROTOCOL,),
    split: str | None = None,
    input_errors: Mapping[str, object] | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    named_by: Iterable[tuple[str, object]] | None = None,
) -> RunRequest:
    """Assemble the run that is asked for, computed in this process.

    Nothing is rendered or computed yet.

    Args:
        dataset: as of `run`.
        method: as of `run`.
        settings: as of `run`.
        protocols: by name or file.
        split: as of `run`.
        input_errors: as of `run`.
        out: folder of the run; None for the usual one.
        overwrite: as of `run`.
        named_by: settings that name the usual folder; None for those that are not the default.

    Raises:
        UnknownNameError, UsageError, DataError: as `run`; a protocol twice.
    """
    card = as_card(dataset)
    rules = [load_protocol(protocol) for protocol in protocols]
    if len({protocol.name for protocol in rules}) < len(rules):
        raise UsageError(f"expected each protocol once, got {', '.join(map(str, protocols))}")
    if isinstance(method, str):
        chosen, named = build_scorable(method, settings), method
    elif settings:
        raise UsageError("settings: expected none beside a method that is built already")
    else:
        chosen = require_scorable(method)
        named = chosen.name
    errors = named_input_errors(input_errors or {})
    changed = [*(non_default_settings(chosen, named) if named_by is None else named_by), *errors.named.items()]
    return RunRequest(
        card=card,
        method=chosen,
        folder=default_folder(card, chosen.name, changed, split) if out is None else run_folder(out),
        protocols=rules,
        settings=settings or {},
        split=split,
        input_errors=errors,
        overwrite=overwrite,
    )


def load_run(folder: str | Path) -> Run:
    """Read a stored run.

    Raises:
        DataError: missing, damaged, or of an unknown version.
    """
    return Run(stored=read_run(Path(folder)))


def run_folder(place: str | Path | Run) -> Path:
    """The folder of a run that a user names.

    Raises:
        UsageError: an empty name, or an address.
    """
    if isinstance(place, Run):
        return place.folder
    if not str(place):
        raise UsageError("expected a folder, got an empty name")
    if "://" in str(place):
        hint = "copy the run's folder with the storage's own tool (docs/large-runs.md)"
        raise UsageError(f"expected a folder of this machine, got an address; {hint}")
    return Path(place)


def default_folder(card: DatasetCard, method: str, settings: Iterable[tuple[str, object]], split: str | None) -> Path:
    """Return the folder of a run for which none is given: whatever is not the default is part of its name.

    Args:
        card: the data set.
        method: name of the method.
        settings: those that are not the default, input errors included.
        split: of the data set; None for all.
    """
    words = [card.name, method, *(f"{name}-{value}" for name, value in settings)]
    words += [split] if split is not None else []
    name = re.sub(r"[^A-Za-z0-9_.-]+", "_", "-".join(words))
    if len(name) > LONGEST_NAME:
        name = f"{name[:LONGEST_NAME]}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"
    return RUNS / name


def non_default_settings(method: Scorable, named: str) -> list[tuple[str, object]]:
    """Settings that are not the default; all of a method that cannot be built without any.

    Args:
        method: as it is scored.
        named: what the command line calls it.
    """
    try:
        usual = build_scorable(named).settings()
    except BenchError:
        usual = {}
    return [(name, value) for name, value in method.settings().items() if name not in usual or usual[name] != value]


def _row(row: ObjectMetrics) -> dict[str, float]:
    counts = {"object_frames": row.object_frames, "tracks": row.tracks, "recordings": row.recordings}
    return {**counts, **{name: row.metric(name).value for name in row.metric_names()}}
