"""`sweep.json`: the metrics of every value of a sweep."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict

from bench.evaluation import FalsePositiveMetrics, ObjectMetrics
from bench.harness.method_stamp import MethodStamp
from bench.harness.provenance import Provenance
from bench.harness.sweep.plan import Part, Scale, Value
from bench.recordings.sealed_json import read_sealed, write_sealed

SCHEMA_VERSION = 1
FILE = "sweep.json"
MARK = "fisheye-bench.sweep"  # the runs in a folder with this file are values of a sweep, and no entries of their own


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class SweepRow(_Part):
    """One value.

    Attributes:
        value: of what is swept.
        operating: whether it is the value that method, protocol and input have of themselves.
        settings: of the method.
        protocol_digest: of the rules, which a sweep of the reference changes.
        injected: errors of what the method is told that are not 0, by name.
        categories: metrics by kind of motion.
        all_moving: metrics over all of them.
        false_positives: metrics over the images.
    """

    value: Value
    operating: bool
    settings: dict[str, object]
    protocol_digest: str
    injected: dict[str, float]
    categories: dict[str, ObjectMetrics]
    all_moving: ObjectMetrics
    false_positives: FalsePositiveMetrics


class FlowCalls(_Part):
    """How often the runs of a sweep needed the flow on cells.

    Attributes:
        computed: flows computed.
        read: flows found in the cache; a likelihood that is found there needs none.
    """

    computed: int
    read: int


class SweepResult(_Part):
    """A sweep: all values scored on the same images.

    Attributes:
        schema_version: of this file.
        what: name of the sweep.
        title: of the values, with their unit.
        about: one line.
        part: what a value changes: the method, the reference, or the input that the method is told.
        scale: how the values lie on an axis.
        dataset: name of the data set.
        card: file of the data set's card, as it was named.
        split: of the data set; None for all of it.
        method: with its own settings.
        protocol: name of the rules; those of a row by its digest.
        rows: one per value.
        flow: how often flow was computed and read; 0 and 0 for a method that keeps none.
        provenance: where the result comes from; the data are those of the operating value.
        failures: one line per recording, unit or image that could not be used, by any value; the metrics of all values
            are of the rest.
    """

    schema_version: int
    what: str
    title: str
    about: str
    part: Part
    scale: Scale
    dataset: str
    card: str
    split: str | None
    method: MethodStamp
    protocol: str
    rows: tuple[SweepRow, ...]
    flow: FlowCalls
    provenance: Provenance
    failures: tuple[str, ...]


def write_sweep(folder: Path, result: SweepResult) -> None:
    """Write `sweep.json`; NaN becomes null."""
    write_sealed(folder / FILE, result)


def read_sweep(folder: Path) -> SweepResult:
    """Read `sweep.json`.

    Raises:
        DataError: missing, or not a sweep; names the field.
    """
    return read_sealed(SweepResult, folder / FILE, expected="the result of a sweep")
