"""What a protocol decides about the reference."""

from __future__ import annotations

from dataclasses import dataclass

from bench.reference.records import Category


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionSettings:
    """When an object counts as moving, and in which way.

    Attributes:
        static_below_mps: objects slower than this over the ground are static.
        hysteresis_low_mps: a moving object becomes static below this.
        hysteresis_high_mps: a static object becomes moving at or above this.
        min_run_ns: shorter runs of either state are taken as noise.
        smoothing_ns: width of the window over which velocities of a track are averaged.
        ego_static_below_mps: the host counts as standing below this.
        crossing_from_rad: angle between object velocity and ego direction of travel from which it is crossing.
        crossing_to_rad: angle above which it is approaching.
    """

    static_below_mps: float
    hysteresis_low_mps: float
    hysteresis_high_mps: float
    min_run_ns: int
    smoothing_ns: int
    ego_static_below_mps: float
    crossing_from_rad: float
    crossing_to_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceSettings:
    """How reference polygons are built and which objects are evaluated.

    Attributes:
        range_limit_m: objects whose nearest point is further from the camera are ignored.
        ground_clearance_m: points lower than this above the road are the road's, not an object's.
        min_points: objects with fewer visible lidar points are ignored.
        min_polygon_px: objects whose polygon has fewer pixels in V are ignored.
        polygon_kind: "convex" (the paper's bounding polygon), "concave" (a tighter hull of the points) or "footprint"
            (the union of the surface that each point stands for; see `bench.reference.patches`).
        concave_ratio: tightness of the concave hull, 0 the tightest, 1 the convex hull.
        classes: object classes that are evaluated.
        categories: kinds of motion that are evaluated.
        max_sweep_gap_ns: a sweep further from the exposure than this is not used.
        max_annotation_gap_ns: an annotation further from the exposure than this is not used.
        motion: thresholds on velocities.
    """

    range_limit_m: float
    ground_clearance_m: float
    min_points: int
    min_polygon_px: int
    polygon_kind: str
    concave_ratio: float
    classes: tuple[str, ...]
    categories: tuple[Category, ...]
    max_sweep_gap_ns: int
    max_annotation_gap_ns: int
    motion: MotionSettings
