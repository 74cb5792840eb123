"""Whether two layers tell the same."""

import numpy as np
import pytest

from bench.recordings import Cuboid


def assert_same_boxes(found, expected, *, names: bool = True, within: float = 1e-9):
    """Same objects, times, places, sizes and headings; velocities and the rest are compared elsewhere."""
    assert [track.object_class for track in found] == [track.object_class for track in expected]
    if names:
        assert [track.track_id for track in found] == [track.track_id for track in expected]
    for one, other in zip(found, expected, strict=True):
        assert [state.timestamp_ns for state in one.states] == [state.timestamp_ns for state in other.states]
        for state, true in zip(one.states, other.states, strict=True):
            assert isinstance(state.shape, Cuboid)
            matrix = true.shape.vehicle_from_object.matrix
            assert state.shape.vehicle_from_object.matrix == pytest.approx(matrix, abs=within)
            assert state.shape.size_m == pytest.approx(np.asarray(true.shape.size_m), abs=within)
