"""Point-cloud files: .npz (ours) and .bin (KITTI) here, .pcd, .ply and .laz by their own modules.

Every reader gives the same named arrays: `points_lidar` (N, 3) and, where the file has them, `intensity`,
`time_offset_ns`, `ring`, `gps_time` and `time`. Points that are not finite are refused: a file that holds them was
written by a tool that writes rows for lost returns, and row numbers would depend on whether they count.
"""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from bench.errors import DataError, UnknownNameError
from bench.lidar.cloud_files import read_cloud
from bench.lidar.laz_files import read_laz
from bench.lidar.sweep import LARGEST_BYTES, Arrays, LidarSweep

BIN_COLUMNS = 4  # x, y, z, intensity
UNREADABLE = (
    *(OSError, ValueError, EOFError, KeyError, AttributeError, TypeError, MemoryError),
    *(NotImplementedError, RuntimeError, zlib.error, zipfile.BadZipFile),
    *(SyntaxError, TokenError),  # of headers that are no Python
)
NPY_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
NPZ_TYPES: Mapping[str, tuple[str, str, type[Any] | None]] = {  # kinds of type, in words, and what they are read as
    "points_lidar": ("f", "floating point", None),
    "intensity": ("f", "floating point", np.float32),
    "time_offset_ns": ("i", "int64", np.int64),
    "ring": ("ui", "uint8 or integers", np.uint8),
}
FARTHEST_M = 1e8  # coordinates of any map are below
SHORTEST_SWEEP_NS = 10_000_000
UNITS_NS = (1_000_000_000, 1_000_000, 1_000, 1)
FARTHEST_TIME_NS = 1_000_000_000  # a point's time further from its sweep's means another clock or unit


def read_npz(path: Path) -> Arrays:
    """Read our own arrays; objects (pickles) and arrays of other names are refused.

    `numpy.load` alone allocates what a header states before it checks whether the file holds as much.

    Raises:
        DataError: cut short, an array that is missing, unknown or of another type.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            unpacked = sum(entry.file_size for entry in archive.infolist())
            if unpacked > LARGEST_BYTES:
                raise DataError(
                    path, expected=f"at most {LARGEST_BYTES} bytes of arrays", got=f"{unpacked} when unpacked"
                )
            arrays: Arrays = {
                entry.filename.removesuffix(".npy"): _array(path, archive, entry) for entry in archive.infolist()
            }
    except DataError:
        raise
    except UNREADABLE as error:
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


def _array(path: Path, archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    """An array of an entry, read-only."""
    if entry.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:  # `zipfile` limits no other's memory
        raise zipfile.BadZipFile(f"{entry.filename} is packed in another way than by deflate")
    with archive.open(entry) as packed:
        content = packed.read(entry.file_size)  # without the size, a stream is unpacked beyond it
    if len(content) != entry.file_size:
        raise zipfile.BadZipFile(f"{entry.filename} is cut short")
    member = io.BytesIO(content)
    version = npy.read_magic(member)
    if version not in NPY_HEADERS:
        raise DataError(path, field=entry.filename, expected="NumPy's format 1 or 2", got=str(version))
    shape, by_column, kind = NPY_HEADERS[version](member)
    stated, held = math.prod(shape) * max(kind.itemsize, 1), len(content) - member.tell()
    if stated > held or min(shape, default=0) < 0:
        got = f"a header of {shape} x {kind.itemsize} bytes over {held}"
        raise DataError(path, field=entry.filename, expected="a whole array", got=got)
    if kind.hasobject:
        raise DataError(path, field=entry.filename, expected="an array of numbers", got="Python objects")
    values = np.frombuffer(content, dtype=kind, count=math.prod(shape), offset=member.tell())
    return values.reshape(shape, order="F" if by_column else "C")


def read_bin(path: Path) -> Arrays:
    """Read KITTI's float32 rows of x, y, z and intensity.

    Raises:
        DataError: empty, or not whole rows.
    """
    size = path.stat().st_size
    if not size or size % (4 * BIN_COLUMNS):
        raise DataError(
            path, expected="rows of four float32 (16 bytes)", got=f"{size} bytes; the file may be cut short"
        )
    rows = np.fromfile(path, dtype="<f4").reshape(-1, BIN_COLUMNS)
    return {"points_lidar": rows[:, :3].copy(), "intensity": rows[:, 3].copy()}


FORMATS: Mapping[str, Callable[[Path], Arrays]] = {
    ".npz": read_npz,
    ".bin": read_bin,
    ".pcd": read_cloud,
    ".ply": read_cloud,
    ".laz": read_laz,
}


def read_points(path: Path) -> Arrays:
    """Read the arrays of a point-cloud file, chosen by its suffix.

    Returns:
        points_lidar: (N, 3) float32 or float64, m, finite.
        intensity: (N,) float32 as the file has it, if it has.
        time_offset_ns: (N,) int64, from .npz, if it has.
        ring: (N,) uint8, from .npz, .pcd and .ply, if it has.
        gps_time: (N,) float64 as the file has it, from .laz, if it has.
        time: (N,) as the file has it, from a field of .pcd and .ply that is called as one of `TIME_FIELDS`.

    Raises:
        UnknownNameError: a suffix that is not read here.
        DataError: missing, cut short, an array that is missing or of another shape, or points that are not finite.
    """
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise UnknownNameError("point-cloud suffix", path.suffix, FORMATS)
    if not path.is_file():
        raise DataError(path, expected="a point-cloud file", got="no such file")
    if path.stat().st_size > LARGEST_BYTES:
        raise DataError(path, expected=f"a sweep of at most {LARGEST_BYTES} bytes", got=str(path.stat().st_size))
    try:
        arrays = FORMATS[suffix](path)
    except OSError as error:
        raise DataError(path, expected="a readable point-cloud file", got=error.strerror or str(error)) from error
    points = arrays["points_lidar"]
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind != "f":
        got = f"{points.shape} {points.dtype}"
        raise DataError(path, field="points_lidar", expected="(N, 3) floating point", got=got)
    for name, values in arrays.items():
        if name != "points_lidar" and values.shape != (len(points),):
            raise DataError(path, field=name, expected=f"({len(points)},), one per point", got=str(values.shape))
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            rows = ~np.isfinite(values.reshape(len(points), -1)).all(axis=1)
            got = f"NaN or infinity in {rows.sum()} rows, the first is {int(rows.argmax())}"
            raise DataError(path, field=name, expected="finite numbers", got=got)
    if points.size and np.abs(points).max() > FARTHEST_M:
        expected, got = f"coordinates within {FARTHEST_M:g} m", f"{np.abs(points).max():g}"
        raise DataError(path, field="points_lidar", expected=expected, got=got)
    return arrays


def read_sweep(path: Path, timestamp_ns: int) -> LidarSweep:
    """Read one revolution.

    In .laz files `gps_time` is taken as absolute nanoseconds in the clock of `timestamp_ns`, and intensities as
    0 to 255. Times in .pcd and .ply have no stated unit or origin. They are seconds, milliseconds, microseconds or
    nanoseconds, whichever makes the sweep last 10 ms to a second, which only one of them can; and they count from
    `timestamp_ns`, or in its clock where that puts them nearer to it.

    Args:
        path: the file.
        timestamp_ns: the sweep's reference time.

    Raises:
        DataError: as `read_points`, or points a second or more away from the sweep's time.
    """
    arrays = read_points(path)
    intensity = arrays.get("intensity")
    offsets_ns = arrays.get("time_offset_ns")
    field = "time_offset_ns"
    if path.suffix.lower() == ".laz":
        intensity = None if intensity is None else intensity / np.float32(255.0)
        field = "gps_time"
        if field in arrays:
            offsets_ns = _whole_ns(path, arrays[field], timestamp_ns)
    if "time" in arrays:
        field, offsets_ns = "time", _offsets_ns(path, arrays["time"], timestamp_ns)
    if offsets_ns is not None and offsets_ns.size and not _is_near(offsets_ns):
        expected = f"times within a second of {timestamp_ns}, ns"
        got = f"{int(offsets_ns.min())} to {int(offsets_ns.max())} ns away"
        raise DataError(path, field=field, expected=expected, got=got)
    return LidarSweep(
        timestamp_ns=timestamp_ns,
        points_lidar=arrays["points_lidar"],
        time_offset_ns=offsets_ns,
        intensity=intensity,
        ring=arrays.get("ring"),
    )


def _whole_ns(path: Path, gps_time: NDArray[np.float64], timestamp_ns: int) -> NDArray[np.int64]:
    """Whole nanoseconds below 2^53 (104 days) are exact in the file's float64; beyond 2^62 they are no times."""
    if gps_time.size and np.abs(gps_time).max() >= 2.0**62:
        got = f"{gps_time.min():g} to {gps_time.max():g}"
        raise DataError(path, field="gps_time", expected=f"times within a second of {timestamp_ns}, ns", got=got)
    return np.asarray(gps_time.round().astype(np.int64) - timestamp_ns)


