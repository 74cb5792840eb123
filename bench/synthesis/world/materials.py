"""What the street is made of.

Albedos are those of a picture rather than of a radiometer: 0.8 is white paint, 0.1 is rubber. Contrast is the standard
deviation of the texture at its finest level, relative to the albedo. Grey images of dry asphalt by day have a standard
deviation of 8 to 15 % of their mean once lens and pixels have averaged over several stones, of which the road at 1 to
5 m leaves about 0.8 at 640 x 480; the stones alone therefore have 0.10 to 0.17, the coarser the rougher the chippings.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bench.synthesis.mesh import Surface

PAINT = Surface(albedo=0.74, contrast=0.12, texel_m=0.006)
BITUMEN = Surface(albedo=0.14, contrast=0.12, texel_m=0.006)  # sealed cracks and the rims of patches
CONCRETE = Surface(albedo=0.50, contrast=0.10, texel_m=0.006)
KERB = Surface(albedo=0.54, contrast=0.12, texel_m=0.006)
SETTS = Surface(albedo=0.36, contrast=0.18, texel_m=0.008)
CAST_IRON = Surface(albedo=0.22, contrast=0.15, texel_m=0.006)
STAIN = Surface(albedo=0.2, contrast=0.12, texel_m=0.005)
GRASS = Surface(albedo=0.27, contrast=0.30, texel_m=0.012)
SOIL = Surface(albedo=0.22, contrast=0.25, texel_m=0.012)
BARK = Surface(albedo=0.26, contrast=0.30, texel_m=0.015)
LEAVES = Surface(albedo=0.30, contrast=0.40, texel_m=0.03)
PANE = Surface(albedo=0.12, contrast=0.35, texel_m=0.03, mirror=0.08)  # two layers of glass, 0.04 each
FRAME = Surface(albedo=0.76, contrast=0.06)
STEEL = Surface(albedo=0.44, contrast=0.10, texel_m=0.01)  # galvanised
DARK_STEEL = Surface(albedo=0.18, contrast=0.12, texel_m=0.01)
WOOD = Surface(albedo=0.38, contrast=0.25, texel_m=0.012)
SIGN_WHITE = Surface(albedo=0.86, contrast=0.03)
SIGN_RED = Surface(albedo=0.30, contrast=0.03)
SIGN_BLUE = Surface(albedo=0.26, contrast=0.03)
# Glow is in units of white paper by day, some 10,000 cd/m2: a street lamp's lens has that, a lit room's window 40.
LAMP_LENS = Surface(albedo=0.85, contrast=0.02, glow=1.0)
LIT_PANE = replace(PANE, albedo=0.30, glow=0.004)
LIT_ADVERT = Surface(albedo=0.7, contrast=0.05, glow=0.01)
SKY = Surface(albedo=0.90, contrast=0.04, texel_m=1.5, sky=True)


def drawn_asphalt(rng: np.random.Generator) -> Surface:
    """Anything from a fresh dark road to an old pale one, of fine to coarse chippings (8 or 11 mm in town)."""
    return Surface(
        albedo=float(rng.uniform(0.25, 0.40)),
        contrast=float(rng.uniform(0.10, 0.17)),
        texel_m=float(rng.uniform(0.004, 0.006)),
    )


def drawn_slabs(rng: np.random.Generator) -> Surface:
    """Concrete slabs or stone of a pavement."""
    return Surface(albedo=float(rng.uniform(0.40, 0.56)), contrast=float(rng.uniform(0.08, 0.14)), texel_m=0.006)


def drawn_wall(rng: np.random.Generator) -> Surface:
    """Plaster, brick or rough stone of a house."""
    grain = float(rng.choice([0.008, 0.015, 0.03]))
    return Surface(albedo=float(rng.uniform(0.30, 0.75)), contrast=float(rng.uniform(0.08, 0.22)), texel_m=grain)


def tinted(surface: Surface, factor: float) -> Surface:
    """The same, lighter or darker."""
    return replace(surface, albedo=float(np.clip(surface.albedo * factor, 0.02, 0.95)))
