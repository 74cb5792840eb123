"""Annotation files: tracks there and back, and every fault with its place."""

import json
import re
from dataclasses import fields, is_dataclass, replace
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from bench.commands.schemas import json_schema
from bench.errors import DataError, UsageError
from bench.geometry import RigidTransform
from bench.recordings import (
    Cuboid,
    GroundPolygon,
    ObjectState,
    PointIndices,
    Track,
    read_annotations,
    write_annotations,
)
from bench.records.recording import MOTION_KINDS
from bench.records.reference import Category
from tests.support import tiny

FOLDER = Path(__file__).parents[2] / "annotations"


def assert_same(one, other):
    """The same records with the same numbers, but for rotations, since a quaternion is rounded."""
    assert type(one) is type(other)
    if isinstance(one, RigidTransform):
        assert np.array_equal(one.translation_m, other.translation_m)
        assert one.rotation == pytest.approx(other.rotation, abs=1e-12)
    elif is_dataclass(one):
        for part in fields(one):
            assert_same(getattr(one, part.name), getattr(other, part.name))
    elif isinstance(one, tuple):
        for part, expected in zip(one, other, strict=True):
            assert_same(part, expected)
    else:
        assert np.array_equal(one, other, equal_nan=isinstance(one, np.ndarray))


number, size, times_ns = st.floats(-1e4, 1e4), st.floats(0.01, 30), st.integers(0, 2**62)
vectors = hnp.arrays(np.float64, 3, elements=number)
poses = st.builds(RigidTransform.from_quaternion, st.tuples(*[st.floats(0.1, 1)] * 4), vectors)
cuboids = st.builds(Cuboid, vehicle_from_object=poses, size_m=hnp.arrays(np.float64, 3, elements=size))
outlines = st.builds(
    lambda points, bottom, height: GroundPolygon(outline_m=points, bottom_m=bottom, top_m=bottom + height),
    hnp.arrays(np.float64, st.tuples(st.integers(3, 6), st.just(2)), elements=number),
    st.floats(-3, 3),
    size,
)
rows = hnp.arrays(np.int64, st.integers(0, 5), elements=st.integers(0, 10**6))
states = st.builds(
    ObjectState,
    timestamp_ns=times_ns,
    shape=cuboids | outlines | st.builds(PointIndices, indices=rows, sweep_timestamp_ns=times_ns),
    velocity_mps=vectors | st.just(np.full(3, np.nan)),
    yaw_rate_radps=number,
    category=st.none() | st.sampled_from(["crossing", "preceding"]),
    unclear=st.booleans(),
)
time_of = attrgetter("timestamp_ns")
some_tracks = st.lists(
    st.builds(
        Track,
        track_id=st.text(st.characters(codec="utf-8"), min_size=1, max_size=5),
        object_class=st.sampled_from(["pedestrian", "cyclist", "vehicle", "animal"]),
        states=st.lists(states, max_size=3, unique_by=time_of).map(lambda some: tuple(sorted(some, key=time_of))),
        instance_id=st.none() | st.integers(1, 65535),
    ),
    max_size=3,
    unique_by=attrgetter("track_id"),
)


@settings(max_examples=50)  # of up to nine states each
@given(tracks=some_tracks, reviewed=st.booleans())
def test_any_tracks_come_back_and_whether_anybody_reviewed(tmp_path_factory, tracks, reviewed):
    path = tmp_path_factory.mktemp("labels") / "a.json"
    tracks = tuple(replace(track, reviewed=reviewed) for track in tracks)
    write_annotations(path, tracks)
    assert_same(read_annotations(path), tracks)


def test_times_without_objects_can_be_said(tmp_path):
    write_annotations(tmp_path / "a.json", (), timestamps_ns=(5, 7))
    frames = json.loads((tmp_path / "a.json").read_text())["openlabel"]["frames"]
    assert [frame["frame_properties"]["timestamp"] for frame in frames.values()] == [5, 7]
    assert read_annotations(tmp_path / "a.json") == ()


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"timestamp_ns": 2**62 + 1}, r"timestamp: expected less than or equal to"),
        ({"yaw_rate_radps": float("nan")}, r"expected a finite number, got nan"),
        ({"category": "crosing"}, r"text\.0\.val: expected 'crossing', .* or 'static_ego', got 'crosing'"),
    ],
)
def test_what_could_not_be_read_back_is_not_written(tmp_path, changes, told):
    van = tiny.tracks()[0]
    track = replace(van, states=(replace(van.states[0], **changes),))
    with pytest.raises(DataError, match=told) as caught:
        write_annotations(tmp_path / "a.json", (track,))
    assert str(caught.value).startswith(f"{tmp_path / 'a.json'}: openlabel.frames.0.")
    assert list(tmp_path.iterdir()) == []


def minimal(**data):
    return {
        "openlabel": {
            "metadata": {"schema_version": "1.0.0"},
            "objects": {"van": {"name": "van", "type": "vehicle"}},
            "frames": {"0": {"frame_properties": {"timestamp": 5}, "objects": {"van": {"object_data": data}}}},
        }
    }


