"""The adapter `native`: the recordings below a folder."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from bench.recordings.handles import RecordingHandle
from bench.recordings.native import HEAD, NativeOptions, open_native
from bench.recordings.native_salvage import salvage_native
from bench.recordings.validation import validated


def native_recordings(
    root: Path, *, options: Mapping[str, Any], card: Path, annotations: Path | None
) -> tuple[RecordingHandle, ...]:
    """Each folder of `root` that looks like a recording, or `root` itself.

    One without `recording.json` but with images or annotations is listed too: opening it says what is missing.

    Raises:
        DataError: options that do not exist.
    """
    chosen = validated(NativeOptions, options, file=card, field="options")
    folders = [root] if (root / HEAD).is_file() else sorted(path for path in root.glob("[!.]*/") if _is_recording(path))
    handles = []
    for folder in folders:
        how: dict[str, Any] = {
            "evaluated_size_px": chosen.evaluated_size_px,
            "ego_motion": chosen.ego_motion,
            "calibration": chosen.calibration,
            "annotations": None if annotations is None else annotations / f"{folder.name}.json",
        }
        handles.append(
            RecordingHandle(
                name=folder.name,
                opener=partial(open_native, folder, **how),
                salvager=partial(salvage_native, folder, **how),
            )
        )
    return tuple(handles)


def _is_recording(folder: Path) -> bool:
    return any((folder / name).exists() for name in (HEAD, "images", "annotations.json"))
