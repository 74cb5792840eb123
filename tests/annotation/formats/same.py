"""Whether two label sets say the same, and files of one."""

import numpy as np
import pytest

from bench.annotation.formats import LabelOptions
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


def written(format_, label_set, recording, folder, options=None):
    """Write a label set into a folder; what the format cannot hold."""
    files, lost = format_.write(label_set, recording, options or LabelOptions())
    for name, content in files.items():
        folder.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return lost
