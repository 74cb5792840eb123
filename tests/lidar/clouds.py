"""Point clouds in every format that is read, written for tests."""

import laspy
import numpy as np

from bench.lidar import open3d


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
    library = open3d()
    cloud = library.t.geometry.PointCloud()
    cloud.point.positions = library.core.Tensor(np.ascontiguousarray(arrays["points_lidar"], dtype=np.float32))
    if "intensity" in arrays:
        cloud.point["intensity"] = library.core.Tensor(arrays["intensity"].astype(np.float32)[:, None])
    assert library.t.io.write_point_cloud(str(path), cloud)


def write_laz(path, arrays):
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales = np.full(3, 0.001)
    cloud = laspy.LasData(header)
    cloud.xyz = arrays["points_lidar"]
    for name in ("intensity", "gps_time"):
        if name in arrays:
            setattr(cloud, name, arrays[name])
    cloud.write(path)
