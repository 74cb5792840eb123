"""Point clouds of a bag, whatever the layout of their fields: found again by their position, decoded to sweeps."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from bench.adapters.rosbag.messages import SECOND_NS, decode, header_stamp_ns
from bench.adapters.rosbag.rig import LidarRig
from bench.adapters.rosbag.storage import StoredMessage
from bench.errors import DataError
from bench.lidar import TIME_FIELDS, LidarSweep
from bench.lidar.files import FARTHEST_TIME_NS

TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}  # as PointField numbers them
INTENSITY_FIELDS = ("intensity", "reflectivity")
UNITS_NS = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0}
MOST_POINTS = 10_000_000
NEVER_AN_OFFSET_S = 1e6  # a larger number of seconds counts from the start of a clock
NANOSECONDS_SINCE_1970 = 1e17


@dataclass(frozen=True, slots=True)
class BagSweep(StoredMessage):
    """A point cloud in a bag, and the reader of its `SweepRef`.

    Attributes:
        rig: of the lidar.
    """

    rig: LidarRig

    @override
    def decoding(self) -> tuple[Any, ...]:
        return (self.rig,)

    def __call__(self, name: Path, timestamp_ns: int) -> LidarSweep:
        """Decode it.

        Args:
            name: of the sweep, for errors.
            timestamp_ns: the sweep's reference time.

        Raises:
            DataError: it cannot be read or decoded, or its points are in another frame than the rig file says.
        """
        payload = self.payload()
        message = decode(self.topic, payload, file=self.container)
        frame = str(message.header.frame_id).lstrip("/")
        if self.rig.frame is not None and frame != self.rig.frame:
            expected, hint = f"{self.rig.frame!r}, as the rig file says", "name this frame there, if its points are"
            raise DataError(
                name, field="header.frame_id", expected=expected, got=repr(frame), hint=f"{hint} as measured"
            )
        return cloud_sweep(message, timestamp_ns, stamp_ns=header_stamp_ns(payload), rig=self.rig, name=name)


def cloud_sweep(message: Any, timestamp_ns: int, *, stamp_ns: int, rig: LidarRig, name: Path) -> LidarSweep:
    """The finite points of a `sensor_msgs/PointCloud2`, in the order of the message.

    Times of points come from the first field of a usual name: whole numbers are nanoseconds and float32 are seconds
    from the message's stamp; float64 are seconds, from the stamp or, when they are as large, from the start of the
    clock, and nanoseconds where they are as many as since 1970. The rig can say otherwise.

    Args:
        message: decoded.
        timestamp_ns: the sweep's reference time, which stands for the message's stamp.
        stamp_ns: the stamp in the message's header, in the clock of times that count from the start of it.
        rig: of the lidar.
        name: of the sweep, for errors.

    Raises:
        DataError: fields that are missing or do not fit the data, or times a second or more from the message's.
    """
    points = _structured(message, name)
    fields = points.dtype.names or ()
    native = points.dtype["x"].newbyteorder("=")
    points_lidar = np.stack([points[axis] for axis in "xyz"], axis=-1).astype(native, copy=False)
    valid = np.isfinite(points_lidar).all(axis=1)
    if rig.drop_origin:
        valid &= (points_lidar != 0).any(axis=1)
    time_field = rig.time_field or next((field for field in TIME_FIELDS if field in fields), None)
    if time_field is not None and time_field not in fields:
        raise DataError(name, field="fields", expected=f"the time field {time_field}", got=", ".join(fields))
    offsets_ns = None if time_field is None else _offsets_ns(points[time_field][valid], stamp_ns, rig, name, time_field)
    intensity = next((field for field in INTENSITY_FIELDS if field in fields), None)
    ring = points["ring"][valid] if "ring" in fields else None
    if ring is not None and (ring.dtype.kind == "f" or (ring.size and not 0 <= ring.min() <= ring.max() < 256)):
        ring = None  # more lasers than a byte can count
    return LidarSweep(
        timestamp_ns=timestamp_ns,
        points_lidar=np.ascontiguousarray(points_lidar[valid]),
        time_offset_ns=offsets_ns,
        intensity=None if intensity is None else points[intensity][valid].astype("f4") / np.float32(rig.full_intensity),
        ring=None if ring is None else ring.astype(np.uint8),
    )


def _structured(message: Any, name: Path) -> NDArray[Any]:
    """(N,) of a structured type with the fields of the message."""
    width, height = int(message.width), int(message.height)
    step, row_step = int(message.point_step), int(message.row_step)
    if width * height > MOST_POINTS:
        raise DataError(name, field="width", expected=f"at most {MOST_POINTS} points", got=f"{width} x {height}")
    dtype, used = _layout(message, step, name), width * step
    if height == 1:
        row_step = max(row_step, used)  # some drivers leave it 0 where it does not matter
    if row_step < used:
        raise DataError(name, field="row_step", expected=f"at least {used} bytes", got=str(row_step))
    needed = row_step * (height - 1) + used if width * height else 0
    if len(message.data) < needed:
        expected = f"{needed} bytes for {height} rows of {width} points"
        raise DataError(name, field="data", expected=expected, got=str(len(message.data)))
    return np.ndarray((height, width), dtype, np.ascontiguousarray(message.data), 0, (row_step, step)).reshape(-1)


def _layout(message: Any, step: int, name: Path) -> np.dtype[Any]:
    layout: dict[str, tuple[str, int]] = {}
    for entry in message.fields:
        field, kind, offset = str(entry.name), int(entry.datatype), int(entry.offset)
        if kind not in TYPES:
            raise DataError(name, field=f"fields, {field[:40]}", expected="a datatype from 1 to 8", got=str(kind))
        if int(entry.count) > 1 or not field or field in layout:
            continue  # padding, or more than one number a point, which nothing here asks for
        if offset + int(TYPES[kind][1]) > step:
            got = f"byte {offset} of points of {step} bytes"
            raise DataError(name, field=f"fields, {field[:40]}", expected="an offset inside the point", got=got)
        layout[field] = TYPES[kind], offset
    for axis in "xyz":
        if layout.get(axis, ("", 0))[0] not in ("f4", "f8"):
            got = ", ".join(layout)[:200] or "none"
            raise DataError(name, field="fields", expected=f"{axis} as float32 or float64", got=got)
    order = ">" if message.is_bigendian else "<"
    formats, offsets = [order + kind for kind, _ in layout.values()], [offset for _, offset in layout.values()]
    return np.dtype({"names": list(layout), "formats": formats, "offsets": offsets, "itemsize": step})


def _offsets_ns(values: NDArray[Any], stamp_ns: int, rig: LidarRig, name: Path, field: str) -> NDArray[np.int64]:
    """(N,) int64, the times of points from the message's stamp."""
    times = values.astype(np.float64)
    largest = float(np.abs(times).max(initial=0.0))
    if not np.isfinite(largest):
        got = "NaN or infinity at points that have a position"
        raise DataError(name, field=field, expected="finite times", got=got)
    unit = rig.time_unit or ("ns" if values.dtype.kind != "f" or largest > NANOSECONDS_SINCE_1970 else "s")
    unit_ns = UNITS_NS[unit]
    absolute = largest * unit_ns / 1e9 > NEVER_AN_OFFSET_S
    from_start = rig.time_from == "start" or (rig.time_from is None and absolute)
    stamp_s, rest_ns = divmod(stamp_ns, SECOND_NS) if from_start else (0, 0)
    # The whole seconds first, which is exact: nanoseconds since 1970 have more digits than float64.
    with np.errstate(over="ignore"):
        offsets_ns = np.rint((times - stamp_s * (1e9 / unit_ns)) * unit_ns) - rest_ns
    farthest_ns = float(np.abs(offsets_ns).max(initial=0.0))
    if not farthest_ns < FARTHEST_TIME_NS:
        got = f"times up to {farthest_ns / 1e9:.3g} s away, read as {unit}"
        hint = "set time_unit and time_from of the lidar in the rig file"
        raise DataError(name, field=field, expected="times within a second of the message", got=got, hint=hint)
    return offsets_ns.astype(np.int64)
