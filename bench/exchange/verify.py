"""Does a run hold what its masks score? Recounted from the stored masks and the data, without the method.

Three steps, each compared exactly: masks and data give the tables of objects and images, tables give sums, sums give
the summary. The stored masks are scored as any method's answers are. Beside them the manifest must say what data,
protocol and reference these are.

A run has a mask of every image that its data allow to score: one that leaves out what it fails on would gain by it.

Two things come from the method alone, so that only their sums are checked: the causes of false positives, and the
likelihood, with the metrics over all thresholds. Who made the masks cannot be told.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, ConfigDict

from bench.errors import DataError
from bench.evaluation import (
    FRAMES_SCHEMA,
    OBJECTS_SCHEMA,
    ImageMap,
    Summary,
    known_protocols,
    load_protocol,
    sum_run,
    summary_of,
    threshold_free_metrics,
)
from bench.evaluation.comparison import SIDES
from bench.evaluation.rows import EVALUATED, IMAGE, NOT_ANNOTATED, OBJECT, merge_rows
from bench.evaluation.sums import KEY, TERMS
from bench.execution import TaskExecutor
from bench.harness.digests.content import FileDigests
from bench.harness.manifest import MANIFEST, Aspect, CodeOfRun, differences
from bench.harness.masks import MASKS
from bench.harness.replay import NO_MASK, StoredMasks
from bench.harness.run import RunRequest, run_benchmark
from bench.harness.run_folder import add_own_files
from bench.harness.stages import Progress
from bench.harness.stored import HISTOGRAMS, SUMMARY, SUMS, StoredRun, open_tables, read_image_maps, read_run
from bench.plain_text import listed
from bench.recordings import DatasetCard
from bench.recordings.checked_json import read_checked, write_checked

VERIFIED = "verified.json"
BY_METHOD = {*HISTOGRAMS, "fp_by_cause", "problem"}  # columns of images that cannot be counted without it
CHECKED = {Aspect.DATASET, Aspect.SPLIT, Aspect.PROTOCOL, Aspect.DATA, Aspect.REFERENCE}
RELATIVE = 1e-9  # of what is no count: sums and metrics may be added in another order


class Verified(BaseModel):
    """`verified.json`, which says that a run was recounted on this machine; no bundle carries it.

    Attributes:
        summary: digest of the summary that was found right.
        utc: when.
        code: that counted.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    summary: str
    utc: str
    code: CodeOfRun


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """Outcome of a recount.

    Attributes:
        images: that were counted again.
        differences: one line each; none for a run that holds what its masks score.
    """

    images: int
    differences: tuple[str, ...]


def verify_run(
    run: Path, card: DatasetCard, *, executor: TaskExecutor, progress: Progress | None = None
) -> Verification:
    """Recount a run, and mark it as verified where nothing differs; an older mark goes where something does.

    Args:
        run: folder of the results.
        card: the data that it is of.
        executor: counts the images.
        progress: called with the images done and their number.

    Raises:
        DataError: a file of the run or of the data is missing or damaged.
    """
    (run / VERIFIED).unlink(missing_ok=True)
    stored = read_run(run)
    method = StoredMasks.of(stored)
    with TemporaryDirectory(prefix="fisheye-bench-") as folder:
        recount = Path(folder) / "recount"
        request = RunRequest(
            card=card, method=method, runs={recount: stored.protocol}, split=stored.manifest.dataset.split,
            executor=executor, progress=progress,
        )  # fmt: skip
        again = run_benchmark(request)[recount]
        found = (*_of_manifest(stored, again), *_of_masks(stored), *_of_tables(run, recount), *_of_maps(run, recount))
    sums = sum_run(stored.objects, stored.frames, protocol=stored.protocol)
    found += (
        *_of_rows(SUMS, stored.sums, sums, key=KEY, columns=TERMS),
        *_of_summary(stored, summary_of(sums, protocol=stored.protocol)),
    )
    if not found:
        _mark(run)
    return Verification(images=again.summary.provenance.images, differences=found)


def is_verified(run: Path) -> bool:
    """True where the summary of a run is the one that was found right on this machine."""
    try:
        mark = read_checked(Verified, run / VERIFIED, expected="the mark of a verified run")
    except DataError:
        return False
    return mark.summary == FileDigests().of(run / SUMMARY)


def _mark(run: Path) -> None:
    digest = FileDigests().of(run / SUMMARY)
    mark = Verified(summary=digest, utc=f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}", code=CodeOfRun.here())
    add_own_files(run, [run / VERIFIED])
    write_checked(run / VERIFIED, mark)


def _of_manifest(run: StoredRun, again: StoredRun) -> Iterator[str]:
    """Differences of what the run says that it is of, and of what a reader is told beside the metrics."""
    was, now, summary = run.manifest, again.manifest, run.summary
    yield from (f"{MANIFEST}: {one}" for one in differences(was, now) if one.aspect in CHECKED)
    if was.dataset.recordings != now.dataset.recordings:
        yield f"{MANIFEST}: recordings of other data"
    if was.sums is None:
        yield f"{MANIFEST}: expected the digest of {SUMS}, got none"
    if was.protocol != now.protocol:
        yield f"{MANIFEST}: protocol of another name, version or digest"
    if was.protocol.name in known_protocols() and was.protocol.digest != load_protocol(was.protocol.name).digest:
        yield f"protocol.json: rules of its own under the name {was.protocol.name}"
    if missing := [line for line in again.summary.caveats.splitlines() if line not in summary.caveats.splitlines()]:
        yield f"{SUMMARY}: caveats lack {missing[0]!r}"
    if summary.images.failed > len(summary.failures):
        yield f"{SUMMARY}: failures lists {len(summary.failures)}, where {summary.images.failed} images failed"
    if summary.vehicle_outline_m != again.summary.vehicle_outline_m:
        yield f"{SUMMARY}: another outline of the vehicle"


