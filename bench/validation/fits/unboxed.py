"""Returns that move without an annotated box: what the drive itself shows to be missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.errors import DataError
from bench.recordings import NOT_ANNOTATED, Recording
from bench.times import SECOND_NS
from bench.validation.drive import box_of
from bench.validation.findings import Finding, new_finding

if TYPE_CHECKING:
    from bench.annotation.proposals import Proposal


@dataclass(frozen=True, slots=True, kw_only=True)
class Unboxed:
    """Limits from which proposals count as objects that lack a box.

    Attributes:
        sweeps: that are looked at, in the middle of the drive: 0.1 s each.
        near_m: of the object to the vehicle's origin; proposals further away are less sure.
        least_mps: of its median speed; a tree in the wind is slower.
        least_sweeps: in which it moves without a box.
        state_ns: of an annotated state to a sweep.
        around_m: a box so far from the object is its own, if misplaced.
    """

    sweeps: int = 40
    near_m: float = 15.0
    least_mps: float = 1.0
    least_sweeps: int = 8
    state_ns: int = 300_000_000
    around_m: float = 1.0


UNBOXED = Unboxed()
HARMLESS = {"fragments joined", "seen from one end", "top not seen"}  # doubts about a box, not its being there


def check_unboxed(recording: Recording) -> Iterator[Finding]:
    """Objects that surely move and have no box in most sweeps."""
    if recording.annotated == NOT_ANNOTATED or not recording.sweeps:
        return
    from bench.annotation.proposals import propose  # compiled loops: most of a second, which other commands need not

    first = max((len(recording.sweeps) - UNBOXED.sweeps) // 2, 0)
    proposals: tuple[Proposal, ...] = ()
    with suppress(DataError):  # reported by the check of the sweeps
        proposals = propose(replace(recording, sweeps=recording.sweeps[first : first + UNBOXED.sweeps]))
    unboxed = []
    for proposal in proposals:
        rows = _moving_near(proposal, recording)
        without = rows[[not _has_box(proposal, int(row), recording) for row in rows]]
        sure = all(reason in HARMLESS for reason, _ in proposal.doubts)
        if sure and len(without) > max(UNBOXED.least_sweeps - 1, len(rows) / 2):
            unboxed.append((proposal, without))
    if unboxed:
        proposal, without = max(unboxed, key=lambda entry: len(entry[1]))
        more = f"; {len(unboxed) - 1} more objects like that" if len(unboxed) > 1 else ""
        got, first_ns = _described(proposal, without, recording) + more, int(proposal.timestamps_ns[without[0]])
        yield new_finding("object-without-box", got, field="objects", times=len(unboxed), timestamp_ns=first_ns)


def _described(proposal: Proposal, without: NDArray[np.intp], recording: Recording) -> str:
    x, y, _ = _place_vehicle(proposal, int(without[len(without) // 2]), recording)
    speed_mps = float(np.median(np.hypot(*proposal.velocity_mps[without].T)))
    length_m, width_m, _ = proposal.size_m
    place = f"{abs(x):.0f} m {'ahead' if x > 0 else 'behind'}, {abs(y):.0f} m to the {'left' if y > 0 else 'right'}"
    size = f"{length_m:.1f} m x {width_m:.1f} m of returns that move at {speed_mps:.1f} m/s"
    return f"{size} without a box in {len(without)} sweeps ({place})"


def _moving_near(proposal: Proposal, recording: Recording) -> NDArray[np.intp]:
    """Indices of the proposal's states at which it moves nearby, when and where the recording is annotated."""
    left_out = shapely.union_all([shapely.Polygon(outline) for outline in recording.annotated.left_out_m])
    rows = [
        row
        for row, time_ns in enumerate(proposal.timestamps_ns)
        if np.hypot(*proposal.velocity_mps[row]) > UNBOXED.least_mps
        and recording.annotated.covers(int(time_ns))
        and np.hypot(*(place_m := _place_vehicle(proposal, row, recording))[:2]) < UNBOXED.near_m
        and not left_out.intersects(shapely.Point(place_m[:2]))
    ]
    return np.array(rows, dtype=np.intp)


def _has_box(proposal: Proposal, row: int, recording: Recording) -> bool:
    """The middle of the object is in or near an annotated box, seen from above, moved to the time of the sweep."""
    time_ns = int(proposal.timestamps_ns[row])
    for track in recording.tracks:
        state = track.state_near(time_ns, within_ns=UNBOXED.state_ns)
        if state is None:
            continue
        box = box_of(state.shape)
        if box is None:
            return True  # point indices: which object has them is not looked at
        moved_m = proposal.velocity_mps[row] * (time_ns - state.timestamp_ns) / SECOND_NS
        then_m = proposal.centres_m[row] - np.append(moved_m, 0.0)
        world_from_vehicle = recording.trajectory.world_from_vehicle(state.timestamp_ns)
        local = (world_from_vehicle @ box.vehicle_from_object).inverse().apply(then_m)
        if (np.abs(local[:2]) < np.maximum(box.size_m, proposal.size_m.min())[:2] / 2 + UNBOXED.around_m).all():
            return True
    return False


def _place_vehicle(proposal: Proposal, row: int, recording: Recording) -> NDArray[np.float64]:
    world_from_vehicle = recording.trajectory.world_from_vehicle(int(proposal.timestamps_ns[row]))
    return world_from_vehicle.inverse().apply(proposal.centres_m[row])