def _offsets_ns(path: Path, times: NDArray[Any], timestamp_ns: int) -> NDArray[np.int64] | None:
    """Times of points from the sweep's; None where all are 0, as where a tool had none."""
    if not times.any():
        return None
    first, last = times.min(), times.max()
    span = float(last - first)
    unit_ns = next((unit for unit in UNITS_NS if SHORTEST_SWEEP_NS <= span * unit < FARTHEST_TIME_NS), None)
    if unit_ns is None:
        expected = "times of points that are 10 ms to a second apart, in s, ms, us or ns"
        raise DataError(path, field="time", expected=expected, got=f"{first} to {last}")
    whole = times.dtype.kind != "f"  # nanoseconds since 1970 have more digits than a float
    first_ns = int(first) * unit_ns if whole else round(float(first) * unit_ns)
    since_first_ns = np.rint((times - first).astype(np.float64) * unit_ns).astype(np.int64)
    middle_ns = first_ns + int(since_first_ns.max()) // 2
    origin_ns = 0 if abs(middle_ns) <= abs(middle_ns - timestamp_ns) else timestamp_ns
    if abs(first_ns - origin_ns) >= FARTHEST_TIME_NS:
        expected = f"times within a second of {timestamp_ns} or of 0, ns"
        raise DataError(
            path, field="time", expected=expected, got=f"{first_ns} to {first_ns + int(since_first_ns.max())}"
        )
    return np.asarray(since_first_ns + (first_ns - origin_ns))


def _is_near(offsets_ns: NDArray[np.int64]) -> bool:
    return int(offsets_ns.min()) > -FARTHEST_TIME_NS and int(offsets_ns.max()) < FARTHEST_TIME_NS


def write_sweep(path: Path, sweep: LidarSweep) -> None:
    """Write one revolution as .npz; the same sweep gives the same bytes.

    Args:
        path: the file, overwritten.
        sweep: the points; they are stored as float32.
    """
    arrays = {name: getattr(sweep, name) for name in NPZ_TYPES if getattr(sweep, name) is not None}
    arrays["points_lidar"] = sweep.points_lidar.astype(np.float32)
    np.savez_compressed(path, **arrays)  # zip entries carry a fixed date