def _of_masks(run: StoredRun) -> Iterator[str]:
    """Images with a mask must be those that were scored, each once."""
    masks = pq.read_table(run.masks, columns=IMAGE).to_pandas()
    rows = run.frames.read(sorted(run.frames.recordings()), [*IMAGE, "status"])
    scored = rows[rows["status"].isin([EVALUATED, NOT_ANNOTATED])][IMAGE]
    if [*masks.sort_values(IMAGE).itertuples(index=False)] != [*scored.sort_values(IMAGE).itertuples(index=False)]:
        yield f"{MASKS}: expected one of each of {len(scored)} scored images, got {len(masks)} of others"


def _of_tables(run: Path, recount: Path) -> Iterator[str]:
    keys: tuple[tuple[list[str], pa.Schema], ...] = (OBJECT, OBJECTS_SCHEMA), (IMAGE, FRAMES_SCHEMA)
    for stored, counted, (key, schema) in zip(open_tables(run), open_tables(recount), keys, strict=True):
        columns = [name for name in schema.names if name not in (*key, *BY_METHOD)]
        for recording in sorted(stored.recordings().keys() | counted.recordings().keys()):
            sides = [rows.read([recording], [*key, *columns]) for rows in (stored, counted)]
            yield from _of_rows(stored.file.name, *sides, key=key, columns=columns)
    rows = counted.read(sorted(counted.recordings()), [*IMAGE, "problem"])
    left_out = rows[rows["problem"] == NO_MASK]
    if len(left_out):
        yield _line(stored.file.name, left_out, IMAGE, "no mask, though the data allow to score the image")


def _of_rows(
    file: str, stored: pd.DataFrame, counted: pd.DataFrame, *, key: Sequence[str], columns: Sequence[str]
) -> Iterator[str]:
    """One line for each column in which rows differ, with the first of them."""
    twice = stored[stored.duplicated([*key])]
    if len(twice):
        yield _line(file, twice, key, "a row that stands twice")
        return
    rows = merge_rows(stored, counted, on=[*key], how="outer")
    alone = rows["side"] != "both"
    if alone.any():
        yield _line(file, rows[alone], key, "a row that only one of the two has")
    rows = rows[~alone]
    for name in columns:
        was, now = (rows[f"{name}{side}"] for side in SIDES)
        same = was.eq(now) | (was.isna() & now.isna())
        if was.dtype == now.dtype == np.float64:  # another processor may tip the last bit of a speed or place
            same |= np.isclose(was, now, rtol=RELATIVE, atol=RELATIVE)
        other = ~same.to_numpy(dtype=bool)
        if other.any():
            values = was[other].iloc[0], now[other].iloc[0]
            yield _line(file, rows[other], key, "{} {}, recounted {}".format(name, *values))


def _line(file: str, rows: pd.DataFrame, key: Sequence[str], what: str) -> str:
    where = ", ".join(str(rows[name].iloc[0]) for name in key)
    more = f", and {len(rows) - 1} more" if len(rows) > 1 else ""
    return f"{file}: {where}: {what}{more}"


def _of_maps(run: Path, recount: Path) -> Iterator[str]:
    maps = [read_image_maps(folder) for folder in (run, recount)]
    for name in sorted(maps[0].keys() | maps[1].keys()):
        was, now = (found.get(name) for found in maps)
        fields = ImageMap.__slots__
        if was is None or now is None or not all(np.array_equal(getattr(was, f), getattr(now, f)) for f in fields):
            yield f"image_maps.npz: {name}: another map"


def _of_summary(run: StoredRun, counted: Summary) -> Iterator[str]:
    curve, metrics = threshold_free_metrics(run.frames), {*type(counted).model_fields}
    was = run.summary.model_dump(mode="json", include={*metrics, "threshold_free"})
    now = counted.model_dump(mode="json", include=metrics)
    now["threshold_free"] = None if curve is None else curve.model_dump(mode="json")
    other = [line for name in was for line in _unequal(name, was[name], now[name])]
    if other:
        yield f"{SUMMARY}: {listed(other, 2)}"


def _unequal(place: str, was: object, now: object) -> Iterator[str]:
    """Places in which two plain values differ by more than rounding."""
    if isinstance(was, Mapping) and isinstance(now, Mapping):
        for name in sorted(was.keys() | now.keys()):
            yield from _unequal(f"{place}.{name}", was.get(name), now.get(name))
    elif isinstance(was, Sequence) and isinstance(now, Sequence) and not isinstance(was, str):
        for number, pair in enumerate(zip(was, now, strict=True) if len(was) == len(now) else [(was, "others")]):
            yield from _unequal(f"{place}[{number}]", *pair)
    elif isinstance(was, float) and isinstance(now, float):
        if not np.isclose(was, now, rtol=RELATIVE, atol=RELATIVE):
            yield f"{place} {was:g}, recounted {now:g}"
    elif was != now:
        yield f"{place} {was}, recounted {now}"
