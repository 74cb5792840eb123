"""Exact optical flow of a simulated scene: what a perfect flow algorithm would have measured.

A ray through each cell's centre meets a triangle at the time of the current image. The same point of the same triangle
is looked up at the time of the previous image, when the ego vehicle, the actors and their limbs stood elsewhere, and is
projected with the true camera. Direction and grid are those of `bench.flow`: what is seen at x in the current image
was at `x + flow[x]` in the previous one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.cameras.model import ray_grid
from bench.egomotion.trajectory import camera_motion
from bench.errors import UsageError
from bench.geometry import RigidTransform, RoadPlane, cross, dot
from bench.records.recording import MountedCamera
from bench.synthesis.rays import RayScene
from bench.synthesis.scene import FIRST_IMAGE_NS, Scene

# What is met this little before a point does not hide it: single precision, and a lane marking on the road below it.
SAME_POINT_M, SAME_POINT_SHARE = 0.05, 0.002


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExactFlow:
    """The exact flow of one pair of images, on cells.

    Attributes:
        flow: (rows, columns, 2) float64, px, from the current to the previous image, also where the point was hidden or
            outside of the image then; NaN where the ray meets nothing or the lens did not see the point then.
        visible: (rows, columns) bool; the previous image shows the same point.
        instance_ids: (rows, columns) uint16, of what the cell's centre sees; 0 for the static world.
    """

    flow: NDArray[np.float64]
    visible: NDArray[np.bool_]
    instance_ids: NDArray[np.uint16]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Moment:
    """The scene and the camera at one time, world frame."""

    corners_m: NDArray[np.float64]
    moving: RayScene | None
    world_from_camera: RigidTransform


class ExactFlowCaster:
    """Gives the exact flow of one camera of a simulated recording.

    Args:
        scene: the scene.
        camera: with its true lens and mounting.
        valid: (H, W) bool, pixels that see something else than the ego vehicle's own body.
        cell_size_px: side of the cells; 1 for every pixel.

    Raises:
        UsageError: a camera with a rolling shutter.
    """

    def __init__(self, scene: Scene, camera: MountedCamera, *, valid: NDArray[np.bool_], cell_size_px: int = 1) -> None:
        if camera.rolling_shutter is not None:
            raise UsageError(
                f"exact flow: camera {camera.name!r}: expected one that exposes all rows at once, got a rolling shutter"
            )
        self._scene, self._camera, self._valid = scene, camera, valid
        self._cells = ray_grid(camera.model, cell_size_px)
        self._world_m = scene.world.corners_m
        self._static = RayScene(self._world_m)
        counts = [len(actor.body.mesh.corners_m) for actor in scene.actors]
        actor_ids = np.repeat([actor.instance_id for actor in scene.actors], counts)
        self._ids = np.concatenate([np.zeros(len(self._world_m)), actor_ids]).astype(np.uint16)

    def flow(self, *, current_ns: int, previous_ns: int) -> ExactFlow:
        """The flow between two images, times on the recording's clock."""
        now, before = self._moment(current_ns), self._moment(previous_ns)
        shape = self._cells.valid.shape
        asked = np.flatnonzero(self._cells.valid)
        rays_world = now.world_from_camera.rotate(self._cells.rays_camera.reshape(-1, 3)[asked])
        distances, triangles = self._cast(now, rays_world)
        met = np.isfinite(distances)
        asked, rays_world, triangles = asked[met], rays_world[met], triangles[met]
        weights = _weights(now.corners_m[triangles], now.world_from_camera.translation_m, rays_world)
        points_m = np.einsum("nk,nkd->nd", weights, before.corners_m[triangles])

        pixels, in_lens = self._camera.model.project(before.world_from_camera.inverse().apply(points_m))
        flow = np.full((len(self._cells.valid.reshape(-1)), 2), np.nan)
        flow[asked] = pixels - self._cells.pixels.reshape(-1, 2)[asked]
        visible, ids = np.zeros(len(flow), dtype=bool), np.zeros(len(flow), dtype=np.uint16)
        visible[asked] = in_lens & self._shown(pixels) & self._free(before, points_m)
        ids[asked] = self._ids[triangles]
        return ExactFlow(flow=flow.reshape(*shape, 2), visible=visible.reshape(shape), instance_ids=ids.reshape(shape))

    def motion(self, *, current_ns: int, previous_ns: int) -> RigidTransform:
        """`current_from_previous` of the camera, by the true poses."""
        return camera_motion(
            world_from_vehicle_previous=self._world_from_vehicle(previous_ns),
            world_from_vehicle_current=self._world_from_vehicle(current_ns),
            vehicle_from_camera=self._camera.vehicle_from_camera,
        )

    def road(self, timestamp_ns: int) -> RoadPlane:
        """The road in the camera frame, by the true pose: it tilts when the body pitches and rolls."""
        world_from_camera = self._world_from_camera(timestamp_ns)
        down = world_from_camera.inverse().rotate(np.array([0.0, 0.0, -1.0]))
        return RoadPlane(down, float(world_from_camera.translation_m[2]))

    def _moment(self, timestamp_ns: int) -> _Moment:
        placed = [actor.placed(timestamp_ns - FIRST_IMAGE_NS).mesh.corners_m for actor in self._scene.actors]
        return _Moment(
            corners_m=np.concatenate([self._world_m, *placed]),
            moving=RayScene(np.concatenate(placed)) if placed else None,
            world_from_camera=self._world_from_camera(timestamp_ns),
        )

    def _world_from_vehicle(self, timestamp_ns: int) -> RigidTransform:
        return self._scene.ego.at([timestamp_ns - FIRST_IMAGE_NS]).transform()

    def _world_from_camera(self, timestamp_ns: int) -> RigidTransform:
        return self._world_from_vehicle(timestamp_ns) @ self._camera.vehicle_from_camera

    def _cast(self, moment: _Moment, directions: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Distances in lengths of the directions, and rows of `moment.corners_m`."""
        origins_m = np.broadcast_to(moment.world_from_camera.translation_m, directions.shape)
        hits = self._static.cast(directions, origins_m)
        distances, triangles = hits.distances_m.copy(), hits.triangles.copy()
        if moment.moving is not None:
            actors = moment.moving.cast(directions, origins_m)
            nearer = actors.distances_m < distances
            distances[nearer] = actors.distances_m[nearer]
            triangles[nearer] = actors.triangles[nearer] + len(self._world_m)
        return distances, triangles

    def _free(self, moment: _Moment, points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Nothing stands between the camera and the points, (N,) bool."""
        rays_world = points_m - moment.world_from_camera.translation_m
        shares, _ = self._cast(moment, rays_world)
        length_m = np.linalg.norm(rays_world, axis=1)
        return np.asarray((1.0 - shares) * length_m < np.maximum(SAME_POINT_M, SAME_POINT_SHARE * length_m))

    def _shown(self, pixels: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Pixels inside the image and off the ego vehicle's own body, (N,) bool."""
        inside = self._camera.model.contains(pixels)
        column, row = np.rint(np.where(inside[:, None], pixels, 0.0)).astype(np.intp).T
        return np.asarray(inside & self._valid[row, column])


def _weights(
    corners_m: NDArray[np.float64], origin_m: NDArray[np.float64], rays: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Barycentric weights of each corner where a ray meets its triangle's plane.

    In double precision: the ray caster's own are single, which on a street of 100 m is off by centimetres.

    Args:
        corners_m: (N, 3, 3) float64, m.
        origin_m: (3,) float64, m.
        rays: (N, 3) float64.

    Returns:
        (N, 3) float64, sums 1.

    Source:
        Möller and Trumbore 1997.
    """
    edge_b, edge_c = corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0]
    start = origin_m - corners_m[:, 0]
    across = cross(rays, edge_c)
    volume = dot(edge_b, across)
    b = dot(start, across) / volume
    c = dot(rays, cross(start, edge_b)) / volume
    return np.stack([1.0 - b - c, b, c], axis=1)
