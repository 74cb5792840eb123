"""Each unit that people mistake is really written into a copy of a clean recording: file, field and factor are told."""

import re
from dataclasses import replace
from functools import reduce
from operator import getitem

import numpy as np
import pytest

from bench.recordings.native import open_native
from bench.times import other_unit
from bench.validation import report
from bench.validation.findings import Finding, Severity, causes
from bench.validation.quick import motion
from bench.validation.quick.motion import check_motion
from tests.support import drive
from tests.support.drive import with_points
from tests.support.planting import (
    change_boxes,
    change_bus,
    change_head,
    change_json,
    change_sweeps,
    retime,
    sweep_files,
)
from tests.validation.checking import found

SLOW = pytest.mark.slow
TIMES = {"microseconds": 10**3, "milliseconds": 10**6, "seconds": 10**9}
LENGTHS = {"centimetres": 100, "millimetres": 1000}


def file_times(folder):
    return lambda root, factor: retime(root / folder, lambda time_ns: time_ns // factor)


def bus_times(root, factor):
    change_bus(root, lambda row: row.update(timestamp_ns=str(int(row["timestamp_ns"]) // factor)))


def annotated_times(root, factor):
    def change(content):
        for frame in content["openlabel"]["frames"].values():
            frame["frame_properties"]["timestamp"] //= factor

    change_json(root / "annotations.json", change)


def cause(root, *, returns=False):
    """The first finding; all that may follow from it comes later, as warnings."""
    first, *others = found(root, returns=returns)
    assert first.severity is Severity.ERROR
    assert {one.severity for one in others} <= {Severity.WARNING}, others
    return first


@pytest.mark.parametrize(
    ("known_by", "following", "name"),
    [
        ("time-unit", ("image-clock", "tight-boxes"), "the unit of times"),  # of the points
        ("lidar-pose", ("road-height", "camera-flow"), "the lidar's mounting"),
    ],
)
def test_what_a_wrong_sweep_leads_to_comes_after_its_cause(known_by, following, name):
    checks = (*following, known_by)
    first, *others = report._ordered([Finding(check=check, expected="", got="") for check in checks], "drive")
    assert (first.check, first.severity) == (known_by, Severity.ERROR)
    assert {(one.severity, one.hint) for one in others} == {
        (Severity.WARNING, f"may follow from {name}: correct that, validate again")
    }


@pytest.mark.parametrize("unit", TIMES)
@pytest.mark.parametrize(
    ("change", "file", "field"),
    [
        (file_times("images/front"), "images/front", "names of the images of front"),
        (file_times("lidar"), "lidar", "names of the sweeps"),
        (bus_times, "egomotion.csv", "time"),
        (annotated_times, "annotations.json", "timestamp"),
    ],
)
def test_times(root, unit, change, file, field):
    change(root, TIMES[unit])
    told = cause(root)
    assert told.file == str(root / file)
    assert field in told.field
    assert unit in f"{told.got} {told.hint}"
    assert told.hint.endswith(f"multiply them by {TIMES[unit]}")


def scale_boxes(root, *, places=1, sizes=1):
    def change(_name, _number, data):
        values = data["cuboid"][0]["val"]
        data["cuboid"][0]["val"] = [*(places * v for v in values[:3]), *values[3:7], *(sizes * v for v in values[7:])]

    change_boxes(root, change)


def scale_head(*keys):
    def change(root, factor):
        def scale(head):
            part = reduce(getitem, keys[:-1], head)
            part[keys[-1]] = (np.array(part[keys[-1]]) * factor).tolist()

        change_head(root, scale)

    return change


@pytest.mark.parametrize("unit", LENGTHS)
@pytest.mark.parametrize(
    ("change", "file", "field"),
    [
        (lambda root, factor: change_sweeps(root, with_points(lambda p: p * factor)), ".npz", "points"),
        (scale_head("cameras", "front", "vehicle_from_camera", "translation_m"), "recording.json", "cameras.front."),
        (scale_head("lidar", "vehicle_from_lidar", "translation_m"), "recording.json", "lidar.vehicle_from_lidar"),
        (scale_head("vehicle", "outline_m"), "recording.json", "vehicle.outline_m"),
        (lambda root, factor: scale_boxes(root, sizes=factor), "annotations.json", "sizes of the boxes"),
        (lambda root, factor: scale_boxes(root, places=factor), "annotations.json", "places of the boxes"),
    ],
)
def test_lengths(root, unit, change, file, field):
    change(root, LENGTHS[unit])
    told = cause(root, returns=unit == "centimetres" and field == "places of the boxes")
    assert told.check == "length-unit"
    assert told.file.endswith(file)
    assert told.field.startswith(field)
    assert told.hint == f"these would be {unit}: multiply them by {1 / LENGTHS[unit]:g}"


@pytest.mark.parametrize(
    ("changes", "field", "remedy"),
    [
        ({"speed_mps": 3.6 * drive.SPEED_MPS}, "speed", "multiply the speed by 0.2778"),
        pytest.param({"speed_mps": drive.SPEED_MPS / 3.6}, "speed", "multiply the speed by 3.6", marks=SLOW),
        pytest.param({"speed_mps": 1000 * drive.SPEED_MPS}, "speed", "multiply the speed by 0.001", marks=SLOW),
        pytest.param({"gear": "R"}, "gear or sign of the speed", "multiply the speed by -1", marks=SLOW),
        pytest.param({"yaw_rate_radps": -drive.TURN_RADPS}, "sign of the yaw rate", "multiply the yaw rate by -1",
                     marks=SLOW),
        pytest.param({"yaw_rate_radps": np.degrees(drive.TURN_RADPS)}, "yaw rate", "multiply the yaw rate by 0.01745",
                     marks=SLOW),
    ],
)  # fmt: skip
def test_speed_and_yaw_rate_of_the_bus_are_tried_against_the_lidar(root, changes, field, remedy):
    change_bus(root, lambda row: row.update({column: str(value) for column, value in changes.items()}))
    findings = found(root, static_world=True, returns=True)
    (told,) = [finding for finding in findings if finding.check == "ego-motion-unit"]
    assert (told.field, told.severity, told.hint) == (field, Severity.ERROR, f"check unit and sign: {remedy}")
    assert told.file.endswith("egomotion.csv")
    (following,) = (cause.following for cause in causes() if cause.name == "the ego-motion")
    labels = {(finding.severity, finding.hint) for finding in findings if finding.check in following}
    assert labels <= {(Severity.WARNING, "may follow from the ego-motion: correct that, validate again")}


def without_velocities(root):
    change_boxes(root, lambda _name, _i, data: data.pop("vec"))


@pytest.mark.parametrize(
    ("factor", "change", "got"),
    [
        (3.6, None, r"4 objects off by up to 20.8 m/s, 0.0 m/s if the ego vehicle's speed is km/h read as m/s"),
        (1 / 3.6, None, r"4 objects off by up to 5.8 m/s, 0.0 m/s if the ego vehicle's speed is m/s read as km/h"),
        (1 / 3.6, without_velocities, r"headings of 2 objects up to 1\d\d degrees off, none if .* m/s read as km/h"),
    ],
)
def test_where_sweeps_cannot_be_matched_labels_tell_that_the_ego_speed_is_wrong(root, factor, change, got):
    change_bus(root, lambda row: row.update(speed_mps=str(factor * drive.SPEED_MPS)))
    for i, path in enumerate(sweep_files(root)):
        if i % 4:
            path.unlink()
    if change is not None:
        change(root)
    told = cause(root)
    assert (told.check, told.field, told.file) == ("ego-speed", "speed", str(root / "egomotion.csv"))
    assert re.fullmatch(got, told.got), told.got
    assert told.hint == f"multiply the speed by {1 / factor:.4g}"


def test_relative_velocities_at_walking_pace_may_be_a_wrong_ego_speed_as_well(root, monkeypatch):
    recording = open_native(root)
    path = replace(recording.trajectory, positions_m=recording.trajectory.positions_m / 4)  # 2 m/s

    def relative(track):
        ways = [state.velocity_mps - [drive.SPEED_MPS, 0.0, 0.0] for state in track.states]
        states = [replace(state, velocity_mps=way) for state, way in zip(track.states, ways, strict=True)]
        return replace(track, states=tuple(states))

    slow = replace(recording, trajectory=path, tracks=tuple(map(relative, recording.tracks)))
    (told,) = (finding for finding in check_motion(slow) if finding.check == "velocity")
    labels, ego = "relative to the vehicle instead of over the ground", "the ego vehicle's speed is km/h read as m/s"
    assert (told.times, told.hint) == (2, f"{labels}; or {ego}")
    monkeypatch.setattr(motion, "CONFIRMED_BY", 0)  # as if sweeps met by the stated speed
    (told,) = (finding for finding in check_motion(slow) if finding.check == "velocity")
    assert told.hint == labels


@pytest.mark.parametrize("start_ns", [0, 3 * 10**14, 1_700_000_000 * 10**9])
@pytest.mark.parametrize("step_ns", [500_000, 10**7, 10**8, 2 * 10**9])
def test_nanoseconds_are_left_alone_whatever_the_clock(start_ns, step_ns):
    assert other_unit(start_ns + step_ns * np.arange(20)) is None
    assert other_unit(start_ns + step_ns * np.arange(1)) is None
