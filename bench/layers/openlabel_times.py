"""Times of the frames of an OpenLABEL file.

The standard leaves open what a timestamp is: a number or text, in any unit, since any epoch. It is read in the unit in
which most frames fall on a sweep or an image of the recording, within a millisecond, and then takes the time of that.
Files without timestamps pair their frames with sweeps: by what the lidar's stream says of the frame (time, file), else
by the frame's number.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation
from pathlib import Path

from bench.errors import DataError
from bench.layers.frames import pair_with_sweeps
from bench.layers.layer import LayerOptions
from bench.layers.openlabel_file import Root, Stream
from bench.recordings import Recording
from bench.recordings.validation import LATEST_NS

UNITS_NS = {"ns": 1, "us": 1_000, "ms": 1_000_000, "s": 1_000_000_000}
NEAR_NS = 1_000_000
LONGEST_TEXT = 64


def frame_times(content: Root, recording: Recording, options: LayerOptions, file: Path) -> dict[str, int]:
    """The time of each frame, int64 ns.

    Raises:
        DataError: some frames have timestamps and others not, no unit fits, two frames of one time, or frames that
            fit no sweep.
    """
    frames = content.frames
    if not frames:
        return {}
    stamps = {number: frame.frame_properties.timestamp for number, frame in frames.items()}
    if all(stamp is None for stamp in stamps.values()):
        stamps = {number: _lidar_stream(content, number).stream_properties.sync.timestamp for number in frames}
    given = {number: stamp for number, stamp in stamps.items() if stamp is not None}
    if given:
        missing = next((number for number in frames if number not in given), None)
        if missing is not None:
            field = f"openlabel.frames.{missing}.frame_properties.timestamp"
            raise DataError(file, field=field, expected="a time, as the other frames have", got="nothing")
        times_ns = _in_best_unit(
            {number: _parsed(stamp, number, file) for number, stamp in given.items()}, recording, file
        )
    else:
        names = _names(content)
        sweeps = pair_with_sweeps(tuple(names.values()), recording, options, source=file)
        times_ns = {number: sweeps[name].timestamp_ns for number, name in names.items()}
    seen: dict[int, str] = {}
    for number, time_ns in times_ns.items():
        other = seen.setdefault(time_ns, number)
        if other != number:
            field = f"openlabel.frames.{number}"
            raise DataError(file, field=field, expected="one frame for each time", got=f"{time_ns}, as frame {other}")
    return times_ns


def _names(content: Root) -> dict[str, str]:
    """What pairs each frame with a sweep: the lidar's file, its own count, or the frame's number."""
    streams = {number: _lidar_stream(content, number) for number in content.frames}
    if all(stream.uri for stream in streams.values()):
        return {number: Path(str(stream.uri).replace("\\", "/")).stem for number, stream in streams.items()}
    counts = {number: stream.stream_properties.sync.frame_stream for number, stream in streams.items()}
    if all(count is not None for count in counts.values()):
        return {number: str(count) for number, count in counts.items()}
    return {number: str(int(number)) for number in content.frames}


def _lidar_stream(content: Root, number: str) -> Stream:
    """What a frame says of the lidar; an empty stream where it says nothing, or speaks of several."""
    told = content.frames[number].frame_properties.streams
    lidars = [
        stream
        for name, stream in told.items()
        if stream.type == "lidar" or (name in content.streams and content.streams[name].type == "lidar")
    ]
    return lidars[0] if len(lidars) == 1 else Stream()


def _parsed(stamp: float | str | None, number: str, file: Path) -> Decimal | int:
    """A number in an unknown unit, or ns of a written date."""
    field = f"openlabel.frames.{number}.frame_properties.timestamp"
    text = str(stamp).strip()
    if len(text) > LONGEST_TEXT:
        raise DataError(file, field=field, expected="a time", got=repr(text[:LONGEST_TEXT]))
    try:
        value = Decimal(text)
    except InvalidOperation:
        value = None
    if value is not None:
        if not value.is_finite() or value.copy_abs() > LATEST_NS:  # `abs` fails on exponents beyond its context
            raise DataError(file, field=field, expected="a time", got=text)
        return value
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise DataError(file, field=field, expected="a number, or a date and time", got=repr(text)) from None
    moment = moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)
    whole = int(moment.replace(microsecond=0).timestamp()) * UNITS_NS["s"]
    return whole + moment.microsecond * UNITS_NS["us"]


def _in_best_unit(values: Mapping[str, Decimal | int], recording: Recording, file: Path) -> dict[str, int]:
    known = sorted(
        {sweep.timestamp_ns for sweep in recording.sweeps}
        | {image.timestamp_ns for images in recording.images.values() for image in images}
    )
    best: dict[str, int] = {}
    most = 0
    for unit_ns in UNITS_NS.values():
        times_ns: dict[str, int] = {}
        hits = 0
        for number, value in values.items():
            exact = value if isinstance(value, int) else int((value * unit_ns).to_integral_value())
            nearest = _nearest(exact, known)
            hits += nearest is not None
            times_ns[number] = exact if nearest is None else nearest
        if hits > most:
            best, most = times_ns, hits
    if not most:
        first = next(iter(values))
        raise DataError(
            file,
            field=f"openlabel.frames.{first}.frame_properties.timestamp",
            expected=f"times of the recording, {known[0]} to {known[-1]} ns, in ns, us, ms or s" if known else "a time",
            got=str(values[first]),
        )
    for number, time_ns in best.items():
        if abs(time_ns) > LATEST_NS:
            field = f"openlabel.frames.{number}.frame_properties.timestamp"
            expected = "a time of this recording, in the unit of the other frames"
            raise DataError(file, field=field, expected=expected, got=str(values[number]))
    return best


def _nearest(time_ns: int, known: list[int]) -> int | None:
    place = bisect_left(known, time_ns)
    near = [t for t in known[max(place - 1, 0) : place + 1] if abs(t - time_ns) <= NEAR_NS]
    return min(near, key=lambda t: abs(t - time_ns), default=None)
