"""Reviews of a few straight tracks, small enough to check by hand."""

from datetime import UTC, datetime

import numpy as np

from bench.annotation.store import BoxState, Doubt, Proposed, Review, StoredTrack, review_file, write_review
from bench.recordings import Cuboid

STEP_NS = 100_000_000
DRIVE = "crossing"  # of the tiny data set
MADE = {"made_at": datetime(2026, 11, 23, 15, tzinfo=UTC), "reviewer": "R."}


def straight(name, *, first=0, states=11, start=(0.0, 0.0), speed_mps=10.0, size_m=(4.0, 2.0, 1.5), **more):
    """A track along the world's x axis, a state every 0.1 s from state `first` on, 1 m higher than the ground."""
    return StoredTrack(
        id=name,
        source="proposed",
        object_class="vehicle",
        size_m=size_m,
        states=tuple(
            BoxState(
                timestamp_ns=i * STEP_NS,
                centre_m=(start[0] + speed_mps * i / 10, start[1], 1.0),
                yaw_rad=0.0,
                velocity_mps=(speed_mps, 0.0),
            )
            for i in range(first, first + states)
        ),
        **more,
    )


def review_of(*tracks, data="d", code="c"):
    return Review(dataset="street", recording="drive", proposed=Proposed(data=data, code=code), tracks=tracks)


def proposed_from(recording):
    """What a perfect proposer would find: the true tracks, in the world."""
    found = []
    for number, track in enumerate(recording.tracks):
        boxes = [state for state in track.states if isinstance(state.shape, Cuboid)]
        states = []
        for state in boxes:
            world = recording.trajectory.world_from_vehicle(state.timestamp_ns)
            pose = world @ state.shape.vehicle_from_object
            velocity = world.rotation @ state.velocity_mps
            states.append(
                BoxState(
                    timestamp_ns=state.timestamp_ns,
                    centre_m=tuple(pose.translation_m.tolist()),
                    yaw_rad=float(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])),
                    velocity_mps=tuple(velocity[:2].tolist()),
                )
            )
        found.append(
            StoredTrack(
                id=f"p{number:03d}",
                source="proposed",
                object_class=track.object_class,
                size_m=tuple(boxes[0].shape.size_m.tolist()),
                doubts=(Doubt(reason="few returns", value=6.0, weight=0.5),) if number % 2 else (),
                points_median=100.0,
                states=tuple(states),
            )
        )
    return Review(
        dataset="street", recording=recording.name, proposed=Proposed(data="d", code="c"), tracks=tuple(found)
    )


def stored(card, review):
    file = review_file(card.parent / "annotations", DRIVE)
    write_review(file, review)
    return file
