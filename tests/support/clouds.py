"""Point clouds in every format that is read, written for tests."""

import io

import laspy
import numpy as np


def write_points(path, arrays):
    """Write `points_lidar`, and what else the format of the suffix holds."""
    writers = {".npz": write_npz, ".bin": write_bin, ".pcd": write_cloud, ".las": write_laz, ".laz": write_laz}
    writers[path.suffix](path, arrays)


def write_npz(path, arrays):
    np.savez_compressed(path, **arrays)


def write_bin(path, arrays):
    points = arrays["points_lidar"]
    intensity = arrays.get("intensity", np.zeros(len(points), dtype=np.float32))
    np.column_stack([points, intensity]).astype("<f4").tofile(path)


def write_cloud(path, arrays):
    """Binary .pcd."""
    columns = dict(zip("xyz", np.asarray(arrays["points_lidar"]).T, strict=True))
    columns |= {name: arrays[name] for name in ("intensity",) if name in arrays}
    count, body = len(arrays["points_lidar"]), np.column_stack([*columns.values()]).astype("<f4").tobytes()
    path.write_bytes(pcd_of([(name, 4, "F", 1) for name in columns], count, body))


def pcd_of(columns, count, body, data="binary"):
    """A .pcd of named columns: (name, size, type, count)."""
    names, sizes, types, counts = (" ".join(map(str, values)) for values in zip(*columns, strict=True))
    return pcd(count, data=data, body=body, FIELDS=names, SIZE=sizes, TYPE=types, COUNT=counts)


def pcd(points, *, data="binary", body=b"", **lines):
    """A .pcd of x, y and z, but for what `lines` says of its head."""
    head = {"VERSION": "0.7", "FIELDS": "x y z", "SIZE": "4 4 4", "TYPE": "F F F", "COUNT": "1 1 1"}
    head |= {"WIDTH": str(points), "HEIGHT": "1", "VIEWPOINT": "0 0 0 1 0 0 0", "POINTS": str(points)} | lines
    return "".join(f"{key} {value}\n" for key, value in head.items()).encode() + f"DATA {data}\n".encode() + body


def write_laz(path, arrays):
    values = {name: arrays[name] for name in ("intensity", "gps_time") if name in arrays}
    path.write_bytes(laz(arrays["points_lidar"], packed=path.suffix == ".laz", **values))


def laz(points, *, point_format=1, packed=True, **values):
    """A .laz with millimetres, and what else the points have."""
    header = laspy.LasHeader(point_format=point_format, version="1.4" if point_format > 5 else "1.2")
    header.scales = np.full(3, 0.001)
    cloud = laspy.LasData(header)
    cloud.xyz = points
    for name, value in values.items():
        setattr(cloud, name, value)
    file = io.BytesIO()
    cloud.write(file, do_compress=packed)
    return file.getvalue()
