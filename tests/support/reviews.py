"""Reviews of a few straight tracks, small enough to check by hand."""

from datetime import UTC, datetime

from bench.annotation.store import BoxState, Proposed, Review, StoredTrack

STEP_NS = 100_000_000
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
