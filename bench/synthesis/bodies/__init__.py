"""Bodies that move: vehicles, cyclists, pedestrians, a dog; their parts, joints and postures."""

from bench.synthesis.bodies.body import Body
from bench.synthesis.bodies.catalogue import BODIES, make_body

__all__ = ["BODIES", "Body", "make_body"]
