"""Point-cloud files: .npz (ours) and .bin (KITTI) here, .pcd, .las and .laz by their own modules.

Every reader gives named arrays: `points_lidar` (N, 3) and what else the file has, by the file's own names.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.errors import DataError, UnknownNameError
from bench.lidar.cloud_files import read_pcd
from bench.lidar.fields import FARTHEST_TIME_NS, sweep_of
from bench.lidar.laz_files import read_laz
from bench.lidar.sweep import LARGEST_BYTES, Arrays, LidarSweep

BIN_COLUMNS = ("x", "y", "z", "intensity")
BIN_HINT = "name the columns in the card's option bin_columns, for example [x, y, z, intensity, ring]"
NPZ_TYPES: Mapping[str, tuple[str, str, type[Any] | None]] = {  # kinds of type, in words, and what they are read as
    "points_lidar": ("f", "floating point", None),
    "intensity": ("f", "floating point", np.float32),
    "time_offset_ns": ("i", "int64", np.int64),
    "ring": ("ui", "uint8 or integers", np.uint8),
}
FARTHEST_M = 1e8  # coordinates of any map are below


def read_npz(path: Path) -> Arrays:
    """Read our own arrays; objects (pickles) and arrays of other names are refused.

    Raises:
        DataError: cut short, an array that is missing, unknown or of another type.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            entries = stored.zip.infolist()
            if any(entry.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED} for entry in entries):
                raise zipfile.BadZipFile("packed in another way than by deflate")  # whose memory nothing limits
            unpacked = sum(entry.file_size for entry in entries)  # no stream is read beyond that
            if unpacked > LARGEST_BYTES:
                expected = f"at most {LARGEST_BYTES} bytes of arrays"
                raise DataError(path, expected=expected, got=f"{unpacked} when unpacked")
            arrays: Arrays = {name: stored[name] for name in stored.files}
    except DataError:
        raise
    except Exception as error:  # a damaged file makes zipfile and NumPy raise nearly all that there is
        got = " ".join(str(error).split())[:200] or type(error).__name__
        raise DataError(path, expected="a whole .npz file of plain arrays", got=got) from error
    for name, values in arrays.items():
        if name not in NPZ_TYPES:
            raise DataError(path, field=name, expected=f"only the arrays {', '.join(NPZ_TYPES)}", got="this one")
        kinds, expected, _ = NPZ_TYPES[name]
        if values.dtype.kind not in kinds:
            raise DataError(path, field=name, expected=expected, got=str(values.dtype))
    if "points_lidar" not in arrays:
        raise DataError(path, field="points_lidar", expected="an array of this name", got="none")
    if "ring" in arrays and arrays["ring"].size and not 0 <= int(arrays["ring"].max()) < 256:
        raise DataError(path, field="ring", expected="0 to 255", got=str(arrays["ring"].max()))
    return {name: values.astype(NPZ_TYPES[name][2] or values.dtype, copy=False) for name, values in arrays.items()}


def read_bin(path: Path, columns: Sequence[str] | None = None) -> Arrays:
    """Read rows of little-endian float32.

    Args:
        path: the file.
        columns: names of the columns, x, y and z among them; None for x, y, z, intensity, as KITTI has them.

    Raises:
        DataError: empty, or not whole rows.
    """
    names, size = columns or BIN_COLUMNS, path.stat().st_size
    if not size or size % (4 * len(names)):
        got = f"{size} bytes; the file may be cut short, or have another number of columns"
        expected = f"rows of {len(names)} float32 ({4 * len(names)} bytes)"
        raise DataError(path, expected=expected, got=got, hint=BIN_HINT)
    table = dict(zip(names, np.fromfile(path, dtype="<f4").reshape(-1, len(names)).T, strict=True))
    if (
        columns is None and (table["intensity"] < 0).any()
    ):  # of five columns, read as four, each is a coordinate at times
        got = f"{table['intensity'].min():g}; the file may have another number of columns"
        raise DataError(path, field="intensity", expected="no value below 0", got=got, hint=BIN_HINT)
    points = np.stack([table.pop(axis) for axis in "xyz"], axis=1)
    return {"points_lidar": points} | {name: column.copy() for name, column in table.items()}


FORMATS: Mapping[str, Callable[[Path], Arrays]] = {
    ".npz": read_npz,
    ".bin": read_bin,
    ".pcd": read_pcd,
    ".las": read_laz,
    ".laz": read_laz,
}


