"""Constants of the proposals, each with its meaning and unit."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

from bench.evaluation.protocol import load_protocol
from bench.records.rules import MotionSettings

MOTION = load_protocol("paper-v1").reference.motion


@dataclass(frozen=True, slots=True, kw_only=True)
class ProposalSettings:
    """Settings of the search for moving objects; values were chosen on the demo and 50 sweeps of a real lidar.

    Attributes:
        nearest_m: returns nearer to the lidar are its own vehicle's.
        range_m: returns further from the lidar are left out.
        top_m: and those higher above the road.
        own_margin_m: around the vehicle's outline, in which returns are its own.
        own_top_m: height of the vehicle.
        own_range_m: what keeps its place this near to the lidar is the vehicle's own: mirrors, a roof rack,
        own_sway_m: by no more than this,
        own_way_m: while the vehicle drives as far.
        cell_m: of the grid of ground heights.
        ground_m: returns lower above the ground are the ground's.
        voxel_m: returns in one voxel are looked up once in other sweeps.
        window_s: sweeps this far before and after are witnesses.
        witnesses: most of them for a sweep.
        azimuth_rad: width of a cell of a range image.
        elevation_rad: height of a cell.
        lowest_rad: elevation of the lowest cell; beams below it are no witnesses.
        highest_rad: of the highest.
        sector_edge_rad: points this near to the edge of the lidar's sector may be cut off.
        beam_edge_rad: points this near to the highest beam may be cut off.
        beyond_m: a beam that went this much further saw through a point,
        beyond_share: and this share of the range.
        least_through: sweeps that see through a seed.
        through_share: of those that see through a seed or meet it.
        neighbour_m: distance of neighbours in a cluster.
        seed_share: of a component, from which on all of it is one object.
        slow_share: likewise, from which on it may be one.
        longest_m: of an object seen from above; the longest vehicles on the road with a joint have 18.75 m.
        widest_m: likewise.
        acceleration_mps2: standard deviation, of the filter.
        missed: sweeps without a cluster after which a track ends.
        segment_s: tracks are looked at together, and their sweeps forgotten, after this long.
        fit_s: a velocity is the slope of positions within this time.
        shifts: sweeps between two that are registered.
        motion: when a track moves and when it rests.
        least_speed_mps: median of a track while it moves.
        least_sweeps: of a track.
        seen_share: of the sweeps between its first and last in which a track is seen.
        least_move_m: between the first and last place.
        straight: share of its path that the two are apart.
        object_through: share of a track's points that `least_through` sweeps see through.
        least_top_m: height of an object above the ground.
        found_share: of the points found again where the motion predicts them.
        gain_share: more points agree with the motion than with rest,
        sure_share: and so many more where fewer than `object_through` were seen through,
        slow_lengths: as those of what goes no further than so many times its length in `window_s`.
        found_m: distance within which a point is found again.
        margin_m: between the outermost points and the box.
        extend_s: a moving track is carried on for this long at most.
        rest_s: and one that rests at its end for this long.
        held_share: of a track's points that its box must hold where it is carried on.
        joined_m: longest and widest vehicle that fragments are joined to.
        joined_mps: fragments of one object differ less in velocity.
        few_points: a track with fewer returns in most sweeps is in doubt.
        short_s: and one that moves for a shorter time.
        edge_m: and one within this distance of `range_m`.
        few_through: and one of whose points a smaller share was seen through.
    """

    nearest_m: float = 0.5
    range_m: float = 26.0
    top_m: float = 3.6
    own_margin_m: float = 0.25
    own_top_m: float = 2.2
    own_range_m: float = 3.0
    own_sway_m: float = 0.15
    own_way_m: float = 1.0
    cell_m: float = 0.5
    ground_m: float = 0.20
    voxel_m: float = 0.10
    window_s: float = 2.5
    witnesses: int = 24
    azimuth_rad: float = radians(0.4)
    elevation_rad: float = radians(0.5)
    lowest_rad: float = radians(-35.0)
    highest_rad: float = radians(25.0)
    sector_edge_rad: float = radians(1.5)
    beam_edge_rad: float = radians(0.4)
    beyond_m: float = 0.30
    beyond_share: float = 0.02
    least_through: int = 3
    through_share: float = 0.30
    neighbour_m: float = 0.40
    seed_share: float = 0.20
    slow_share: float = 0.05
    longest_m: float = 18.75
    widest_m: float = 3.2
    acceleration_mps2: float = 4.0
    missed: int = 4
    segment_s: float = 30.0
    fit_s: float = 0.9
    shifts: tuple[int, ...] = (1, 3, 5)
    motion: MotionSettings = MOTION
    least_speed_mps: float = 0.35
    least_sweeps: int = 4
    seen_share: float = 0.55
    least_move_m: float = 0.45
    straight: float = 0.6
    object_through: float = 0.45
    least_top_m: float = 0.60
    found_share: float = 0.5
    gain_share: float = 0.25
    sure_share: float = 0.5
    slow_lengths: float = 3.0
    found_m: float = 0.25
    margin_m: float = 0.08
    extend_s: float = 0.5
    rest_s: float = 5.0
    held_share: float = 0.5
    joined_m: tuple[float, float] = (7.0, 2.9)
    joined_mps: float = 0.35
    few_points: int = 15
    short_s: float = 0.8
    edge_m: float = 4.0
    few_through: float = 0.6
