"""Images of a recording: one ray per pixel, and four where an edge runs through it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.cameras.model import CameraModel, RollingShutter
from bench.geometry import RigidTransform
from bench.recordings import MountedCamera, RecordingWriter
from bench.synthesis.ego import own_body
from bench.synthesis.imaging.exposure import Sensor, Shutter, blur, find_motion_vectors, smooth_edges
from bench.synthesis.imaging.faces import GLOW, Faces, FacesOfBodies, TextureAtlas, faces_of, texture_atlas
from bench.synthesis.imaging.lights import NO_LAMPS, Shadows, Sky, lamp_faces, lamps_of, street_lamps_m
from bench.synthesis.imaging.shading import LANES, PIXELS, ShadingScene, shade
from bench.synthesis.imaging.visibility import View, find_visible, lens_of, untiled
from bench.synthesis.mesh import Mesh, PlacedMesh
from bench.synthesis.scenario import RecordingSpec, Scenario, SensorSpec, named_rng
from bench.synthesis.scene import FIRST_IMAGE_NS, Lighting, Scene

BAND_S = 1e-3  # in which a car at 50 km/h drives 14 mm


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RenderedImage:
    """Rendered view of a camera.

    Attributes:
        pixels: (H, W) uint8; 0 where the lens sees nothing.
        instance_ids: (H, W) uint16, of what each pixel's centre sees in the middle of the exposure; 0 for the static
            world, the sky, the ego vehicle's own body and invalid pixels.
        distances_m: (H, W) float32 along each ray; infinite in the sky.
    """

    pixels: NDArray[np.uint8]
    instance_ids: NDArray[np.uint16]
    distances_m: NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moment:
    """Poses of everything at some time.

    Attributes:
        placed: everything that moves, but the ego vehicle; the same bodies at every time.
        world_from_vehicle: the ego vehicle.
    """

    placed: Sequence[PlacedMesh]
    world_from_vehicle: RigidTransform


class _Seen(NamedTuple):
    """An image before the sensor reads it out: grey values, 1 is white, and the rest as of `RenderedImage`."""

    grey: NDArray[np.float32]
    instance_ids: NDArray[np.uint16]
    distances_m: NDArray[np.float32]


def readout_bands(camera: CameraModel, shutter: RollingShutter) -> list[tuple[tuple[slice, slice], int]]:
    """Bands of rows that are rendered at one time each: their pixels, and ns from the middle row to their middle."""
    upright, everything = shutter.direction in {"down", "up"}, slice(None)
    size = camera.height if upright else camera.width
    edges = np.linspace(0, size, min(int(np.ceil(shutter.readout_s / BAND_S)), size) + 1).round().astype(int)
    middles = np.repeat((edges[1:] + edges[:-1] - 1)[:, None] / 2, 2, axis=1)
    offsets_ns = np.rint(shutter.row_time_offset_s(middles, camera) * 1e9).astype(int).tolist()
    spans = [slice(first, last) for first, last in pairwise(edges.tolist())]
    return [
        ((span, everything) if upright else (everything, span), offset_ns)
        for span, offset_ns in zip(spans, offsets_ns, strict=True)
    ]


class ImageRenderer:
    """Renders one camera.

    Args:
        camera: on the ego vehicle.
        own_body: what the camera may see of the ego vehicle, and what throws its shadow, vehicle frame.
        world: the static world, world frame.
        atlas: the texture of every surface.
        light: sun, clouds or night.
        sensor: how the camera errs.
    """

    def __init__(
        self,
        camera: MountedCamera,
        *,
        own_body: Mesh,
        world: Mesh,
        atlas: TextureAtlas,
        light: Lighting,
        sensor: SensorSpec,
    ) -> None:
        self._camera, self._own_body, self._atlas, self._light = camera, own_body, atlas, light
        self._lens = lens_of(camera.model)
        self._world, self._bodies = faces_of(world), FacesOfBodies(lit=light.kind.night)
        self._sensor = Sensor(sensor, self._lens, gain=light.kind.gain)
        self._shadows = Shadows(self._world.corners_m, light)
        self._sky = Sky(
            horizon=np.float32(light.kind.horizon),
            zenith=np.float32(light.kind.zenith),
            cloud=np.float32(light.kind.cloud),
            glow=np.float32(light.kind.sun_glow),
            sun=light.towards_sun.astype(np.float32),
        )
        self._street_lamps_m = street_lamps_m(self._world)
        if not light.kind.night:
            self._world.rows[lamp_faces(self._world), GLOW] = 0.0  # switched off

    def render(self, middle: Moment, *, rng: np.random.Generator, closes: Moment | None = None) -> RenderedImage:
        """Render one image.

        Args:
            middle: the scene in the middle of the exposure.
            rng: the sensor noise.
            closes: the scene when the shutter closes, before whose middle all moves as after it; None for a still.
        """
        return self._read_out(self._seen(middle, closes), rng)

    def render_rows(
        self,
        exposed: Callable[[int], tuple[Moment, Moment]],
        *,
        shutter: RollingShutter,
        rng: np.random.Generator,
    ) -> RenderedImage:
        """Render one image whose rows are exposed one after the other, in bands of at most a millisecond.

        Args:
            exposed: gives `middle` and `closes` of `render`, of rows exposed so many ns after the middle row.
            shutter: the readout.
            rng: the sensor noise.
        """
        shape = self._lens.valid.shape
        whole = _Seen(np.empty(shape, np.float32), np.empty(shape, np.uint16), np.empty(shape, np.float32))
        for band, offset_ns in readout_bands(self._camera.model, shutter):
            seen = self._seen(*exposed(offset_ns))
            whole.grey[band] = seen.grey[band]
            whole.instance_ids[band] = seen.instance_ids[band]
            whole.distances_m[band] = seen.distances_m[band]
        return self._read_out(whole, rng)

    def _read_out(self, seen: _Seen, rng: np.random.Generator) -> RenderedImage:
        pixels = self._sensor.expose(seen.grey, rng)
        return RenderedImage(pixels=pixels, instance_ids=seen.instance_ids, distances_m=seen.distances_m)

    def _seen(self, middle: Moment, closes: Moment | None) -> _Seen:
        """The whole image as all of its rows would see it; arguments as of `render`."""
        lens = self._lens
        shape = lens.valid.shape[0], lens.valid.shape[1]
        bodies = self._bodies.at(self._meshes(middle))
        corners = np.concatenate([self._world.corners_m, *(body.corners_m for body in bodies)])
        rows = np.concatenate([self._world.rows, *(body.rows for body in bodies)])
        world_from_camera = middle.world_from_vehicle @ self._camera.vehicle_from_camera
        rotation, origin_m = np.ascontiguousarray(world_from_camera.rotation), world_from_camera.translation_m
        view = find_visible(corners, lens, camera_from_world=rotation.T.copy(), origin_m=origin_m)
        triangles, inverse_depth, planes = (
            untiled(view.triangles, shape),
            untiled(view.inverse_depth, shape),
            view.planes,
        )
        centre = self._shaded(view, rows, corners, bodies, middle, rotation, origin_m)
        grey = np.empty_like(centre)
        smooth_edges(triangles, lens.valid, lens.rays, lens.along_u, lens.along_v, planes, rows, centre, grey)
        if closes is not None:
            motion = self._shutter(middle, corners[len(self._world.corners_m) :], closes)
            motion_vectors, sharp = np.empty((2, *shape), dtype=np.float32), grey
            find_motion_vectors(triangles, inverse_depth, lens.rays, lens.across, planes, motion, motion_vectors)
            grey = np.empty_like(sharp)
            blur(sharp, motion_vectors, inverse_depth, lens.valid, grey)
        ids = np.repeat(  # the last one, of the ego vehicle, also serves NOTHING = -1
            np.array([0, *(part.instance_id for part in middle.placed), 0], dtype=np.uint16),
            [len(self._world.corners_m), *(len(body.corners_m) for body in bodies)],
        )
        with np.errstate(divide="ignore"):
            distances_m = np.float32(1.0) / inverse_depth  # infinite in the sky
        return _Seen(grey, ids[triangles], distances_m)

    def _shaded(
        self,
        view: View,
        rows: NDArray[np.float32],
        corners: NDArray[np.float64],
        bodies: Sequence[Faces],
        middle: Moment,
        rotation: NDArray[np.float64],
        origin_m: NDArray[np.float64],
    ) -> NDArray[np.float32]:
        """Grey values of what the pixels' centres see, 1 is white."""
        lens, light, lamps = self._lens, self._light, NO_LAMPS
        if light.kind.night:
            others = corners[: len(corners) - len(bodies[-1].corners_m)]
            lamps = lamps_of(others, self._street_lamps_m, middle.world_from_vehicle)
        with self._shadows.around(origin_m, [body.corners_m for body in bodies]) as (near, far, cover):
            scene = ShadingScene(
                rows, rotation.astype(np.float32), origin_m.astype(np.float32), light.towards_sun.astype(np.float32),
                np.float32(light.kind.sun_light), np.float32(light.kind.sky_light), near, far, cover, self._sky, lamps,
                light.kind.night, self._atlas,
            )  # fmt: skip
            grey, lanes = np.empty(view.inverse_depth.shape, np.float32), np.zeros(LANES, np.float32)
            spots = np.zeros(PIXELS, np.int32)
            shade(view.triangles, lens.tiles.rays, lens.tile_pixel_rad, view.planes, scene, lanes, spots, grey)
        return untiled(grey, (lens.valid.shape[0], lens.valid.shape[1]))

    def _shutter(self, middle: Moment, corners_m: NDArray[np.float64], closes: Moment) -> Shutter:
        """Motion of everything; `corners_m` are those of all that moves, in the middle of the exposure."""
        there_m = corners_m, np.concatenate([mesh.corners_m for mesh in self._meshes(closes)])
        mounting = self._camera.vehicle_from_camera
        then_from_world = [(moment.world_from_vehicle @ mounting).inverse() for moment in (middle, closes)]
        first, last = (then @ (middle.world_from_vehicle @ mounting) for then in then_from_world)
        corners_then_m = [
            then.apply(there.reshape(-1, 3)).reshape(-1, 3, 3)
            for then, there in zip(then_from_world, there_m, strict=True)
        ]
        return Shutter(
            (2.0 * (last.rotation - first.rotation)).astype(np.float32),
            (2.0 * (last.translation_m - first.translation_m)).astype(np.float32),
            len(self._world.corners_m),
            (2.0 * (corners_then_m[1] - corners_then_m[0])).astype(np.float32),
        )

    def _meshes(self, moment: Moment) -> list[Mesh]:
        """Everything that moves, the ego vehicle last."""
        return [*(part.mesh for part in moment.placed), self._own_body.moved(moment.world_from_vehicle)]