def read_points(path: Path, *, bin_columns: Sequence[str] | None = None) -> Arrays:
    """Read the arrays of a point-cloud file, chosen by its suffix.

    Args:
        path: the file.
        bin_columns: names of the columns of .bin; None for x, y, z, intensity.

    Returns:
        points_lidar: (N, 3) float32 or float64, m; NaN or infinity where a return has no position.
        others: (N,) each, as the file has them, by the file's names.

    Raises:
        UnknownNameError: a suffix that is not read here.
        DataError: missing, cut short, or an array that is missing or of another shape.
    """
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise UnknownNameError("point-cloud suffix", path.suffix, FORMATS)
    if not path.is_file():
        raise DataError(path, expected="a point-cloud file", got="no such file")
    if path.stat().st_size > LARGEST_BYTES:
        raise DataError(path, expected=f"a sweep of at most {LARGEST_BYTES} bytes", got=str(path.stat().st_size))
    try:
        arrays = read_bin(path, bin_columns) if suffix == ".bin" else FORMATS[suffix](path)
    except OSError as error:
        raise DataError(path, expected="a readable point-cloud file", got=error.strerror or str(error)) from error
    points = arrays["points_lidar"]
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind != "f":
        got = f"{points.shape} {points.dtype}"
        raise DataError(path, field="points_lidar", expected="(N, 3) floating point", got=got)
    for name, values in arrays.items():
        if name != "points_lidar" and values.shape != (len(points),):
            raise DataError(path, field=name, expected=f"({len(points)},), one per point", got=str(values.shape))
    finite = points[np.isfinite(points).all(axis=1)]
    if len(points) and not len(finite):
        raise DataError(path, field="points_lidar", expected="finite numbers", got="none in any row")
    if finite.size and np.abs(finite).max() > FARTHEST_M:
        expected, got = f"coordinates within {FARTHEST_M:g} m", f"{np.abs(finite).max():g}"
        hint = BIN_HINT if suffix == ".bin" else ""
        raise DataError(path, field="points_lidar", expected=expected, got=got, hint=hint)
    return arrays


def read_sweep(path: Path, timestamp_ns: int, *, bin_columns: Sequence[str] | None = None) -> LidarSweep:
    """Read one revolution; how times and intensities are taken is said in `fields.sweep_of`.

    Args:
        path: the file.
        timestamp_ns: the sweep's reference time.
        bin_columns: names of the columns of .bin; None for x, y, z, intensity.

    Raises:
        DataError: as `read_points`, or points a second or more away from the sweep's time.
    """
    fields = read_points(path, bin_columns=bin_columns)
    points = fields.pop("points_lidar")
    if path.suffix.lower() != ".npz":
        return sweep_of(points, fields, timestamp_ns, name=path)
    kept = np.isfinite(points).all(axis=1)
    rows = None if kept.all() else np.flatnonzero(kept)
    offsets_ns = fields.get("time_offset_ns")
    if offsets_ns is not None and offsets_ns.size:
        first_ns, last_ns = int(offsets_ns.min()), int(offsets_ns.max())
        if not -FARTHEST_TIME_NS < first_ns <= last_ns < FARTHEST_TIME_NS:
            expected, got = f"times within a second of {timestamp_ns}, ns", f"{first_ns} to {last_ns} ns away"
            raise DataError(path, field="time_offset_ns", expected=expected, got=got)
    taken: dict[str, Any] = {name: values if rows is None else values[rows] for name, values in fields.items()}
    return LidarSweep(
        timestamp_ns=timestamp_ns,
        points_lidar=points if rows is None else points[rows],
        stored_rows=rows,
        stored_count=len(points),
        read_fields=tuple(fields),
        **taken,
    )


def write_sweep(path: Path, sweep: LidarSweep) -> None:
    """Write one revolution as .npz; the same sweep gives the same bytes.

    Args:
        path: the file, overwritten.
        sweep: the points; they are stored as float32.
    """
    arrays = {name: getattr(sweep, name) for name in NPZ_TYPES if getattr(sweep, name) is not None}
    arrays["points_lidar"] = sweep.points_lidar.astype(np.float32)
    np.savez_compressed(path, **arrays)  # zip entries carry a fixed date
