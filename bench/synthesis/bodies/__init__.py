"""Bodies that move, by the names that a scenario gives them: vehicles, riders, pedestrians, a dog."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from bench.synthesis.bodies.body import Body, Built, assemble_body
from bench.synthesis.bodies.dog import dog
from bench.synthesis.bodies.people import Stature, pedestrian, with_pram
from bench.synthesis.bodies.riders import RACING, ROADSTER, SCOOTER, UPRIGHT, cyclist, motorcyclist
from bench.synthesis.bodies.vehicles import VEHICLES, vehicle

Builder = Callable[[np.random.Generator], Built]

BODIES: dict[str, tuple[str, Builder]] = {
    **{kind: ("vehicle", partial(vehicle, shape)) for kind, shape in VEHICLES.items()},
    "cyclist": ("cyclist", partial(cyclist, Stature(height_m=1.75), UPRIGHT)),
    "tall_cyclist": ("cyclist", partial(cyclist, Stature(height_m=1.88), UPRIGHT)),
    "short_cyclist": ("cyclist", partial(cyclist, Stature(height_m=1.62), UPRIGHT)),
    "racing_cyclist": ("cyclist", partial(cyclist, Stature(height_m=1.78, girth=0.95), RACING)),
    "child_cyclist": ("cyclist", partial(cyclist, Stature(height_m=1.30, girth=0.95, head=1.25), UPRIGHT)),
    "motorcyclist": ("cyclist", partial(motorcyclist, Stature(height_m=1.80), ROADSTER)),
    "scooter_rider": ("cyclist", partial(motorcyclist, Stature(height_m=1.70), SCOOTER)),
    "adult": ("pedestrian", partial(pedestrian, Stature(height_m=1.75))),
    "short_adult": ("pedestrian", partial(pedestrian, Stature(height_m=1.60))),
    "tall_adult": ("pedestrian", partial(pedestrian, Stature(height_m=1.90, girth=0.95))),
    "stout_adult": ("pedestrian", partial(pedestrian, Stature(height_m=1.70, girth=1.30))),
    "child": ("pedestrian", partial(pedestrian, Stature(height_m=1.20, girth=0.95, head=1.3))),
    "small_child": ("pedestrian", partial(pedestrian, Stature(height_m=0.98, girth=1.05, head=1.45))),
    "large_adult": ("pedestrian", partial(pedestrian, Stature(height_m=2.00, girth=1.25))),
    "with_pram": ("pedestrian", partial(with_pram, Stature(height_m=1.68))),
    "dog": ("animal", dog),
}


def make_body(kind: str, rng: np.random.Generator) -> Body:
    """Build a body.

    Args:
        kind: a name of `BODIES`.
        rng: chooses its looks, the part of the texture that it wears and where in its cycle it starts.
    """
    object_class, build = BODIES[kind]
    parts, joints, cycle_m = build(rng)
    shift_m = rng.uniform(0, 8, 2)
    shifted = [(mesh.with_texture_shift(shift_m), joint) for mesh, joint in parts]
    return assemble_body(object_class, shifted, joints, cycle_m=cycle_m, start_m=float(rng.uniform(0, cycle_m)))
