"""The static world: everything that never moves.

`build_world` lays out a plan (road, kerbs, pavements as polygons), turns it into triangles, wears and paints it, and
puts parked cars, lamps, trees, furniture and fronts where nothing else stands and no actor comes by.
"""

from bench.synthesis.world.build import build_world
from bench.synthesis.world.site import World

__all__ = ["World", "build_world"]
