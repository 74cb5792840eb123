"""Materials of bodies, and the random draws of their looks.

Albedos are everyday ones: white paint and paper 0.7 to 0.85, grey paint 0.3 to 0.5, dark cloth and rubber 0.03 to 0.1.
Glass and clear coats mirror 4 % of the light that falls on them squarely (Fresnel, refractive index 1.5).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bench.synthesis.mesh import Surface

GLASS = Surface(albedo=0.05, contrast=0.25, texel_m=0.03, mirror=0.04)  # what shows is the dim inside
RUBBER = Surface(albedo=0.06, contrast=0.30, texel_m=0.006)
PLASTIC = Surface(albedo=0.08, contrast=0.20)
UNDERSIDE = Surface(albedo=0.04, contrast=0.20)
ALLOY = Surface(albedo=0.50, contrast=0.15)
STEEL = Surface(albedo=0.35, contrast=0.20)
CHROME = Surface(albedo=0.25, contrast=0.05, mirror=0.5)
PLATE = Surface(albedo=0.75, contrast=0.45, texel_m=0.02)  # letters on white
HEADLAMP = Surface(albedo=0.55, contrast=0.15, mirror=0.04, glow=0.6)
TAIL_LAMP = Surface(albedo=0.14, contrast=0.15, mirror=0.04, glow=0.12)
REFLECTOR = Surface(albedo=0.30, contrast=0.10)
LEATHER = Surface(albedo=0.10, contrast=0.25)

# Roughly as cars are sold in Europe: white, black, grey, blue, silver, red.
PAINTS = (0.72, 0.05, 0.22, 0.12, 0.48, 0.16)
PAINT_SHARES = (0.24, 0.22, 0.26, 0.11, 0.09, 0.08)
SKINS = (0.22, 0.35, 0.48, 0.55)
HAIRS = (0.05, 0.08, 0.16, 0.32)
CLOTHS = (0.05, 0.10, 0.18, 0.28, 0.40, 0.55, 0.70)


def drawn_paint(rng: np.random.Generator) -> Surface:
    """A car's paint: smooth, with a little dirt, under a clear coat."""
    albedo = float(rng.choice(PAINTS, p=PAINT_SHARES))
    return Surface(albedo=albedo, contrast=float(rng.uniform(0.04, 0.10)), texel_m=0.012, mirror=0.04)


def cloth(rng: np.random.Generator) -> Surface:
    """Woven or printed cloth with folds."""
    pattern = float(rng.choice([0.12, 0.22, 0.40], p=[0.4, 0.4, 0.2]))
    return Surface(albedo=float(rng.choice(CLOTHS)), contrast=pattern, texel_m=float(rng.choice([0.004, 0.008, 0.016])))


@dataclass(frozen=True, slots=True, kw_only=True)
class Clothes:
    """Clothes of a person.

    Attributes:
        top: jacket or shirt.
        bottom: trousers, skirt.
        skin: face and hands.
        hair: hair or cap.
        shoes: both.
        bare_arms: short sleeves.
        bare_legs: below shorts or a skirt.
        skirt_to: height of its hem as a share of the body height, also of a long coat; None without.
        backpack: what it is made of; None without.
    """

    top: Surface
    bottom: Surface
    skin: Surface
    hair: Surface
    shoes: Surface
    bare_arms: bool
    bare_legs: bool
    skirt_to: float | None
    backpack: Surface | None


def drawn_clothes(rng: np.random.Generator) -> Clothes:
    """Clothes as they come along the street; the same draws in the same order for all people."""
    top, bottom = cloth(rng), cloth(rng)
    skin = Surface(albedo=float(rng.choice(SKINS)), contrast=0.10)
    hair = Surface(albedo=float(rng.choice(HAIRS)), contrast=0.35, texel_m=0.004)
    shoes = replace(LEATHER, albedo=float(rng.choice([0.05, 0.12, 0.60])))
    outfit = str(rng.choice(["trousers", "shorts", "skirt", "coat"], p=[0.55, 0.12, 0.13, 0.20]))
    backpack = replace(cloth(rng), contrast=0.25)
    with_backpack, bare_arms = bool(rng.random() < 0.25), bool(rng.random() < 0.35)
    return Clothes(
        top=top,
        bottom=bottom,
        skin=skin,
        hair=hair,
        shoes=shoes,
        bare_arms=bare_arms and outfit != "coat",
        bare_legs=outfit in {"shorts", "skirt"},
        skirt_to={"skirt": 0.30, "coat": 0.34}.get(outfit),
        backpack=backpack if with_backpack else None,
    )


def for_riding(clothes: Clothes) -> Clothes:
    """The same without what would get into the spokes."""
    return replace(clothes, skirt_to=None)
