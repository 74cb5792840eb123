"""A body, its materials, its joints and its postures.

Object frame: x forward, y left, z up, origin on the ground below the middle of the box around the body.

A joint holds its angles over one cycle as a table over the distance travelled. Parts are built in the build posture, in
which every angle is 0; a joint rotates its parts, and all joints below it, about an axis through its pivot.

Albedos are everyday ones: white paint and paper 0.7 to 0.85, grey paint 0.3 to 0.5, dark cloth and rubber 0.03 to 0.1.
Glass and clear coats mirror 4 % of the light that falls on them squarely (Fresnel, refractive index 1.5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.mesh import Mesh, Surface, joined

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
    """Return clothes without what would get into the spokes."""
    return replace(clothes, skirt_to=None)


STEPS = 96  # of a cycle in a table; linear in between


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Joint:
    """A rotation about an axis, driven by the distance that the body has travelled.

    Attributes:
        name: parts and joints hang on it by this name.
        pivot_m: (3,) a point on the axis, object frame, build posture.
        cycle_m: distance of one full cycle.
        angles_rad: (STEPS + 1,) over one cycle, right-handed about the axis; the last may be whole turns off the first.
        axis: (3,) unit vector, build posture.
        parent: the joint that this one hangs on; None for the body's own frame.
        shifts_m: (STEPS + 1, 3) or None: how the joint moves in its parent's axes, over the same cycle.
        stationary_rad: its angle when the body does not go; None where that makes no difference, as for wheels.
        stationary_shift_m: (3,) its shift then.
    """

    name: str
    pivot_m: tuple[float, float, float]
    cycle_m: float
    angles_rad: NDArray[np.float64]
    axis: tuple[float, float, float] = (0.0, 1.0, 0.0)
    parent: str | None = None
    shifts_m: NDArray[np.float64] | None = None
    stationary_rad: float | None = None
    stationary_shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


def wheel(name: str, x_m: float, radius_m: float) -> Joint:
    """A wheel on the road: it turns once while the body goes its circumference."""
    turn = np.linspace(0, 2 * np.pi, STEPS + 1)
    return Joint(name=name, pivot_m=(x_m, 0.0, radius_m), cycle_m=2 * np.pi * radius_m, angles_rad=turn)


def still(value: float = 0.0) -> NDArray[np.float64]:
    """The table of an angle that does not change."""
    return np.full(STEPS + 1, value)


class Linkage:
    """All joints of a body, stacked for speed.

    Args:
        joints: parents before their children.
        parts: (first triangle, last triangle + 1, row of the joint) of the parts on joints, in order.
    """

    def __init__(self, joints: Sequence[Joint], parts: tuple[tuple[int, int, int], ...] = ()) -> None:
        self.parts = parts
        names = [joint.name for joint in joints]
        self.joints = tuple(joints)
        self.parents = tuple(-1 if joint.parent is None else names.index(joint.parent) for joint in joints)
        assert all(parent < row for row, parent in enumerate(self.parents))
        self._pivots_m = np.array([joint.pivot_m for joint in joints], dtype=np.float64).reshape(-1, 3)
        self._cycles_m = np.array([joint.cycle_m for joint in joints])
        self._crosses = _cross_matrices(np.array([joint.axis for joint in joints], dtype=np.float64).reshape(-1, 3))
        self._tables = np.array([_table(joint) for joint in joints]).reshape(-1, STEPS + 1, 4)
        self._stationary = np.array([_stationary(joint) for joint in joints]).reshape(-1, 4)

    def transforms(
        self, distances_m: float | NDArray[np.float64], amplitude: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Posed from build posture.

        Args:
            distances_m: travelled so far: one distance, or (W,).
            amplitude: 1 in full motion, 0 stationary.

        Returns:
            rotations: (J, 3, 3), or (W, J, 3, 3).
            translations_m: (J, 3), or (W, J, 3): a point of joint j goes to `rotations[j] @ point + translations_m[j]`.
        """
        phase = np.asarray(distances_m)[..., None] / self._cycles_m
        phase = (phase - np.floor(phase)) * STEPS
        step = np.minimum(phase.astype(np.intp), STEPS - 1)
        rows = np.arange(len(self._cycles_m))
        low, high = self._tables[rows, step], self._tables[rows, step + 1]
        values = low + (phase - step)[..., None] * (high - low)
        values = np.where(
            np.isnan(self._stationary), values, self._stationary + amplitude * (values - self._stationary)
        )
        rotations = self._rotations(values[..., 0])
        positions_m = self._pivots_m + values[..., 1:]
        for row, parent in enumerate(self.parents):
            if parent >= 0:
                arms_m = positions_m[..., row, :] - self._pivots_m[parent]
                turned_m = (rotations[..., parent, :, :] @ arms_m[..., None])[..., 0]
                positions_m[..., row, :] = positions_m[..., parent, :] + turned_m
                rotations[..., row, :, :] = rotations[..., parent, :, :] @ rotations[..., row, :, :]
        return rotations, positions_m - (rotations @ self._pivots_m[..., None])[..., 0]

    def posture(self, corners_m: NDArray[np.float64], distance_m: float, amplitude: float) -> NDArray[np.float64]:
        """Corners (T, 3, 3) of the build posture, in the posture after a distance."""
        posed = corners_m.copy()
        if self.parts:
            rotations, translations_m = self.transforms(distance_m, amplitude)
            for start, end, row in self.parts:
                flat = corners_m[start:end].reshape(-1, 3)
                posed[start:end] = (flat @ rotations[row].T + translations_m[row]).reshape(-1, 3, 3)
        return posed

    def extent(
        self, corners_m: NDArray[np.float64], *, cycle_m: float, start_m: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest x, y, z over all postures of a cycle and the stationary one."""
        first = self.parts[0][0] if self.parts else len(corners_m)  # parts on no joint come first
        still_m = corners_m[:first].reshape(-1, 3)
        lows, highs = ([still_m.min(axis=0)], [still_m.max(axis=0)]) if first else ([], [])
        if self.parts:
            moving = self.transforms(np.arange(STEPS, dtype=np.float64) * (cycle_m / STEPS), 1.0)
            stationary = self.transforms(np.array([start_m]), 0.0)
            rotations, translations_m = (np.concatenate(both) for both in zip(moving, stationary, strict=True))
            for start, end, row in self.parts:
                axes = rotations[:, row].reshape(-1, 3)  # every axis of every posture
                along_m = (axes @ _distinct(corners_m[start:end].reshape(-1, 3)).T).reshape(len(rotations), 3, -1)
                lows.append((along_m.min(axis=2) + translations_m[:, row]).min(axis=0))
                highs.append((along_m.max(axis=2) + translations_m[:, row]).max(axis=0))
        return np.min(lows, axis=0), np.max(highs, axis=0)

    def _rotations(self, angles_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rodrigues' formula for (..., J) angles about the axes: (..., J, 3, 3)."""
        sine, cosine = np.sin(angles_rad)[..., None, None], np.cos(angles_rad)[..., None, None]
        return np.asarray(np.eye(3) + sine * self._crosses + (1 - cosine) * (self._crosses @ self._crosses))


def _table(joint: Joint) -> NDArray[np.float64]:
    shifts = np.zeros((STEPS + 1, 3)) if joint.shifts_m is None else joint.shifts_m
    return np.column_stack([joint.angles_rad, shifts])


def _stationary(joint: Joint) -> NDArray[np.float64]:
    if joint.stationary_rad is None:
        return np.full(4, np.nan)
    return np.array([joint.stationary_rad, *joint.stationary_shift_m])


def _cross_matrices(axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(J, 3, 3): the vector product with each of (J, 3) axes."""
    x, y, z = axes.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)


FULL_PACE_MPS = 0.5  # below this speed steps grow smaller, down to none


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Body:
    """A body in its object frame.

    Attributes:
        object_class: as annotations name it.
        mesh: all parts in the build posture, as it is for a vehicle; its texture serves every posture.
        linkage: the joints, and the parts on them.
        cycle_m: distance after which walking repeats.
        start_m: where in its cycle the body is at distance 0, so that two of them do not walk in step.
        size_m: (3,) float64, the box that holds every posture: length, width, height.
    """

    object_class: str
    mesh: Mesh
    linkage: Linkage
    cycle_m: float
    start_m: float
    size_m: NDArray[np.float64]

    def corners_at(self, distance_m: float, *, speed_mps: float = FULL_PACE_MPS) -> NDArray[np.float64]:
        """The posture after a distance.

        Args:
            distance_m: travelled so far, negative in reverse.
            speed_mps: at 0 the body stands on both feet; steps are full from `FULL_PACE_MPS` on.

        Returns:
            (T, 3, 3) float64, m, object frame.
        """
        amplitude = min(abs(speed_mps) / FULL_PACE_MPS, 1.0)
        posed = self.linkage.posture(self.mesh.corners_m, self.start_m + distance_m, amplitude)
        if 0.0 < amplitude < 1.0:  # half a step: straighter legs than either foot was placed for
            posed[..., 2] -= min(float(posed[..., 2].min()), 0.0)
        return posed


JointedMesh = tuple[Mesh, str | None]  # a solid in the build posture, and the joint that it hangs on
Built = tuple[
    list[JointedMesh], list[Joint], float
]  # parts, joints, and the distance after which their postures repeat


def assemble_body(
    object_class: str, parts: Sequence[JointedMesh], joints: Sequence[Joint], *, cycle_m: float, start_m: float
) -> Body:
    """Put parts together and centre them.

    Args:
        object_class: as annotations name it.
        parts: in any frame whose x is forward and whose z is up from the ground.
        joints: in the same frame, parents before their children.
        cycle_m: distance after which every posture repeats.
        start_m: where in its cycle the body starts.
    """
    rows = {joint.name: row for row, joint in enumerate(joints)}
    sorted_parts = sorted(parts, key=lambda part: -1 if part[1] is None else rows[part[1]])
    hangs_on = np.concatenate([np.full(len(m.corners_m), -1 if n is None else rows[n]) for m, n in sorted_parts])
    jointed = tuple(
        (int(np.searchsorted(hangs_on, row)), int(np.searchsorted(hangs_on, row, side="right")), row)
        for row in range(len(joints))
        if (hangs_on == row).any()
    )
    mesh = joined(*(mesh for mesh, _ in sorted_parts))
    low, high = Linkage(joints, jointed).extent(mesh.corners_m, cycle_m=cycle_m, start_m=start_m)
    origin = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, 0.0])
    return Body(
        object_class=object_class,
        mesh=replace(mesh, corners_m=mesh.corners_m - origin),
        linkage=Linkage([replace(joint, pivot_m=tuple(joint.pivot_m - origin)) for joint in joints], jointed),
        cycle_m=cycle_m,
        start_m=start_m,
        size_m=np.array([high[0] - low[0], high[1] - low[1], high[2]]),
    )


def _distinct(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Each point (N, 3) once; triangles that share nothing repeat a corner some six times."""
    ordered = points_m[np.lexsort(points_m.T)]
    return np.asarray(ordered[np.append(True, (ordered[1:] != ordered[:-1]).any(axis=1))])
