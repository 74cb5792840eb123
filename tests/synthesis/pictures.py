"""Renderers of small worlds that no recording holds."""

import numpy as np

from bench.geometry import RoadPlane, cross, dot
from bench.recordings import MountedCamera
from bench.synthesis.imaging.faces import texture_atlas
from bench.synthesis.imaging.renderer import ImageRenderer
from bench.synthesis.mesh import Surface, box, quads
from bench.synthesis.scenario import SensorSpec
from bench.synthesis.scene import KINDS, Lighting

GREY = Surface(albedo=0.5, contrast=0.2)
PLAIN = Surface(albedo=0.5, contrast=0.0)
NOWHERE = box([0.1, 0.1, 0.1], [0, 0, -50], PLAIN)
EXACT = SensorSpec(edge_light=1.0, read_noise_grey=0.0, full_well_electrons=None)


def road(surface):
    return quads([[-90, -90, 0], [90, -90, 0], [90, 90, 0], [-90, 90, 0]], surface)


def volume_m3(mesh):
    """By the divergence theorem: positive only if every face looks outwards."""
    a, b, c = (mesh.corners_m[:, k] for k in range(3))
    return float(dot(a, cross(b, c)).sum() / 6)


def wall(x_m, surface=PLAIN, *, y_m=(-20, 20), height_m=8):
    """A wall across the road that faces the ego vehicle."""
    right_m, left_m = y_m
    return quads([[x_m, left_m, 0], [x_m, right_m, 0], [x_m, right_m, height_m], [x_m, left_m, height_m]], surface)


def mounted(model, vehicle_from_camera):
    return MountedCamera(
        name="front",
        model=model,
        vehicle_from_camera=vehicle_from_camera,
        road=RoadPlane.below(vehicle_from_camera),
        stored_size_px=(model.width, model.height),
    )


def renderer_of(camera, *, world, own_body=NOWHERE, kind="overcast", sun=(0.0, 0.6, 0.8), sensor=EXACT):
    light = Lighting(kind=KINDS[kind], towards_sun=np.array(sun) / np.linalg.norm(sun))
    return ImageRenderer(camera, own_body=own_body, world=world, atlas=texture_atlas(0), light=light, sensor=sensor)
