"""A run reduced to what the gate judges; stored in a file, it is a baseline."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

import pandas as pd
from pydantic import Field

from bench.errors import UsageError
from bench.evaluation import Protocol, sum_run
from bench.evaluation.definitions import COUNTS, Definition, image_metrics, object_metrics
from bench.evaluation.summary import ProtocolStamp
from bench.evaluation.sums import (
    ALL_MOVING,
    CATEGORY,
    FRAMES,
    KEY,
    TERMS,
    cameras_of,
    frame_slices,
    name_slice,
    object_slices,
)
from bench.harness import open_tables, read_protocol, read_run
from bench.harness.manifest import CodeOfRun, DatasetOfRun, Manifest
from bench.harness.method_stamp import MethodStamp
from bench.recordings.cards import shipped_folder
from bench.recordings.sealed_json import read_sealed, write_sealed
from bench.recordings.validation import FileModel

BASELINES = Path("reports/baselines")
USUAL_PROTOCOL = "paper-v1"
SCHEMA_VERSION: Literal[1] = 1
ONE_LINE_DEPTH = 4  # of the stored JSON: the sums of one metric of one slice, so that a diff shows what changed


class MissingBaselineError(UsageError):
    """There is no baseline to judge by, which is never a pass."""

    def __init__(self, file: Path) -> None:
        self.file = file
        super().__init__(f"{file}: no baseline there, so nothing was judged; make one with --update")

    def __reduce__(self) -> tuple[object, ...]:
        return MissingBaselineError, (self.file,)


class Origin(FileModel):
    """What made the values.

    Attributes:
        version: of the package.
        commit: of the checkout, "+" behind it where files were changed, or that pip installed; None where unknown.
        python: version of the interpreter.
        libraries: their versions.
        started_utc: of the run, ISO 8601.
        unrepeatable: code that nobody else can have again, one line a file.
    """

    version: str
    commit: str | None
    python: str
    libraries: dict[str, str]
    started_utc: str
    unrepeatable: tuple[str, ...] = ()


class MetricSums(FileModel):
    """One metric of one slice as the ratio of two sums.

    Attributes:
        numerators: by recording; only recordings that hold cases.
        denominators: by recording, > 0.
    """

    numerators: dict[str, float]
    denominators: dict[str, float]

    @property
    def cases(self) -> int:
        """The cases of the metric: object-frames, image-frames, or pixels for the segmentation metrics."""
        return int(math.fsum(self.denominators.values()))


class RecordingSums(FileModel):
    """The table of sums of a run as a baseline stores it: every metric that has a direction.

    Attributes:
        slices: slice -> metric -> sums. Slices are the categories, "all_moving", "frames" (the image-frames), and
            "<breakdown>=<bin or name>" for the breakdowns of the summary, for example "range_m=[0, 2)".
        counts: slice -> name -> number. "object_frames", "tracks" and "recordings" for slices of objects;
            "all_moving" also has "annotated", "static", "ignored"; "frames" has "images", "evaluated", "failed",
            "skipped".
    """

    slices: dict[str, dict[str, MetricSums]]
    counts: dict[str, dict[str, int]]

    @classmethod
    def of(cls, sums: pd.DataFrame, *, protocol: Protocol) -> RecordingSums:
        """Store a table of sums."""
        cameras = cameras_of(sums)
        found = {key: part.set_index("recording") for key, part in sums.groupby(["breakdown", "slice", "metric"])}
        slices: dict[str, dict[str, MetricSums]] = {}
        counts: dict[str, dict[str, int]] = {}
        for splits, metrics, counted in (
            (object_slices(protocol, cameras), _judged(object_metrics(protocol.scoring.detection_levels)), "iou"),
            (frame_slices(protocol, cameras), _judged(image_metrics()), "false_positive_coverage"),
        ):
            for breakdown, name in ((breakdown, name) for breakdown, names in splits.items() for name in names):
                called = name_slice(breakdown, name)
                own = {m.name: _metric_sums(found.get((breakdown, name, m.name))) for m in metrics}
                slices[called] = slices.get(called, {}) | own
                rows, tracks = own[counted], _metric_sums(found.get((breakdown, name, "tracks")))
                numbers = {"object_frames": rows.cases, "tracks": int(math.fsum(tracks.numerators.values()))}
                numbers["recordings"] = len(rows.denominators)
                counts[called] = counts.get(called, {}) | (numbers if counted == "iou" else {"frames": rows.cases})
        ledger = {metric: sums[(sums["breakdown"] == "status") & (sums["metric"] == metric)] for metric in COUNTS}
        for called, metric, statuses in (
            (ALL_MOVING, "annotated", ("static", "ignored")),
            (FRAMES, "images", ("evaluated", "failed", "skipped")),
        ):
            numerators = ledger[metric].groupby("slice")["numerator"].sum()
            counts[called] |= {metric: int(numerators.sum())} | {s: int(numerators.get(s, 0)) for s in statuses}
        return cls(slices=slices, counts=counts)

    def table(self) -> pd.DataFrame:
        """The table of sums again, without the counts."""
        return pd.DataFrame([*self._rows()], columns=[*KEY, *TERMS])

    def _rows(self) -> Iterator[tuple[str, str, str, str, float, float]]:
        for called, metrics in self.slices.items():
            breakdown, _, name = called.partition("=") if "=" in called else (CATEGORY, "", called)
            for metric, sums in metrics.items():
                for recording, denominator in sums.denominators.items():
                    yield breakdown, name, recording, metric, sums.numerators[recording], denominator


def _judged(metrics: Sequence[Definition]) -> list[Definition]:
    """Those that are stored; F1 follows from precision and recall."""
    return [metric for metric in metrics if metric.higher_is_better is not None and metric.name != "f1"]


def _metric_sums(sums: pd.DataFrame | None) -> MetricSums:
    held = sums[sums["denominator"] > 0] if sums is not None else pd.DataFrame(columns=TERMS)
    return MetricSums(numerators=held["numerator"].to_dict(), denominators=held["denominator"].to_dict())


class ScoredRun(FileModel):
    """What the gate compares.

    Attributes:
        schema_version: of the file.
        dataset: name of the data set.
        split: of it; None for all of it.
        protocol: of the run.
        method: that was scored.
        reference_fingerprint: of the run.
        data_fingerprint: of the run.
        recordings: the first characters of the fingerprint of each recording's data; empty in older baselines.
        origin: where it comes from.
        failures: of the run; none in a baseline.
        sheet: sums of every metric by slice and recording, and the counts.
    """

    schema_version: Literal[1]
    dataset: str
    split: str | None
    protocol: ProtocolStamp
    method: MethodStamp
    reference_fingerprint: str
    data_fingerprint: str
    origin: Origin
    recordings: dict[str, str] = Field(default_factory=dict)
    failures: tuple[str, ...] = ()
    sheet: RecordingSums

    @property
    def manifest(self) -> Manifest:
        """The manifest of the run, for as far as a baseline holds it."""
        names = ("version", "commit", "python", "libraries")
        return Manifest(
            dataset=DatasetOfRun(
                name=self.dataset, card="", split=self.split, data=self.data_fingerprint, recordings=self.recordings
            ),
            method=self.method,
            protocol=self.protocol,
            code=CodeOfRun(**{name: getattr(self.origin, name) for name in names}),
            reference=self.reference_fingerprint,
        )


def scored_run(run: Path) -> ScoredRun:
    """Reduce a stored run.

    Raises:
        DataError: a file of the run is missing or damaged, or they are not of one run.
    """
    summary = read_run(run)
    protocol = read_protocol(run, summary)
    objects, frames = open_tables(run)
    of = summary.manifest
    return ScoredRun(
        schema_version=SCHEMA_VERSION,
        dataset=of.dataset.name,
        split=of.dataset.split,
        protocol=summary.protocol,
        method=of.method,
        reference_fingerprint=str(of.reference),
        data_fingerprint=str(of.dataset.data),
        recordings=of.dataset.recordings,
        origin=Origin(
            version=of.code.version,
            commit=of.code.commit,
            python=of.code.python,
            libraries=of.code.libraries,
            started_utc=summary.provenance.started_utc,
            unrepeatable=summary.provenance.unrepeatable,
        ),
        failures=summary.failures,
        sheet=RecordingSums.of(sum_run(objects, frames, protocol=protocol), protocol=protocol),
    )


def own_baseline(run: ScoredRun) -> Path:
    """Where the baseline of a run lies unless another file is named, below the working folder."""
    words = [run.dataset, *([] if run.protocol.name == USUAL_PROTOCOL else [run.protocol.name])]
    return BASELINES / f"{'-'.join(words)}.json"


def usual_baseline(run: ScoredRun) -> Path:
    """What a run is judged by unless another file is named: the own baseline, else one that ships with the package."""
    own = own_baseline(run)
    shipped = shipped_folder("baselines") / own.name
    return shipped if shipped.is_file() and not own.is_file() else own


def read_baseline(file: Path) -> ScoredRun:
    """Read a baseline.

    Raises:
        MissingBaselineError: no such file.
        DataError: not a baseline; names the field.
    """
    if not file.exists():
        raise MissingBaselineError(file)
    return read_sealed(ScoredRun, file, expected="a baseline", strict=True)


def write_baseline(run: ScoredRun, file: Path, *, allow_dirty: bool = False) -> None:
    """Store a run as the baseline, whole or not at all.

    Raises:
        UsageError: the run has failures, or was made by code that nobody else can have, changed or untracked or of no
            distribution, and `allow_dirty` is not set.
    """
    if run.failures:
        count = len(run.failures)
        raise UsageError(f"a run with failures makes no baseline; this one has {count}, the first: {run.failures[0]}")
    commit = run.origin.commit
    if commit is not None and commit.endswith("+") and not allow_dirty:
        raise UsageError(
            f"when it ran, there were changed files on top of commit {commit[:12]}, which nobody can repeat; "
            "commit them and run again, or say --allow-dirty"
        )
    unrepeatable = run.origin.unrepeatable
    if unrepeatable and not allow_dirty:
        more = f" and {len(unrepeatable) - 1} more" if len(unrepeatable) > 1 else ""
        raise UsageError(
            f"when it ran, the run was of code that nobody else can have: {unrepeatable[0]}{more}; "
            "commit or install it and run again, or say --allow-dirty"
        )
    write_sealed(file, run, exclude_defaults=True, layout=_text)


def _text(value: object, depth: int = 0) -> str:
    """JSON with one line for each part at `ONE_LINE_DEPTH`."""
    if not isinstance(value, dict) or not value or depth == ONE_LINE_DEPTH:
        return json.dumps(value, sort_keys=True, allow_nan=False)
    indent = " " * (depth + 1)
    parts = [f"{indent}{json.dumps(key)}: {_text(part, depth + 1)}" for key, part in value.items()]
    return "{\n" + ",\n".join(parts) + "\n" + " " * depth + "}"
