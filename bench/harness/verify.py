"""Does a run hold what its answers score? Counted again from the stored answers and the data, without the method.

Manifest, counts, sums and summary are made once more and compared: whole numbers and words exactly. Who made the
answers cannot be told. That a run was found right is noted in the cache of whoever verified it, never in the run.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd

from bench.atomic import write_text
from bench.errors import OutputError
from bench.evaluation.sums import KEY
from bench.execution import Progress, TaskExecutor
from bench.harness.answers import is_answered, segmentation_of
from bench.harness.counts import TABLES, TableName, read_counts, stored_recordings
from bench.harness.digests import digest_file
from bench.harness.manifest import MANIFEST, Aspect, differences
from bench.harness.references import cache_folder
from bench.harness.run import RunRequest, run_benchmark
from bench.harness.stored import SUMMARY, SUMS, StoredRun, find_answer, read_run
from bench.methods import Method, MethodInput, Segmentation, UnansweredImage
from bench.recordings import DatasetCard

CHECKED = {Aspect.DATASET, Aspect.SPLIT, Aspect.PROTOCOL, Aspect.DATA, Aspect.REFERENCE}
UNCHECKED = {"provenance", "failures"}  # of a summary
RELATIVE = 1e-9  # of what is no count: another processor may tip the last bit


class StoredAnswers(Method):
    """Answers as a run did, in place of the method that made the answers; it reads no images.

    Args:
        answers: folder of the run's answers.
        history: images that the run's method needs before one.
    """

    name = "stored-answers"
    reads_images = False

    def __init__(self, answers: str, history: int) -> None:
        self.answers, self.history = answers, history

    def segment(self, frame: MethodInput) -> Segmentation:
        """The answer of the current image.

        Raises:
            UnansweredImage: the run has none, and says why.
            DataError: the run's answers are damaged.
        """
        answer = find_answer(Path(self.answers), frame.recording, frame.camera_name, frame.timestamps_ns[-1])
        if answer is None or not is_answered(answer):
            tuple(frame.images)  # one that cannot be read fails here, as it did in the run
            raise UnansweredImage("the run holds no answer, though the data allow to score the image")
        return segmentation_of(answer)


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """Outcome of a recount.

    Attributes:
        images: that were counted again.
        differences: one line each; none for a run that holds what its answers score.
    """

    images: int
    differences: tuple[str, ...]


def verify_run(
    run: Path, card: DatasetCard, *, executor: TaskExecutor, progress: Progress | None = None
) -> Verification:
    """Count a run again, and note that it is right where nothing differs.

    Args:
        run: folder of the run, or of its results by a protocol.
        card: the data that it is of.
        executor: counts the images.
        progress: called with the images done and their number.

    Raises:
        DataError: a file of the run or of the data is missing or damaged.
    """
    stored = read_run(run)
    with TemporaryDirectory(prefix="fisheye-bench-") as folder:
        request = RunRequest(
            card=card,
            method=StoredAnswers(str(stored.answers.absolute()), stored.manifest.method.history),
            folder=Path(folder) / "recount",
            protocols=[stored.protocol],
            split=stored.manifest.dataset.split,
        )
        (again,) = run_benchmark(request, executor=executor, progress=progress).results
        found = (
            *_of_manifest(stored, again),
            *_of_counts("objects", stored.folder, again.folder),
            *_of_counts("frames", stored.folder, again.folder),
            *_of_rows(SUMS, KEY, stored.sums, again.sums),
            *_of_summary(stored, again),
        )
    if not found:
        with suppress(OutputError):  # a cache that cannot be written
            write_text(_mark(stored), f"{stored.manifest.title}\n")
    return Verification(images=again.summary.provenance.images, differences=found)


def is_verified(run: StoredRun) -> bool:
    """True where these results were found right with this user's cache folder."""
    return _mark(run).is_file()


def _mark(run: StoredRun) -> Path:
    digests = [digest_file(run.folder / name) for name in (MANIFEST, SUMMARY, SUMS)]
    return cache_folder() / "verified" / "-".join(digest[:32] for digest in digests)


def _of_manifest(run: StoredRun, again: StoredRun) -> Iterator[str]:
    """Differences of what the run says that it is of, and of what a reader is told beside the metrics."""
    was, summary = run.manifest, run.summary
    yield from (f"{MANIFEST}: {one}" for one in differences(was, again.manifest) if one.aspect in CHECKED)
    if missing := [line for line in again.summary.caveats.splitlines() if line not in summary.caveats.splitlines()]:
        yield f"{SUMMARY}: caveats lack {missing[0]!r}"
    if summary.images.failed > len(summary.failures):
        yield f"{SUMMARY}: failures lists {len(summary.failures)}, where {summary.images.failed} images failed"


def _of_counts(table: TableName, *runs: Path) -> Iterator[str]:
    whole, key = TABLES[table]
    for recording in sorted({name for run in runs for name in stored_recordings(run)}):
        sides = (read_counts(run, table, recording, whole.names) for run in runs)
        yield from _of_rows(table, key, *sides)


def _of_rows(table: str, key: Sequence[str], stored: pd.DataFrame, counted: pd.DataFrame) -> Iterator[str]:
    """One line for each column in which rows differ, with the first of them; or for rows that only one side has."""
    was, now = (rows.astype(dict.fromkeys(key, object)).set_index([*key]).sort_index() for rows in (stored, counted))
    if not was.index.equals(now.index):
        alone = was.index.symmetric_difference(now.index)
        where = f"the first: {', '.join(map(str, alone[0]))}" if len(alone) else "one of them twice"
        yield f"{table}: {len(was)} rows, counted again {len(now)}; {where}"
        return
    for name in was.columns:
        sides = was[name].tolist(), now[name].tolist()
        others = [number for number, pair in enumerate(zip(*sides, strict=True)) if not _same(*pair)]
        if others:
            values = "{}, counted again {}".format(*(side[others[0]] for side in sides))
            where, more = ", ".join(map(str, was.index[others[0]])), f", and {len(others) - 1} more"
            yield f"{table}: {where}: {name} {values}{more if len(others) > 1 else ''}"


def _of_summary(run: StoredRun, again: StoredRun) -> Iterator[str]:
    was, now = (one.summary.model_dump(mode="json", exclude=UNCHECKED | {"caveats"}) for one in (run, again))
    if not _same(was, now):
        other = sorted(name for name in was.keys() | now.keys() if not _same(was.get(name), now.get(name)))
        yield f"{SUMMARY}: {', '.join(other)}: other metrics than its counts give"


def _same(was: object, now: object) -> bool:
    """Whether two plain values are equal; floats, which are no counts, but for rounding."""
    if isinstance(was, dict) and isinstance(now, dict):
        return was.keys() == now.keys() and all(_same(was[name], now[name]) for name in was)
    if isinstance(was, list | tuple | np.ndarray) and isinstance(now, list | tuple | np.ndarray):
        return len(was) == len(now) and all(_same(*pair) for pair in zip(was, now, strict=True))
    if isinstance(was, dict | list | tuple | np.ndarray) or isinstance(now, dict | list | tuple | np.ndarray):
        return False  # such as a histogram and none
    if isinstance(was, float) and isinstance(now, float):
        return bool(np.isclose(was, now, rtol=RELATIVE, atol=RELATIVE, equal_nan=True))
    return was is now or bool(was == now) or (pd.isna(was) is True and pd.isna(now) is True)  # type: ignore[call-overload]
