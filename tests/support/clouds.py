"""Point clouds in every format that is read, written for tests."""

import laspy
import numpy as np


def write_points(path, arrays):
    """Write `points_lidar`, and what else the format of the suffix holds."""
    {".npz": write_npz, ".bin": write_bin, ".pcd": write_cloud, ".ply": write_cloud, ".laz": write_laz}[path.suffix](
        path, arrays
    )


def write_npz(path, arrays):
    np.savez_compressed(path, **arrays)


def write_bin(path, arrays):
    points = arrays["points_lidar"]
    intensity = arrays.get("intensity", np.zeros(len(points), dtype=np.float32))
    np.column_stack([points, intensity]).astype("<f4").tofile(path)


def write_cloud(path, arrays):
    """Binary .pcd or .ply, by its suffix."""
    columns = dict(zip("xyz", np.asarray(arrays["points_lidar"]).T, strict=True))
    columns |= {name: arrays[name] for name in ("intensity",) if name in arrays}
    count, names = len(arrays["points_lidar"]), " ".join(columns)
    if path.suffix == ".ply":
        properties = "".join(f"property float {name}\n" for name in columns)
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{properties}end_header\n"
    else:
        sizes, types, ones = (" ".join([value] * len(columns)) for value in ("4", "F", "1"))
        head = f"VERSION 0.7\nFIELDS {names}\nSIZE {sizes}\nTYPE {types}\nCOUNT {ones}\n"
        head += f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n"
    path.write_bytes(head.encode() + np.column_stack([*columns.values()]).astype("<f4").tobytes())


def write_laz(path, arrays):
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales = np.full(3, 0.001)
    cloud = laspy.LasData(header)
    cloud.xyz = arrays["points_lidar"]
    for name in ("intensity", "gps_time"):
        if name in arrays:
            setattr(cloud, name, arrays[name])
    cloud.write(path)
