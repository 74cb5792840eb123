"""A whole scenario, rendered in parallel, resumed where it was interrupted.

Two kinds of files say what is there. `synthesis.json` in the folder of each recording says what it was made from and
how many files it has; a recording is rendered again when the former changes or files are missing. `.synthesis.json`
beside all recordings (the stamp) holds the content of these files, and a digest of the scenario file and of this
package: while it fits, a second call counts the files and knows that there is nothing to do, without drawing the series
of the scenario.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, suppress
from functools import cache, partial
from pathlib import Path
from typing import Any

from bench.errors import DataError, UsageError
from bench.execution import FailedTask, ProcessExecutor, SerialExecutor, TaskExecutor, usable_cores
from bench.recordings import write_text
from bench.recordings.atomic import folder_lock, make_folder
from bench.synthesis.reading import LARGEST_BYTES, read_scenario
from bench.synthesis.recorder import render_recording
from bench.synthesis.scenario import RecordingSpec, Scenario

GENERATOR_VERSION = 6  # raise it whenever the same scenario gives other bytes
STAMP = ".synthesis.json"
MARK = "synthesis.json"
UNFINISHED = ".unfinished"

Progress = Callable[[int, int], None]


def write_stamp(out: Path, scenario: bytes, names: Iterable[str]) -> None:
    """Write that every recording of a scenario is there; a folder that is not writable gets no stamp.

    Args:
        out: folder of the recordings.
        scenario: content of the scenario file.
        names: of the recordings, in the scenario's order.
    """
    with suppress(OSError):
        marks = {name: _mark_text(out / name) for name in names}
        content = {"made_from": _made_from(scenario), "marks": marks}
        write_text(out / STAMP, json.dumps(content, indent=1) + "\n")


def stamped(out: Path, scenario: bytes) -> list[Path] | None:
    """Folders of the recordings if all of them and nothing else are there; None if that takes a closer look.

    Args:
        out: folder of the recordings.
        scenario: content of the scenario file.
    """
    try:
        content = json.loads((out / STAMP).read_text(encoding="utf-8"))
        if content["made_from"] != _made_from(scenario):
            return None
        marks: dict[str, str] = content["marks"]
        folders = {path.name for path in out.iterdir() if path.is_dir()}
        whole = folders == marks.keys() and all(
            mark == _mark_text(out / name) and _no_file_is_missing(out / name, json.loads(mark))
            for name, mark in marks.items()
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return [out / name for name in marks] if whole else None


def _mark_text(folder: Path) -> str:
    return (folder / MARK).read_text(encoding="utf-8")


def _made_from(scenario: bytes) -> str:
    """Digest of everything that decides what the recordings are."""
    return hashlib.sha256(f"{GENERATOR_VERSION} {_source_digest()} ".encode() + scenario).hexdigest()


@cache
def _source_digest() -> str:
    """Digest of this package's source: the stamp also changes when the drawing of a series does."""
    package = Path(__file__).parent
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(f"{path.relative_to(package).as_posix()} ".encode() + path.read_bytes())
    return digest.hexdigest()


def _content(path: Path) -> bytes | None:
    """The bytes of a scenario; None if it cannot be read: reading it raises the better error."""
    try:
        return path.read_bytes() if path.stat().st_size <= LARGEST_BYTES else None
    except OSError:
        return None


def _rendered(scenario: Scenario, specs: list[RecordingSpec], out: Path, workers: int) -> Iterator[RecordingSpec]:
    processes = min(workers, len(specs))
    executor: TaskExecutor = SerialExecutor() if processes <= 1 else ProcessExecutor(workers=processes)
    with executor, closing(executor.compute(partial(_produce, scenario=scenario, out=out), specs)) as results:
        for spec, outcome in results:
            if isinstance(outcome, FailedTask):
                do = "call it again, with fewer workers where memory is short; what is rendered stays"
                raise DataError(out / spec.name, expected="a rendered recording", got=outcome.reason, do=do)
            yield spec


def _produce(spec: RecordingSpec, *, scenario: Scenario, out: Path) -> None:
    """Render one recording in a temporary folder, then move it."""
    unfinished, final = out / UNFINISHED / spec.name, out / spec.name
    shutil.rmtree(unfinished, ignore_errors=True)
    render_recording(scenario, spec, unfinished)
    mark = {**_mark(scenario, spec), "files": _files(unfinished)}
    write_text(unfinished / MARK, json.dumps(mark, indent=1) + "\n")
    if final.exists():
        _refuse_foreign(final)
        shutil.rmtree(final)
    unfinished.replace(final)


