"""A whole scenario, rendered in parallel, resumed where it was interrupted.

`synthesis.json` in the folder of each recording says what it was made from, and the digest of each of its files. A
recording is rendered again when the former changes or files are missing. Only files that are as they were rendered are
ever removed.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Collection, Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

from bench.atomic import folder_lock, make_folder, write_text
from bench.errors import DataError, UsageError
from bench.execution import FailedTask, local_executor, usable_cores
from bench.synthesis.reading import read_scenario
from bench.synthesis.recorder import render_recording
from bench.synthesis.scenario import RecordingSpec, Scenario

GENERATOR_VERSION = 7  # raise it whenever the same scenario gives other bytes
MANIFEST = "synthesis.json"
UNFINISHED = ".unfinished"

Progress = Callable[[int, int], None]


def _rendered(scenario: Scenario, specs: list[RecordingSpec], out: Path, workers: int) -> Iterator[RecordingSpec]:
    executor = local_executor(min(workers, len(specs)))
    with executor, closing(executor.compute(partial(_produce, scenario=scenario, out=out), specs)) as results:
        for spec, outcome in results:
            if isinstance(outcome, FailedTask):
                hint = "call it again, with fewer workers where memory is short; what is rendered stays"
                raise DataError(out / spec.name, expected="a rendered recording", got=outcome.reason, hint=hint)
            yield spec


def _produce(spec: RecordingSpec, *, scenario: Scenario, out: Path) -> None:
    """Render one recording in a temporary folder, then move it."""
    unfinished, final = out / UNFINISHED / spec.name, out / spec.name
    shutil.rmtree(unfinished, ignore_errors=True)
    render_recording(scenario, spec, unfinished)
    manifest = _origin(scenario, spec) | {"files": _digests(unfinished)}
    write_text(unfinished / MANIFEST, json.dumps(manifest, indent=1) + "\n")
    if final.exists():
        _refuse_edited(final)
        shutil.rmtree(final)
    unfinished.replace(final)


def _origin(scenario: Scenario, spec: RecordingSpec) -> dict[str, Any]:
    """Digest of what a recording is made from: the generator, the sensors and the recording's own lines."""
    shared = scenario.model_dump(mode="json", exclude={"recordings"})
    content = json.dumps([GENERATOR_VERSION, shared, spec.model_dump(mode="json")], sort_keys=True)
    digest = hashlib.sha256(content.encode()).hexdigest()
    return {"scenario": scenario.name, "recording": spec.name, "digest": digest}


def _digests(folder: Path) -> dict[str, str]:
    """SHA-256 of a recording's files by name, its manifest left out; "" for what is no file, such as a link."""
    return {
        path.relative_to(folder).as_posix(): "" if path.is_symlink() else hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.name != MANIFEST and (path.is_symlink() or not path.is_dir())
    }


def _is_rendered(folder: Path, scenario: Scenario, spec: RecordingSpec) -> bool:
    """Return True where a recording made from the same lines is there, with all of its files."""
    found = _read_manifest(folder)
    complete = bool(found["files"]) and all((folder / name).is_file() for name in found["files"])
    return complete and _origin(scenario, spec).items() <= found.items()


def _read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest; one without files where there is none."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        manifest = None
    held = isinstance(manifest, dict) and isinstance(manifest.get("files"), dict)
    return manifest if held else {"files": {}}


def _is_as_rendered(folder: Path) -> bool:
    """Return True where nothing is in a folder but files of its manifest, unchanged; some may be missing."""
    files = _read_manifest(folder)["files"]
    return bool(files) and not folder.is_symlink() and _digests(folder).items() <= files.items()


def _refuse_edited(folder: Path) -> None:
    if not _is_as_rendered(folder):
        expected = "no such folder, or a recording as synthesize rendered it"
        got = "one with files that are of others or were changed"
        hint = "it has to be rendered again: move it away, or render into another folder"
        raise DataError(folder, expected=expected, got=got, hint=hint)


def _remove_former(scenario: Scenario, out: Path) -> None:
    """Remove recordings that this scenario rendered and no longer has, where nobody changed or copied them."""
    names = {spec.name for spec in scenario.recordings}
    for folder in sorted(path for path in out.iterdir() if path.is_dir() and path.name not in names):
        ours = {"scenario": scenario.name, "recording": folder.name}.items() <= _read_manifest(folder).items()
        if ours and _is_as_rendered(folder):
            shutil.rmtree(folder)


def synthesize(
    scenario_path: str | Path,
    out: str | Path,
    *,
    only: Collection[str] | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> list[Path]:
    """Render every recording of a scenario that is not there yet.

    A recording is rendered in a temporary folder and then moved. What is there is kept if it was made by the same
    generator from the same lines of the scenario and no file is missing, and replaced otherwise; recordings that the
    scenario no longer has are removed. Files that were added or changed since, and copies, are never removed: where
    one is in the way, nothing is rendered. Recordings do not depend on each other, on the order or on the number of
    workers. A second call for the same folder waits until the first is done, and then finds everything there.

    Args:
        scenario_path: the scenario file.
        out: folder of the recordings.
        only: recordings that are wanted; None for all.
        workers: processes; None for one per core that this process may use.
        progress: called with the numbers of finished and of all recordings.

    Returns:
        Folders of the recordings, in the scenario's order.

    Raises:
        DataError: the scenario is not one, or a folder in the way is not as `synthesize` made it.
        UsageError: fewer than one worker.
    """
    if workers is not None and workers < 1:
        raise UsageError(f"workers: expected at least 1, got {workers}")
    scenario, out = read_scenario(Path(scenario_path)), Path(out)
    make_folder(out)
    with folder_lock(out):
        _remove_former(scenario, out)
        wanted = [spec for spec in scenario.recordings if only is None or spec.name in only]
        missing = [spec for spec in wanted if not _is_rendered(out / spec.name, scenario, spec)]
        for spec in missing:
            if (out / spec.name).exists():
                _refuse_edited(out / spec.name)
        done, total = len(wanted) - len(missing), len(wanted)
        if progress is not None:
            progress(done, total)
        for count, _ in enumerate(_rendered(scenario, missing, out, workers or usable_cores()), start=done + 1):
            if progress is not None:
                progress(count, total)
        shutil.rmtree(out / UNFINISHED, ignore_errors=True)
    return [out / spec.name for spec in wanted]
