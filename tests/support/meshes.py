"""Properties of meshes and bodies."""

import numpy as np
from numpy.typing import NDArray

from bench.geometry import cross, dot
from bench.synthesis.bodies import Body
from bench.synthesis.mesh import Mesh


def volume_m3(mesh: Mesh) -> float:
    """By the divergence theorem: positive only if every face looks outwards."""
    a, b, c = (mesh.corners_m[:, k] for k in range(3))
    return float(dot(a, cross(b, c)).sum() / 6)


def open_edges(mesh: Mesh) -> int:
    """Edges that no other triangle runs along the other way."""
    corners = np.round(mesh.corners_m * 1e7).astype(np.int64)
    edges = np.concatenate([corners[:, [k, (k + 1) % 3]] for k in range(3)]).reshape(-1, 6)
    _, back = np.unique(np.concatenate([edges, edges[:, [3, 4, 5, 0, 1, 2]]]), axis=0, return_inverse=True)
    count = np.bincount(back.ravel()[: len(edges)], minlength=back.max() + 1)
    reverse = np.bincount(back.ravel()[len(edges) :], minlength=back.max() + 1)
    return int(np.abs(count - reverse).sum())


def of_joint(body: Body, name: str, corners_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Corners (N, 3) of what hangs on a joint."""
    row = [joint.name for joint in body.linkage.joints].index(name)
    start, end, _ = next(part for part in body.linkage.parts if part[2] == row)
    return corners_m[start:end].reshape(-1, 3)