def _mark(scenario: Scenario, spec: RecordingSpec) -> dict[str, str]:
    """What a recording was made from: the generator, the sensors and the recording's own lines."""
    shared = scenario.model_dump(mode="json", exclude={"recordings"})
    dry = {} if spec.street.wet else {"street": {"wet"}}  # what was rendered before there was rain stays
    content = json.dumps([GENERATOR_VERSION, shared, spec.model_dump(mode="json", exclude=dry)], sort_keys=True)
    return {"scenario": scenario.name, "fingerprint": hashlib.sha256(content.encode()).hexdigest()}


def _files(folder: Path) -> int:
    """How many files a recording has beside its mark."""
    return sum(name != MARK for _, _, names in os.walk(folder) for name in names)


def _no_file_is_missing(folder: Path, mark: Mapping[str, Any]) -> bool:
    """Whether as many are there as its mark says; those of older versions do not say how many."""
    stated = mark.get("files", 0)
    return not isinstance(stated, int) or _files(folder) >= stated


def _is_there(folder: Path, mark: Mapping[str, str]) -> bool:
    """Whether a recording made from the same lines is there, with all of its files."""
    found = _mark_of(folder)
    return found is not None and mark.items() <= found.items() and _no_file_is_missing(folder, found)


def _mark_of(folder: Path) -> dict[str, Any] | None:
    try:
        mark = json.loads((folder / MARK).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return mark if isinstance(mark, dict) else None


def _refuse_foreign(folder: Path) -> None:
    if _mark_of(folder) is None:
        do = "render into another folder, or move this one away"
        raise DataError(
            folder, expected="no such folder or a recording made by synthesize", got="a folder without its mark", do=do
        )


def _remove_former(scenario: Scenario, out: Path) -> None:
    """Remove recordings of this scenario that it no longer has, and refuse to write over anyone else's."""
    names = {spec.name for spec in scenario.recordings}
    for folder in sorted(path for path in out.iterdir() if path.is_dir() and path.name != UNFINISHED):
        mark = _mark_of(folder)
        if folder.name in names:
            _refuse_foreign(folder)
        elif mark is not None and mark.get("scenario") == scenario.name:
            shutil.rmtree(folder)


def synthesize(
    scenario_path: Path, out: Path, *, workers: int | None = None, progress: Progress | None = None
) -> list[Path]:
    """Render every recording of a scenario that is not there yet.

    A recording is rendered in a temporary folder and then moved. What is there is kept if it was made by the same
    generator from the same lines of the scenario and no file is missing, and replaced otherwise; recordings that the
    scenario no longer has are removed. Recordings do not depend on each other, on the order or on the number of
    workers. A second call for the same folder waits until the first is done, and then finds everything there. A stamp
    in the folder says that everything is there; while it fits, a call only counts the files.

    Args:
        scenario_path: the scenario file.
        out: folder of the recordings.
        workers: processes; None for one per core that this process may use.
        progress: called with the numbers of finished and of all recordings.

    Returns:
        Folders of the recordings, in the scenario's order.

    Raises:
        DataError: the scenario is not one, or a folder in the way was not made by `synthesize`.
        UsageError: fewer than one worker.
    """
    if workers is not None and workers < 1:
        raise UsageError(f"workers: expected at least 1, got {workers}")
    content = _content(scenario_path)
    if content is not None and (folders := stamped(out, content)) is not None:
        if progress is not None:
            progress(len(folders), len(folders))
        return folders
    scenario = read_scenario(scenario_path)
    make_folder(out)
    with folder_lock(out):
        _remove_former(scenario, out)
        missing = [spec for spec in scenario.recordings if not _is_there(out / spec.name, _mark(scenario, spec))]
        done, total = len(scenario.recordings) - len(missing), len(scenario.recordings)
        if progress is not None:
            progress(done, total)
        for count, _ in enumerate(_rendered(scenario, missing, out, workers or usable_cores()), start=done + 1):
            if progress is not None:
                progress(count, total)
        shutil.rmtree(out / UNFINISHED, ignore_errors=True)
        if content is not None and content == _content(scenario_path):  # nobody edited it while it was read
            write_stamp(out, content, [spec.name for spec in scenario.recordings])
    return [out / spec.name for spec in scenario.recordings]