BOX = {"name": "shape", "val": [8.0, -3.5, 1.0, 0.0, 0.0, 0.7071067811865476, 0.7071067811865476, 5.0, 2.0, 1.5]}
OUTLINE = {"name": "ground_outline", "closed": True, "mode": "MODE_POLY2D_ABSOLUTE", "val": [0, 0, 1, 0, 1, 1]}


def test_quaternions_are_xyzw(tmp_path):
    path = tmp_path / "a.json"
    path.write_text(json.dumps(minimal(cuboid=[BOX])))
    (track,) = read_annotations(path)
    pose = track.states[0].shape.vehicle_from_object
    assert pose.apply(np.array([1.0, 0.0, 0.0])) == pytest.approx([8.0, -2.5, 1.0])


def changed(change):
    content = minimal(cuboid=[BOX])
    change(content["openlabel"])
    return content


def named(name, val):
    return [{"name": name, "val": val}]


PLACE = "openlabel.frames.0.objects.van.object_data"
HEIGHTS = [{"name": "bottom_m", "val": 2}, {"name": "top_m", "val": 1}]
FAULTS = [
    (minimal(), f"{PLACE}: expected one of cuboid, poly2d and vec point_indices, got {{}}"),
    (minimal(cuboid=[BOX], poly2d=[OUTLINE]), "one of cuboid, poly2d and vec point_indices, got {'cuboid'"),
    (minimal(cuboid=[BOX] * 2), f"{PLACE}.cuboid"),
    (minimal(cuboid=named("shape", [0.0] * 10)), "numbers 4 to 7 to be a quaternion"),
    (minimal(cuboid=[BOX | {"val": [*BOX["val"][:9], 0.0]}]), "numbers 8 to 10 to be sizes above 0"),
    (minimal(cuboid=[BOX | {"colour": "red"}]), f"{PLACE}.cuboid.0.colour: expected no such key, got 'red'"),
    (minimal(poly2d=[OUTLINE]), f"{PLACE}: expected with a poly2d the numbers bottom_m and top_m"),
    (minimal(poly2d=[OUTLINE | {"val": [0, 0, 1, 0, 1, 1, 2]}]), "an even number of values"),
    (minimal(poly2d=[OUTLINE | {"val": [0.0] * 2002}]), "poly2d.0.val: expected Tuple should have at most 2000 items"),
    (minimal(poly2d=[OUTLINE], num=HEIGHTS), "the numbers bottom_m and top_m, which is above it"),
    (minimal(vec=named("point_indices", [1])), "expected with point_indices a number named sweep_timestamp_ns"),
    (minimal(cuboid=[BOX], vec=named("velocity_mps", [1.0, 2.0])), "velocity_mps.val.2: expected a value"),
    (minimal(cuboid=[BOX], vec=named("velocity_mps", [10**400, 0, 0])), "val.0: expected a finite number"),
    (minimal(cuboid=[BOX], num=named("yaw_rate_radps", 0.0) * 2), f"{PLACE}.num: expected each name once"),
    (changed(lambda label: label["objects"].clear()), "expected an object listed under openlabel.objects, got 'van'"),
    (
        changed(lambda label: label["frames"].update({"1": label["frames"]["0"]})),
        "expected one frame for each time, got 5",
    ),
    (
        changed(lambda label: label["objects"]["van"].update(type="tram")),
        "objects.van.type: expected 'pedestrian', 'cyc",
    ),
]


@pytest.mark.parametrize(("content", "message"), FAULTS, ids=[message for _, message in FAULTS])
def test_faults_name_file_and_place(tmp_path, content, message):
    path = tmp_path / "a.json"
    path.write_text(json.dumps(content))
    with pytest.raises(DataError) as caught:
        read_annotations(path)
    assert str(caught.value).startswith(f"{path}: openlabel.")
    assert message in str(caught.value)


def test_the_kinds_of_motion_are_those_of_the_reference():
    assert set(MOTION_KINDS) == {category.value for category in Category} - {Category.MOVING.value}


def test_the_committed_schema_is_in_step():
    assert json.loads((FOLDER / "openlabel-subset.schema.json").read_text()) == json_schema("annotations")


def test_the_example_of_the_readme_is_valid(tmp_path):
    (example,) = re.findall(r"```json\n(.*?)```", (FOLDER / "README.md").read_text(), re.DOTALL)
    (tmp_path / "a.json").write_text(example)
    (track,) = read_annotations(tmp_path / "a.json")
    assert track.states[0].velocity_mps.tolist() == [6.0, 0.0, 0.0]


@pytest.mark.parametrize("kind", [None, 5, ["Car"]])
def test_an_adapters_class_that_is_no_text_is_refused_where_it_is_given(kind):
    with pytest.raises(UsageError, match="track 'van': expected text as object_class, got"):
        Track(track_id="van", object_class=kind, states=())
