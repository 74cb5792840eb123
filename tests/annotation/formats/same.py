"""Whether two label sets say the same, and files of one."""

from dataclasses import replace

import pytest

from bench.recordings import Cuboid


def assert_same_boxes(found, expected, *, within=1e-9):
    """Same objects, times, places, sizes and headings; velocities and the rest are compared elsewhere."""
    told = [
        [(track.track_id, track.object_class, [state.timestamp_ns for state in track.states]) for track in tracks]
        for tracks in (found, expected)
    ]
    assert told[0] == told[1]
    for one, other in zip(found, expected, strict=True):
        for state, true in zip(one.states, other.states, strict=True):
            assert isinstance(state.shape, Cuboid)
            matrix = true.shape.vehicle_from_object.matrix
            assert state.shape.vehicle_from_object.matrix == pytest.approx(matrix, abs=within)
            assert state.shape.size_m == pytest.approx(true.shape.size_m, abs=within)


def written(format_, tracks, recording, folder):
    """Write tracks into a folder; what the format cannot hold."""
    files, lost = format_.write(replace(recording, tracks=tuple(tracks)))
    for name, content in files.items():
        folder.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return lost
