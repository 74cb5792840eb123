"""Reviews of a few straight tracks, small enough to check by hand."""

from datetime import UTC, datetime

import numpy as np

from bench.annotation.decisions import applied
from bench.annotation.store import Doubt, Judge, Proposed, Review, StoredTrack, box_states, review_file, write_review
from bench.recordings import Cuboid

STEP_NS = 100_000_000
DRIVE = "crossing"  # of the tiny data set
MADE = {"made_at": datetime(2026, 11, 23, 15, tzinfo=UTC), "reviewer": "R."}


def straight(name, *, first=0, states=11, start=(0.0, 0.0), speed_mps=10.0, size_m=(4.0, 2.0, 1.5), **more):
    """A track along the world's x axis, a state every 0.1 s from state `first` on, 1 m higher than the ground."""
    numbers = np.arange(first, first + states)
    centres_m = np.column_stack([start[0] + speed_mps * numbers / 10, np.tile([start[1], 1.0], (states, 1))])
    boxes = box_states(numbers * STEP_NS, centres_m, np.zeros(states), np.tile([speed_mps, 0.0], (states, 1)))
    told = {"id": name, "object_class": "vehicle", "size_m": size_m, "states": boxes}
    return StoredTrack(**told | more)


def review_of(*tracks, data="d", code="c"):
    return Review(dataset="street", recording="drive", proposed=Proposed(data=data, code=code), tracks=tracks)


def proposed_from(recording):
    """What a perfect proposer would find: the true tracks, in the world; every second is in doubt."""
    tracks = []
    for number, track in enumerate(recording.tracks):
        boxes = [state for state in track.states if isinstance(state.shape, Cuboid)]
        times_ns = np.array([state.timestamp_ns for state in boxes])
        worlds = [recording.trajectory.world_from_vehicle(time_ns) for time_ns in times_ns.tolist()]
        poses = [world @ state.shape.vehicle_from_object for world, state in zip(worlds, boxes, strict=True)]
        velocities = [world.rotate(state.velocity_mps)[:2] for world, state in zip(worlds, boxes, strict=True)]
        yaws_rad = np.array([np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0]) for pose in poses])
        centres_m = np.array([pose.translation_m for pose in poses])
        tracks.append(
            StoredTrack(
                id=f"p{number:03d}",
                object_class=track.object_class,
                size_m=tuple(boxes[0].shape.size_m.tolist()),
                doubts=(Doubt(reason="few returns", value=6.0),) if number % 2 else (),
                points_median=100.0,
                states=box_states(times_ns, centres_m, yaws_rad, np.array(velocities)),
            )
        )
    return review_of(*tracks).model_copy(update={"recording": recording.name})


def decided(review, *decisions):
    """The review with more decisions, which can be carried out."""
    review = review.model_copy(update={"decisions": (*review.decisions, *decisions)})
    applied(review)
    return review


def judge(action, *names):
    return Judge(**MADE, action=action, tracks=names)


def stored(card, review):
    file = review_file(card.parent / "annotations", DRIVE)
    write_review(file, review)
    return file
