"""Point clouds of a bag, whatever the layout of their fields: found again by their position, decoded to sweeps."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from bench.adapters.rosbag.messages import decode, header_stamp_ns
from bench.adapters.rosbag.rig import LidarRig
from bench.adapters.rosbag.storage import StoredMessage
from bench.errors import DataError
from bench.lidar import LidarSweep
from bench.lidar.fields import sweep_of

TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}  # as PointField numbers them
MOST_POINTS = 10_000_000
TIME_HINT = "set time_unit and time_from of the lidar in the rig file"


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
    """The points of a `sensor_msgs/PointCloud2` that have a position, in the order of the message.

    Args:
        message: decoded.
        timestamp_ns: the sweep's reference time, which stands for the message's stamp.
        stamp_ns: the stamp in the message's header, in the clock of times that count from the start of it.
        rig: of the lidar.
        name: of the sweep, for errors.

    Raises:
        DataError: fields that are missing or do not fit the data, or times that are none of this sweep.
    """
    rows = _structured(message, name)
    fields = {field: rows[field] for field in rows.dtype.names or ()}
    points = np.stack([fields.pop(axis) for axis in "xyz"], axis=-1)
    return sweep_of(
        points.astype(points.dtype.newbyteorder("="), copy=False),
        {field: values.astype(values.dtype.newbyteorder("=")) for field, values in fields.items()},
        timestamp_ns,
        name=name,
        stamp_ns=stamp_ns,
        time_field=rig.time_field,
        time_unit=rig.time_unit,
        time_from=rig.time_from,
        full_intensity=rig.full_intensity,
        drop_origin=rig.drop_origin,
        time_hint=TIME_HINT,
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
