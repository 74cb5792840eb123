"""Tables of boxes: as a few lines of pandas make them, in every frame, and what is no such table."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bench.annotation.formats.conversion import LabelOptions, import_labels
from bench.annotation.formats.table import REQUIRED, VELOCITY, BoxTable
from bench.errors import DataError
from bench.geometry import RigidTransform
from tests.annotation.formats import street
from tests.annotation.formats.street import assert_same_boxes

PLAIN = LabelOptions()


def frame_from_vehicle_at(frame, drive, time_ns):
    if frame == "world":
        return drive.trajectory.world_from_vehicle(time_ns)
    return drive.vehicle_from_lidar.inverse() if frame == "lidar" else RigidTransform.identity()


def table(drive, *, frame="vehicle", velocities=False):
    """The street's boxes as rows; of a frame that leans the yaw is that of the box's x axis."""
    rows = []
    for track in street.box_tracks():
        for state in track.states:
            frame_from_vehicle = frame_from_vehicle_at(frame, drive, state.timestamp_ns)
            box = frame_from_vehicle @ state.shape.vehicle_from_object
            yaw = np.arctan2(box.rotation[1, 0], box.rotation[0, 0])
            words = [state.timestamp_ns, track.track_id, track.object_class, frame]
            velocity = frame_from_vehicle.rotate(state.velocity_mps) if velocities else []
            rows.append([*words, *box.translation_m, *state.shape.size_m, yaw, *velocity])
    return pd.DataFrame(rows, columns=[*REQUIRED, *(VELOCITY if velocities else [])])


def put(tmp_path, rows, name="boxes.csv"):
    file = tmp_path / name
    rows.to_parquet(file) if name.endswith(".parquet") else rows.to_csv(file, index=False)
    return file


@pytest.mark.parametrize("name", ["boxes.csv", "boxes.parquet"])
@pytest.mark.parametrize("frame", ["vehicle", "lidar", "world"])
def test_boxes_of_every_frame_are_where_they_were(tmp_path, drive, name, frame):
    file = put(tmp_path, table(drive, frame=frame, velocities=True), name)
    found = import_labels("boxes", file, drive, PLAIN)
    expected = street.box_tracks()
    if frame != "lidar":  # the street's lidar leans
        assert_same_boxes(found.tracks, expected)
    for track, true in zip(found.tracks, expected, strict=True):
        for state, other in zip(track.states, true.states, strict=True):
            places = [s.shape.vehicle_from_object.translation_m for s in (state, other)]
            assert places[0] == pytest.approx(places[1], abs=1e-9)
            assert state.velocity_mps == pytest.approx(other.velocity_mps, abs=1e-9)


def test_numbers_as_names_and_times_with_all_their_digits(tmp_path, drive):
    rows = table(drive).assign(track=lambda t: t["track"].map({"car": 7, "walker": 8, "parked": 9}))
    for name in ("boxes.csv", "boxes.parquet"):
        found = import_labels("boxes", put(tmp_path, rows, name), drive, PLAIN)
        assert {track.track_id for track in found.tracks} == {"7", "8", "9"}
        assert found.timestamps_ns == street.TIMES_NS


def test_other_names_of_frames_and_further_columns_are_told(tmp_path, drive):
    file = put(tmp_path, table(drive).assign(frame="base_link", score=0.5))
    told = "row 0.frame: expected one of vehicle, lidar, world, got 'base_link'; say with"
    with pytest.raises(DataError, match=told):
        import_labels("boxes", file, drive, PLAIN)
    found = import_labels("boxes", file, drive, LabelOptions(frames={"base_link": "vehicle"}))
    assert_same_boxes(found.tracks, street.box_tracks())
    walker = street.box_track("walker").states[0]
    assert found.tracks[1].states[0].velocity_mps == pytest.approx(walker.velocity_mps, abs=1e-6)  # from its places
    assert "column 'score': no field for it" in found.lost
    unnamed = put(tmp_path, table(drive).assign(frame=""))
    found = import_labels("boxes", unnamed, drive, LabelOptions(frames={"": "vehicle"}))
    assert_same_boxes(found.tracks, street.box_tracks())


def test_what_the_table_cannot_hold_is_told(drive):
    car, walker = street.full_tracks()
    leaning = RigidTransform(street.about_axes(0.0, 0.1, 0.0)[1], np.zeros(3))
    first, second, *others = car.states
    second = replace(second, shape=replace(second.shape, vehicle_from_object=leaning))
    _, lost = BoxTable().write(replace(drive, tracks=(replace(car, states=(first, second, *others)), walker)))
    assert lost == [
        "ground outlines: no field for them (1)",
        "places that are given by points: no field for them (1)",
        "yaw rates: no field for them (6)",
        "kinds of motion (category): no field for them (1)",
        "marks of unclear objects: no field for them (1)",
        "numbers in truth images (instance_id): no field for them (1)",
        "boxes that lean against the vehicle: written upright (1)",
    ]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"x_m": "abc"}, r"row 0\.x_m: expected a number, got 'abc'"),
        ({"x_m": np.inf}, r"row 0\.x_m: expected a number"),
        ({"z_m": np.nan}, r"row 0\.z_m: expected a number"),
        ({"y_m": 1e300}, r"row 0\.y_m: expected a number"),
        ({"length_m": 0.0}, r"row 0: expected sizes above 0"),
        ({"yaw_rad": None}, r"row 0\.yaw_rad: expected a number"),
        ({"timestamp_ns": 5}, r"timestamp_ns: expected times of the recording"),
        ({"timestamp_ns": "noon"}, r"row 0\.timestamp_ns: expected whole nanoseconds, got 'noon'"),
        ({"timestamp_ns": None}, r"row 0\.timestamp_ns: expected whole nanoseconds"),
        ({"class": None}, r"got ''"),
        ({"frame": None}, r"row 0\.frame: expected one of vehicle, lidar, world, got none"),
    ],
)
@pytest.mark.parametrize("name", ["boxes.csv", "boxes.parquet"])
def test_every_fault_has_its_place(tmp_path, drive, change, told, name):
    file = put(tmp_path, table(drive).assign(**change), name)
    with pytest.raises(DataError, match=told) as raised:
        import_labels("boxes", file, drive, PLAIN)
    assert "\n" not in str(raised.value)


def test_missing_columns_are_named(tmp_path, drive):
    with pytest.raises(DataError, match=r"columns: expected columns timestamp_ns, .*, got none for track, yaw_rad"):
        import_labels("boxes", put(tmp_path, table(drive).drop(columns=["track", "yaw_rad"])), drive, PLAIN)
