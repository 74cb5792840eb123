"""The frames of a tool are the recording's sweeps; this pairs their names or numbers, always by key.

A frame is called, and these are tried in turn for all frames of a source at once:

1. as the file of its sweep without the suffix,
2. by the same number as that file, whatever zeros stand before it,
3. by the sweep's time in nanoseconds,
4. by its place in the recording, counted from `first_frame`.

Places count only where no name fits a sweep in another way, so that one sweep that is missing does not shift all
others by one. Another `first_frame` than 0 says that places are meant, whatever the sweeps are called.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

from bench.errors import DataError
from bench.layers.layer import LayerOptions
from bench.recordings import Recording, SweepRef

SHOWN = 5  # names that a message lists
LONGEST_NUMBER = 19  # digits of a time in nanoseconds


def pair_with_sweeps(
    names: Collection[str], recording: Recording, options: LayerOptions, *, source: Path
) -> dict[str, SweepRef]:
    """The sweep of each frame.

    Args:
        names: of the tool's frames: stems of files, or numbers as text.
        recording: what was annotated.
        options: for `first_frame`.
        source: the tool's file or folder, for messages.

    Returns:
        Name -> sweep, in the order of the sweeps.

    Raises:
        DataError: frames that fit no sweep, fit some only, or two frames of one sweep.
    """
    if not recording.sweeps:
        raise DataError(source, expected=f"a recording with lidar sweeps, as {recording.name!r}", got="none")
    paired = _best(tuple(dict.fromkeys(names)), recording, options, source)
    frames: dict[int, str] = {}
    for name, sweep in paired.items():
        other = frames.setdefault(sweep.timestamp_ns, name)
        if other != name:
            raise DataError(
                source, expected="one frame for each sweep", got=f"{other!r} and {name!r} of {sweep.path.name}"
            )
    return dict(sorted(paired.items(), key=lambda item: item[1].timestamp_ns))


def frame_numbers(recording: Recording, options: LayerOptions) -> dict[int, int]:
    """Sweep's time -> number of its frame, as `pair_with_sweeps` reads it back.

    The number in the name of the sweep's file where all have one that is not a time; else the place.
    """
    stems = [sweep.path.stem for sweep in recording.sweeps]
    by_name = all(_is_number(stem) for stem in stems) and len({int(stem) for stem in stems}) == len(stems)
    timed = all(stem == str(sweep.timestamp_ns) for stem, sweep in zip(stems, recording.sweeps, strict=True))
    if by_name and not timed and not options.first_frame:
        return {sweep.timestamp_ns: int(sweep.path.stem) for sweep in recording.sweeps}
    return {sweep.timestamp_ns: options.first_frame + i for i, sweep in enumerate(recording.sweeps)}


def _best(names: tuple[str, ...], recording: Recording, options: LayerOptions, source: Path) -> dict[str, SweepRef]:
    places = _by_place(names, recording, options)
    if options.first_frame:
        return _complete(names, places, recording, options, source)
    ways = (_by_stem(names, recording), _by_number(names, recording), _by_time(names, recording))
    for keyed in ways:
        if len(keyed) == len(names):
            return keyed
    for keyed in ways:
        if any(not _is_number(name) or int(name) for name in keyed):  # both ways of counting may begin with 0
            return _complete(names, keyed, recording, options, source)
    return _complete(names, places, recording, options, source)


def _complete(
    names: tuple[str, ...],
    paired: Mapping[str, SweepRef],
    recording: Recording,
    options: LayerOptions,
    source: Path,
) -> dict[str, SweepRef]:
    odd = [name for name in names if name not in paired]
    if not odd:
        return dict(paired)
    first, last = recording.sweeps[0].path.stem, recording.sweeps[-1].path.stem
    numbers = f"{options.first_frame} to {options.first_frame + len(recording.sweeps) - 1}"
    listed = ", ".join(odd[:SHOWN]) + (f" and {len(odd) - SHOWN} more" if len(odd) > SHOWN else "")
    raise DataError(
        source,
        field="frames",
        expected=f"frames called as the {len(recording.sweeps)} sweeps, {first} to {last}, or {numbers}",
        got=listed,
        do="name frames after the sweeps, or give the number of the first sweep with --first-frame",
    )


def _by_stem(names: Collection[str], recording: Recording) -> dict[str, SweepRef]:
    sweeps = {sweep.path.stem: sweep for sweep in recording.sweeps}
    return {name: sweeps[name] for name in names if name in sweeps}


def _by_number(names: Collection[str], recording: Recording) -> dict[str, SweepRef]:
    sweeps = {int(sweep.path.stem): sweep for sweep in recording.sweeps if _is_number(sweep.path.stem)}
    return {name: sweeps[int(name)] for name in names if _is_number(name) and int(name) in sweeps}


def _by_time(names: Collection[str], recording: Recording) -> dict[str, SweepRef]:
    sweeps = {sweep.timestamp_ns: sweep for sweep in recording.sweeps}
    return {name: sweeps[int(name)] for name in names if _is_number(name) and int(name) in sweeps}


def _by_place(names: Collection[str], recording: Recording, options: LayerOptions) -> dict[str, SweepRef]:
    paired = {}
    for name in names:
        place = int(name) - options.first_frame if _is_number(name.removeprefix("-")) else -1
        if 0 <= place < len(recording.sweeps):
            paired[name] = recording.sweeps[place]
    return paired


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) <= LONGEST_NUMBER
