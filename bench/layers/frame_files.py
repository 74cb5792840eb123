"""Folders with one file for each frame."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from bench.errors import DataError
from bench.layers.layer import LayerOptions
from bench.recordings import Recording
from bench.recordings.paths import refuse_escape

LARGEST_BYTES = 100_000_000  # of one file; a frame with a thousand boxes has half a million


def frame_files(source: Path, suffix: str, *, folders: tuple[str, ...] = (), without: Iterable[str] = ()) -> list[Path]:
    """The files of a tool's frames, by name.

    Args:
        source: their folder, or one that holds it.
        suffix: of the files, with its dot.
        folders: names that the folder can have in `source`.
        without: names of files that are no frames.

    Raises:
        DataError: no such files, more than one of the folders, a link that leads out of `source`, a file that is
            too large.
    """
    if not source.is_dir():
        raise DataError(source, expected=f"a folder of {suffix} files", got="a file" if source.exists() else "nothing")
    inner = [source / name for name in folders if (source / name).is_dir()]
    if len(inner) > 1:
        do = f"give the one that is meant, for example {inner[0]}"
        raise DataError(source, expected="one folder of labels", got=" and ".join(path.name for path in inner), do=do)
    folder = inner[0] if inner else source
    left_out = set(without)
    files = sorted(
        path
        for path in folder.iterdir()
        if path.suffix == suffix and not path.name.startswith(".") and path.name not in left_out
    )
    if not files:
        also = "".join(f" or {name}/" for name in folders)
        raise DataError(folder, expected=f"files <frame>{suffix}, here{also}", got="none")
    for file in files:
        refuse_escape(source, file, file=file)
        if not file.is_file():
            raise DataError(file, expected="a file", got="a folder or nothing behind a link")
        if file.stat().st_size > LARGEST_BYTES:
            raise DataError(file, expected=f"at most {LARGEST_BYTES} bytes", got=str(file.stat().st_size))
    return files


def refuse_other_frames(folder: Path, suffix: str, names: Iterable[str], *, without: Iterable[str] = ()) -> None:
    """Refuse to write frames beside others: the old ones would be read as if they belonged to the new.

    Args:
        folder: where files are to be written, in the folder that the user gives; it need not exist.
        suffix: of the files, with its dot.
        names: of the frames to be written; files of these names are replaced.
        without: names of files that are no frames.

    Raises:
        DataError: other frames lie there, or the folder is a link that leads elsewhere.
    """
    refuse_escape(folder.parent, folder, file=folder)
    written = {f"{name}{suffix}" for name in names} | set(without)
    found = sorted(path.name for path in folder.glob(f"*{suffix}")) if folder.is_dir() else []
    others = [name for name in found if name not in written and not name.startswith(".")]
    if others:
        expected = f"no frames but the {len(written) - len(set(without))} that are written"
        raise DataError(
            folder, expected=expected, got=f"{len(others)} others, as {others[0]}", do="give another folder"
        )


def frame_names(recording: Recording, options: LayerOptions) -> dict[int, str]:
    """Sweep's time -> name of its frame: that of the sweep's file, since tools name labels after point clouds.

    Counted numbers of six digits where the user gives the number of the first frame; times where sweeps share a file.
    """
    stems = [sweep.path.stem for sweep in recording.sweeps]
    if options.first_frame:
        stems = [f"{options.first_frame + i:06d}" for i in range(len(stems))]
    elif len(set(stems)) < len(stems):
        stems = [str(sweep.timestamp_ns) for sweep in recording.sweeps]
    return {sweep.timestamp_ns: stem for sweep, stem in zip(recording.sweeps, stems, strict=True)}