def write_images(
    scenario: Scenario, spec: RecordingSpec, scene: Scene, *, camera: MountedCamera, writer: RecordingWriter
) -> None:
    """Render and write every image of one camera, and the truth beside it; an image's time is mid exposure."""
    sensor = next(entry.sensor for entry in scenario.cameras if entry.name == camera.name)
    renderer = ImageRenderer(
        camera,
        own_body=own_body(),
        world=scene.world,
        atlas=texture_atlas(scenario.seed),
        light=scene.light,
        sensor=sensor,
    )
    half_ns = round(scene.light.kind.shutter_ms * 1e6 / 2)
    for frame, time_ns in enumerate(scene.image_times_ns.tolist()):

        def exposed(offset_ns: int, time_ns: int = time_ns) -> tuple[Moment, Moment]:
            return moment(scene, time_ns + offset_ns), moment(scene, time_ns + offset_ns + half_ns)

        rng = named_rng(scenario.seed, spec.name, camera.name, frame)
        if camera.rolling_shutter is None:
            middle, closes = exposed(0)
            image = renderer.render(middle, rng=rng, closes=closes)
        else:
            image = renderer.render_rows(exposed, shutter=camera.rolling_shutter, rng=rng)
        timestamp_ns = time_ns + FIRST_IMAGE_NS
        writer.image(camera.name, timestamp_ns, image.pixels, jpeg_quality=sensor.jpeg_quality)
        writer.truth(camera.name, timestamp_ns, image.instance_ids)


def moment(scene: Scene, time_ns: int) -> Moment:
    """Return the poses of everything at a time of the scene clock."""
    return Moment(
        placed=[actor.placed(time_ns) for actor in scene.actors], world_from_vehicle=scene.ego.at([time_ns]).transform()
    )
