"""Point clouds of ROS 2 messages, whatever the layout of their fields."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bench.errors import DataError
from bench.lidar import LidarSweep
from bench.lidar.files import FARTHEST_TIME_NS
from bench.recordings.rosbag.rig import LidarRig

TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}  # as PointField numbers them
TIME_FIELDS = ("t", "time", "timestamp", "offset_time", "time_offset")
INTENSITY_FIELDS = ("intensity", "reflectivity")
UNITS_NS = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0}
MOST_POINTS = 10_000_000
NEVER_AN_OFFSET_S = 1e6  # a larger number of seconds counts from the start of a clock
NANOSECONDS_SINCE_1970 = 1e17


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DecodedCloud:
    """A point cloud.

    Attributes:
        sweep: its finite points, in the order of the message.
        dropped: points that were left out, since they are not finite or at the lidar itself.
    """

    sweep: LidarSweep
    dropped: int


def cloud_sweep(message: Any, timestamp_ns: int, *, stamp_ns: int, rig: LidarRig, place: Path) -> DecodedCloud:
    """Decode a `sensor_msgs/PointCloud2`.

    Times of points come from the first field of a usual name: whole numbers are nanoseconds and float32 are seconds
    from the message's stamp; float64 are seconds, from the stamp or, when they are as large, from the start of the
    clock, and nanoseconds where they are as many as since 1970. The rig can say otherwise.

    Args:
        message: decoded.
        timestamp_ns: the sweep's reference time, which stands for the message's stamp.
        stamp_ns: the stamp in the message's header, in the clock of times that count from the start of it.
        rig: of the lidar.
        place: where it comes from, for messages.

    Raises:
        DataError: fields that are missing or do not fit the data, or times a second or more from the message's.
    """
    points = _structured(message, place)
    names = points.dtype.names or ()
    xyz = np.stack([points[axis] for axis in "xyz"], axis=-1).astype(_native(points.dtype["x"]), copy=False)
    kept = np.isfinite(xyz).all(axis=1)
    if rig.drop_origin:
        kept &= (xyz != 0).any(axis=1)
    time_field = rig.time_field or next((name for name in TIME_FIELDS if name in names), None)
    offsets_ns = None
    if time_field is not None:
        if time_field not in names:
            raise DataError(place, field="fields", expected=f"the time field {time_field}", got=", ".join(names))
        offsets_ns = _offsets(points[time_field][kept], stamp_ns, rig, place, time_field)
    intensity = next((name for name in INTENSITY_FIELDS if name in names), None)
    sweep = LidarSweep(
        timestamp_ns=timestamp_ns,
        points_lidar=np.ascontiguousarray(xyz[kept]),
        time_offset_ns=offsets_ns,
        intensity=None if intensity is None else _intensity(points[intensity][kept], rig.full_intensity),
        ring=_ring(points["ring"][kept]) if "ring" in names else None,
    )
    return DecodedCloud(sweep=sweep, dropped=int((~kept).sum()))


def _structured(message: Any, place: Path) -> NDArray[Any]:
    """(N,) of a structured type with the fields of the message."""
    width, height = int(message.width), int(message.height)
    step, row_step = int(message.point_step), int(message.row_step)
    if width * height > MOST_POINTS:
        raise DataError(place, field="width", expected=f"at most {MOST_POINTS} points", got=f"{width} x {height}")
    dtype = _layout(message, step, place)
    data = np.frombuffer(message.data, dtype=np.uint8)
    if width * height == 0:
        return np.empty(0, dtype=dtype)
    if height == 1:
        row_step = max(row_step, width * step)  # some drivers leave it 0 where it does not matter
    if row_step < width * step:
        raise DataError(place, field="row_step", expected=f"at least {width * step} bytes", got=str(row_step))
    due = row_step * (height - 1) + width * step
    if len(data) < due:
        expected = f"{due} bytes for {height} rows of {width} points"
        raise DataError(place, field="data", expected=expected, got=str(len(data)))
    rows = [np.frombuffer(data[i * row_step : i * row_step + width * step].data, dtype=dtype) for i in range(height)]
    return rows[0] if height == 1 else np.concatenate(rows)


def _layout(message: Any, step: int, place: Path) -> np.dtype[Any]:
    order = ">" if message.is_bigendian else "<"
    names, formats, offsets = [], [], []
    for entry in message.fields:
        name, kind, offset, count = str(entry.name), int(entry.datatype), int(entry.offset), int(entry.count)
        if kind not in TYPES:
            raise DataError(place, field=f"fields, {name[:40]}", expected="a datatype from 1 to 8", got=str(kind))
        if count > 1 or not name or name in names:
            continue  # filling, or more than one number a point, which nothing here asks for
        if offset + np.dtype(TYPES[kind]).itemsize > step:
            got = f"byte {offset} of points of {step} bytes"
            raise DataError(place, field=f"fields, {name[:40]}", expected="a place inside the point", got=got)
        names.append(name)
        formats.append(order + TYPES[kind])
        offsets.append(offset)
    for axis in "xyz":
        if axis not in names or np.dtype(formats[names.index(axis)]).kind != "f":
            got = ", ".join(names)[:200] or "none"
            raise DataError(place, field="fields", expected=f"{axis} as float32 or float64", got=got)
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": step})


def _offsets(values: NDArray[Any], stamp_ns: int, rig: LidarRig, place: Path, field: str) -> NDArray[np.int64]:
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        raise DataError(place, field=field, expected="finite times", got="NaN or infinity at points that have a place")
    unit, origin = _meaning(values, rig)
    if values.dtype.kind == "f":
        times = values.astype(np.float64)
        if origin == "start":
            # Split, since nanoseconds since 1970 have more digits than float64.
            whole = np.floor(times * (UNITS_NS[unit] / 1e9))
            rest_ns = (times - whole * (1e9 / UNITS_NS[unit])) * UNITS_NS[unit]
            apart_s = float(np.abs(whole - stamp_ns // 1_000_000_000).max(initial=0.0)) - 1.0  # both were rounded down
            _refuse_far(apart_s * 1e9, place, field, unit)
            offsets_ns = whole.astype(np.int64) * 1_000_000_000 - stamp_ns + np.rint(rest_ns).astype(np.int64)
        else:
            _refuse_far(float(np.abs(times).max(initial=0.0)) * UNITS_NS[unit], place, field, unit)
            offsets_ns = np.rint(times * UNITS_NS[unit]).astype(np.int64)
    else:
        offsets_ns = values.astype(np.int64) * round(UNITS_NS[unit]) - (stamp_ns if origin == "start" else 0)
    _refuse_far(float(np.abs(offsets_ns).max(initial=0)), place, field, unit)
    return np.asarray(offsets_ns)


def _meaning(values: NDArray[Any], rig: LidarRig) -> tuple[str, Literal["stamp", "start"]]:
    """Unit of times, and from where they count."""
    largest = float(np.abs(values.astype(np.float64)).max(initial=0.0))
    unit = rig.time_unit
    if unit is None:
        whole = values.dtype.kind != "f"
        unit = "ns" if whole or largest > NANOSECONDS_SINCE_1970 else "s"
    absolute = largest * UNITS_NS[unit] / 1e9 > NEVER_AN_OFFSET_S
    return unit, rig.time_from or ("start" if absolute else "stamp")


def _refuse_far(largest_ns: float, place: Path, field: str, unit: str) -> None:
    if not largest_ns < FARTHEST_TIME_NS:
        got = f"times up to {largest_ns / 1e9:.3g} s away, taken as {unit}"
        do = "say time_unit and time_from of the lidar in the rig file"
        raise DataError(place, field=field, expected="times within a second of the message", got=got, do=do)


def _intensity(values: NDArray[Any], full: float) -> NDArray[np.float32]:
    return np.asarray(values.astype(np.float32) / np.float32(full))


def _ring(values: NDArray[Any]) -> NDArray[np.uint8] | None:
    """None where the lasers are more than a byte can count."""
    if values.dtype.kind == "f" or (values.size and not 0 <= int(values.min()) <= int(values.max()) < 256):
        return None
    return values.astype(np.uint8)


def _native(dtype: np.dtype[Any]) -> np.dtype[Any]:
    return dtype.newbyteorder("=")
