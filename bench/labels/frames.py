"""The frames of a tool are the recording's sweeps; this pairs their names or numbers, always by key.

A frame is called, and these are tried in turn for all frames of a source at once:

1. as the file of its sweep without the suffix,
2. by the same number as that file, whatever its leading zeros,
3. by the sweep's time in nanoseconds,
4. by its place in the recording, counted from `first_frame`.

Places count only where no name fits a sweep in another way, so that one sweep that is missing does not shift all
others by one. Another `first_frame` than 0 says that places are meant, whatever the sweeps are called.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path

from bench.atomic import refuse_escape
from bench.errors import DataError
from bench.labels.formats import LabelOptions
from bench.plain_text import listed
from bench.recordings import Recording, SweepRef

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
        hint = f"give the one that is meant, for example {inner[0]}"
        raise DataError(
            source, expected="one folder of labels", got=" and ".join(path.name for path in inner), hint=hint
        )
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
        DataError: other frames are there, or the folder is a link that leads elsewhere.
    """
    refuse_escape(folder.parent, folder, file=folder)
    written = {f"{name}{suffix}" for name in names} | set(without)
    found = sorted(path.name for path in folder.glob(f"*{suffix}")) if folder.is_dir() else []
    others = [name for name in found if name not in written and not name.startswith(".")]
    if others:
        expected = f"no frames but the {len(written) - len(set(without))} that are written"
        raise DataError(
            folder, expected=expected, got=f"{len(others)} others, as {others[0]}", hint="give another folder"
        )


def frame_names(recording: Recording, options: LabelOptions) -> dict[int, str]:
    """Sweep's time -> name of its frame: that of the sweep's file, since tools name labels after point clouds.

    Counted numbers of six digits where the user gives the number of the first frame; times where sweeps share a file.
    """
    stems = [sweep.path.stem for sweep in recording.sweeps]
    if options.first_frame:
        stems = [f"{options.first_frame + i:06d}" for i in range(len(stems))]
    elif len(set(stems)) < len(stems):
        stems = [str(sweep.timestamp_ns) for sweep in recording.sweeps]
    return {sweep.timestamp_ns: stem for sweep, stem in zip(recording.sweeps, stems, strict=True)}


SHOWN = 5  # names that a message lists
LONGEST_NUMBER = 19  # digits of a time in nanoseconds


def pair_with_sweeps(
    names: Collection[str], recording: Recording, options: LabelOptions, *, source: Path, by_place: bool = True
) -> dict[str, SweepRef]:
    """The sweep of each frame.

    Args:
        names: of the tool's frames: stems of files, or numbers as text.
        recording: what was annotated.
        options: for `first_frame`.
        source: the tool's file or folder, for messages.
        by_place: whether a number may be a place; False for names that a tool took from files.

    Returns:
        Name -> sweep, in the order of the sweeps.

    Raises:
        DataError: frames that fit no sweep, fit some only, or two frames of one sweep.
    """
    if not recording.sweeps:
        raise DataError(source, expected=f"a recording with lidar sweeps, as {recording.name!r}", got="none")
    paired = _paired(tuple(dict.fromkeys(names)), recording, options, source, by_place)
    frames: dict[int, str] = {}
    for name, sweep in paired.items():
        other = frames.setdefault(sweep.timestamp_ns, name)
        if other != name:
            raise DataError(
                source, expected="one frame for each sweep", got=f"{other!r} and {name!r} of {sweep.path.name}"
            )
    return dict(sorted(paired.items(), key=lambda item: item[1].timestamp_ns))


def frame_numbers(recording: Recording, options: LabelOptions) -> dict[int, int]:
    """Sweep's time -> number of its frame, as `pair_with_sweeps` reads it back.

    The number in the name of the sweep's file where all have one that is not a time; else the place.
    """
    stems = [sweep.path.stem for sweep in recording.sweeps]
    by_name = all(_is_number(stem) for stem in stems) and len({int(stem) for stem in stems}) == len(stems)
    timed = all(stem == str(sweep.timestamp_ns) for stem, sweep in zip(stems, recording.sweeps, strict=True))
    if by_name and not timed and not options.first_frame:
        return {sweep.timestamp_ns: int(sweep.path.stem) for sweep in recording.sweeps}
    return {sweep.timestamp_ns: options.first_frame + i for i, sweep in enumerate(recording.sweeps)}


def _paired(
    names: Collection[str], recording: Recording, options: LabelOptions, source: Path, places: bool
) -> dict[str, SweepRef]:
    """Name -> sweep in the first way that fits; see the ways at the top."""
    sweeps = recording.sweeps
    numbers = {name: int(name) for name in names if _is_number(name)}
    by_stem = {sweep.path.stem: sweep for sweep in sweeps}
    by_number = {int(stem): sweep for stem, sweep in by_stem.items() if _is_number(stem)}
    by_time = {sweep.timestamp_ns: sweep for sweep in sweeps}
    ways = [{name: by_stem[name] for name in names if name in by_stem}]
    ways += [{name: keyed[i] for name, i in numbers.items() if i in keyed} for keyed in (by_number, by_time)]
    by_place = dict(enumerate(sweeps, start=options.first_frame))
    placed = [name for name in names if places and _is_number(name.removeprefix("-"))]
    chosen = {name: by_place[int(name)] for name in placed if int(name) in by_place}
    if not options.first_frame:
        # What fits in part is meant, but for the number 0 alone: both ways of counting may begin with it.
        partly = [way for way in ways if way and (not places or any(numbers.get(name) != 0 for name in way))]
        chosen = next((way for way in (*(way for way in ways if len(way) == len(names)), *partly)), chosen)
    unpaired = [name for name in names if name not in chosen]
    if not unpaired:
        return chosen
    called = f"{sweeps[0].path.stem} to {sweeps[-1].path.stem}"
    expected = f"frames named like the {len(sweeps)} sweeps, {called}"
    hint = "name frames after the sweeps"
    if places:
        expected += f", or {options.first_frame} to {options.first_frame + len(sweeps) - 1}"
        hint += ", or give the number of the first sweep with --first-frame"
    raise DataError(source, field="frames", expected=expected, got=listed(unpaired, SHOWN), hint=hint)


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) <= LONGEST_NUMBER
