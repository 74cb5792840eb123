"""What a scenario holds, told from its geometry alone: nothing is rendered, and no method is run."""

from __future__ import annotations

from collections import Counter

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.cameras import ray_grid
from bench.evaluation.protocol import load_protocol
from bench.recordings import MountedCamera
from bench.records.reference import ReferenceSettings
from bench.reference.motion import categorise
from bench.synthesis.bodies import BODIES
from bench.synthesis.ego import mounted_camera
from bench.synthesis.scenario import RecordingSpec, Scenario
from bench.synthesis.scene import Trajectories, box_outline, box_size, footprints, plan_trajectories

SEEN_SHARE = 0.12  # of the points on a body's box; a box's far sides are never seen
PAPER = load_protocol("paper-v1").reference_settings()


def object_frames(
    scenario: Scenario, settings: ReferenceSettings = PAPER, *, every: int = 1
) -> dict[str, Counter[str]]:
    """Expected evaluated object-frames: recording -> category -> number, all cameras together.

    Args:
        scenario: series spelled out.
        settings: which objects are evaluated.
        every: looks at every n-th image alone, which stands for the n.
    """
    cameras = [mounted_camera(camera) for camera in scenario.cameras]
    return {spec.name: _of_recording(scenario, spec, cameras, settings, every) for spec in scenario.recordings}


def _of_recording(
    scenario: Scenario, spec: RecordingSpec, cameras: list[MountedCamera], settings: ReferenceSettings, every: int
) -> Counter[str]:
    trajectories = plan_trajectories(scenario, spec)
    sizes = [box_size(actor.kind) for actor in spec.actors]
    found: Counter[str] = Counter()
    for time_ns in trajectories.image_times_ns[every // 2 :: every].tolist():
        boxes = [_Box(trajectories, k, size, time_ns) for k, size in enumerate(sizes)]
        for k, box in enumerate(boxes):
            category = _category(trajectories, k, time_ns, settings)
            if category is None or BODIES[spec.actors[k].kind][0] not in settings.classes:
                continue
            for camera in cameras:
                if box.range_m(trajectories, camera, time_ns) > settings.range_limit_m:
                    continue
                if box.seen_share(trajectories, camera, time_ns, boxes[:k] + boxes[k + 1 :]) >= SEEN_SHARE:
                    found[category] += every
    return found


def _category(trajectories: Trajectories, actor: int, time_ns: int, settings: ReferenceSettings) -> str | None:
    """Category at an image; None while the actor stands."""
    motion = trajectories.actors[actor].velocity_mps(time_ns)
    if float(np.hypot(*motion[:2])) < settings.motion.static_below_mps:
        return None
    return str(categorise(motion, trajectories.ego.velocity_mps(time_ns), settings.motion).value)


class _Box:
    """The box around an actor's body at one time."""

    def __init__(self, trajectories: Trajectories, actor: int, size_m: NDArray[np.float64], time_ns: int) -> None:
        self.size_m, self.path, self.time_ns = size_m, trajectories.actors[actor], time_ns
        self.pose = self.path.at([time_ns]).transform()

    def range_m(self, trajectories: Trajectories, camera: MountedCamera, time_ns: int) -> float:
        place = self._camera_world(trajectories, camera, time_ns)
        box = footprints(self.path.at([time_ns]), box_outline(self.size_m))[0]
        return float(shapely.distance(box, shapely.Point(place[:2])))

    def seen_share(self, trajectories: Trajectories, camera: MountedCamera, time_ns: int, others: list[_Box]) -> float:
        """Share of points on the box that the camera sees past the ego vehicle and the other boxes."""
        steps = (np.arange(4) + 0.5) / 4
        x, y, z = (v.ravel() for v in np.meshgrid(steps - 0.5, steps - 0.5, steps))
        points_world = self.pose.apply(np.stack([x, y, z], axis=1) * self.size_m)
        world_from_camera = trajectories.ego.at([time_ns]).transform() @ camera.vehicle_from_camera
        pixels, valid = camera.model.project(world_from_camera.inverse().apply(points_world))
        inside = valid & camera.model.contains(pixels)
        rows, columns = (np.rint(np.nan_to_num(pixels[:, k])).astype(int).clip(0) for k in (1, 0))
        region = ray_grid(camera.model).valid
        region = region if camera.ego_body is None else region & ~camera.ego_body
        inside[inside] = region[rows[inside].clip(0, region.shape[0] - 1), columns[inside].clip(0, region.shape[1] - 1)]
        place = self._camera_world(trajectories, camera, time_ns)
        for other in others:
            inside &= ~other.hides(place, points_world)
        return float(inside.mean())

    def hides(self, place: NDArray[np.float64], points_world: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether the box stands between a place and each of the points."""
        inverse = self.pose.inverse()
        start, ends = inverse.apply(place[None])[0], inverse.apply(points_world)
        low = np.array([-self.size_m[0] / 2, -self.size_m[1] / 2, 0.0])
        high = low + self.size_m
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (low - start) / (ends - start), (high - start) / (ends - start)
        enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
        return np.asarray((enter < leave) & (leave > 0) & (enter < 1))

    @staticmethod
    def _camera_world(trajectories: Trajectories, camera: MountedCamera, time_ns: int) -> NDArray[np.float64]:
        return (trajectories.ego.at([time_ns]).transform() @ camera.vehicle_from_camera).translation_m
