"""Room to shade one tile: for each quantity a lane with its values at the 64 pixels, beside each other.

All lanes lie in one array, so that the compiler sees that no two of them overlap, and takes several pixels at once.
"""

from __future__ import annotations

from bench.synthesis.imaging.lens import TILE_PX

PIXELS = TILE_PX * TILE_PX
# First the ray, in world axes, and what it meets: normal on the side that is seen, place, cosine between the two.
# Then spots, those pixels whose light of the lamps is found, and what one headlight sends to each.
(
    RAY_X, RAY_Y, RAY_Z, TOWARDS_X, TOWARDS_Y, TOWARDS_Z, PLACE_X, PLACE_Y, PLACE_Z, FACING, DISTANCE,
    TEXTURE_U, TEXTURE_V, LEVEL, NOISE, LIGHT,
    SPOT_X, SPOT_Y, SPOT_Z, SPOT_TOWARDS_X, SPOT_TOWARDS_Y, SPOT_TOWARDS_Z, SPOT_LIGHT,
    BEAM, BEAM_ASIDE, BEAM_DOWN, BEAM_ALONG, BEAM_SQUARE,
) = range(0, 28 * PIXELS, PIXELS)  # fmt: skip
LANES = 28 * PIXELS
