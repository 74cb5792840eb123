"""`.label` files: to point clusters and back, their velocities, and boxes -> labels."""

import re
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
import pytest

from bench.errors import DataError, UsageError
from bench.geometry import RigidTransform
from bench.labels import LabelOptions, LabelSet, label_format
from bench.lidar import LidarSweep, read_sweep
from bench.recordings import Cuboid, ObjectState, PointIndices, SweepRef, Track
from tests.labels import street

CAR, MOVING_CAR, MOVING_PERSON, ROAD, MOVING = 10, 252, 254, 40, 251
PLAIN = LabelOptions()


@pytest.fixture
def semantickitti():
    return label_format("semantickitti")


def packed(labels, instances):
    """As the data set packs them: 16 bits of label below 16 bits of instance, little-endian."""
    return b"".join(
        int(label).to_bytes(2, "little") + int(i).to_bytes(2, "little")
        for label, i in zip(labels, instances, strict=True)
    )


def true_labels(index, kinds):
    """Labels and instances of a sweep; `kinds` gives (label, instance) of each object, all else is road."""
    made, rows = street.sweep(index)
    labels, instances = np.full(len(made.points_lidar), ROAD), np.zeros(len(made.points_lidar), dtype=int)
    for name, (label, instance) in kinds.items():
        labels[rows[name]], instances[rows[name]] = label, instance
    return labels, instances


WITH_INSTANCES = {"car": (MOVING_CAR, 7), "walker": (MOVING_PERSON, 7), "parked": (CAR, 7)}


def write_sequence(folder, kinds=None, *, sweeps=range(street.SWEEPS)):
    folder.mkdir(parents=True, exist_ok=True)
    for i in sweeps:
        (folder / f"{i:06d}.label").write_bytes(packed(*true_labels(i, kinds or WITH_INSTANCES)))


def test_label_and_instance_together_are_an_object(tmp_path, drive, semantickitti):
    write_sequence(tmp_path / "00" / "labels")
    label_set = semantickitti.read(tmp_path / "00", drive, PLAIN)
    assert {t.track_id: t.object_class for t in label_set.tracks} == {
        "car-7": "vehicle",
        "moving-car-7": "vehicle",
        "moving-person-7": "pedestrian",
    }
    assert label_set.timestamps_ns == street.TIMES_NS
    names = {"car-7": "parked", "moving-car-7": "car", "moving-person-7": "walker"}
    for track in label_set.tracks:
        assert [s.timestamp_ns for s in track.states] == list(street.TIMES_NS)
        for i, state in enumerate(track.states):
            assert isinstance(state.shape, PointIndices)
            assert state.shape.sweep_timestamp_ns == street.TIMES_NS[i]
            assert state.shape.indices.tolist() == street.sweep(i)[1][names[track.track_id]].tolist()


def test_labels_count_all_rows_of_sweeps_with_lost_returns(tmp_path, drive, semantickitti):
    """An organised cloud has rows without a position; its labels have a number for each of them, too."""
    folder = tmp_path / "labels"
    folder.mkdir()
    for i, ref in enumerate(drive.sweeps):
        sweep = ref.read()
        count = len(sweep.points_lidar)
        points = np.full((2 * count, 3), np.nan, dtype=np.float32)
        points[1::2] = sweep.points_lidar
        np.savez(ref.path, points_lidar=points, time_offset_ns=np.repeat(sweep.time_offset_ns, 2))
        labels, instances = true_labels(i, WITH_INSTANCES)
        both = packed(
            np.stack([np.full(count, ROAD), labels], 1).ravel(), np.stack([0 * instances, instances], 1).ravel()
        )
        (folder / f"{i:06d}.label").write_bytes(both)
    label_set = semantickitti.read(tmp_path, drive, PLAIN)
    names = {"car-7": "parked", "moving-car-7": "car", "moving-person-7": "walker"}
    assert {track.track_id for track in label_set.tracks} == set(names)
    for track in label_set.tracks:
        for i, state in enumerate(track.states):
            rows = street.sweep(i)[1][names[track.track_id]]
            assert state.shape.indices.tolist() == (2 * rows + 1).tolist()
            read = drive.sweeps[i].read()
            assert read.rows_of(state.shape.indices).tolist() == rows.tolist()
    semantickitti.write(label_set, drive, tmp_path / "out", PLAIN)
    (written,) = [*(tmp_path / "out").rglob("000002.label")]
    stored = np.fromfile(written, "<u4") & 0xFFFF
    assert len(stored) == len(np.fromfile(folder / "000002.label", "<u4"))
    assert set(np.flatnonzero(stored == MOVING_CAR)) == set(2 * street.sweep(2)[1]["car"] + 1)


def test_what_stands_has_no_velocity_and_what_moves_that_of_its_middle(tmp_path, drive, semantickitti):
    write_sequence(tmp_path / "labels")
    tracks = {t.track_id: t for t in semantickitti.read(tmp_path, drive, PLAIN).tracks}
    assert all(s.velocity_mps.tolist() == [0, 0, 0] for s in tracks["car-7"].states)
    for name, speed, within in (("moving-car-7", street.CAR_MPS, 1.0), ("moving-person-7", street.WALKER_MPS, 0.3)):
        for state in tracks[name].states:
            world = drive.trajectory.world_from_vehicle(state.timestamp_ns).rotate(state.velocity_mps)
            assert np.abs(world - speed).max() < within  # the points are drawn at random in the object


def test_an_object_that_moves_in_one_sweep_only_has_an_unknown_velocity(tmp_path, drive, semantickitti):
    write_sequence(tmp_path / "labels", sweeps=[2])
    label_set = semantickitti.read(tmp_path, drive, PLAIN)
    assert label_set.timestamps_ns == (street.TIMES_NS[2],)
    velocities = {t.track_id: t.states[0].velocity_mps for t in label_set.tracks}
    assert np.isnan(velocities["moving-car-7"]).all()
    assert velocities["car-7"].tolist() == [0, 0, 0]
    assert any("2 states remain without" in line for line in label_set.lost)


def test_moving_points_without_instance_are_grouped_and_followed(tmp_path, drive, semantickitti):
    """Masks of moving-object segmentation: 9 and 251, in a folder predictions/."""
    kinds = {"car": (MOVING, 0), "walker": (MOVING, 0), "parked": (9, 0)}
    write_sequence(tmp_path / "predictions", kinds)
    options = LabelOptions(classes={"moving": "vehicle"})
    label_set = semantickitti.read(tmp_path, drive, options)
    found = [sorted(s.shape.indices.tolist() for s in t.states) for t in label_set.tracks]
    truth = [sorted(street.sweep(i)[1][name].tolist() for i in range(street.SWEEPS)) for name in ("car", "walker")]
    # The random points of a car lie up to a metre apart: what belongs together stays together, over all sweeps.
    whole = [sorted(chain(*rows)) for rows in found]
    assert all(any(set(part) <= set(chain(*rows)) for rows in truth) for part in whole)
    assert sum(map(len, whole)) == 2 * street.POINTS * street.SWEEPS
    walker = max(label_set.tracks, key=lambda t: t.track_id in ("moving-group-1", "moving-group-2") and len(t.states))
    assert len(walker.states) == street.SWEEPS
    assert any("points of moving without an instance: grouped" in line for line in label_set.lost)


def test_a_moving_mask_does_not_say_of_which_class(tmp_path, drive, semantickitti):
    write_sequence(tmp_path / "predictions", {"car": (MOVING, 0), "walker": (300, 4)})
    with pytest.raises(DataError, match=r"'300', 'moving'.*--class 300=CLASS --class moving=CLASS"):
        semantickitti.read(tmp_path, drive, PLAIN)
    options = LabelOptions(classes={"moving": None, "300": "pedestrian"})
    label_set = semantickitti.read(tmp_path, drive, options)
    assert [(t.track_id, t.object_class) for t in label_set.tracks] == [("300-4", "pedestrian")]
    assert f"{street.POINTS * street.SWEEPS} points of moving: left out as asked" in label_set.lost
    assert np.isfinite(label_set.tracks[0].states[0].velocity_mps).all()
    assert np.abs(label_set.tracks[0].states[2].velocity_mps).max() > 0.5  # a number says nothing of standing


def test_points_without_a_class_are_reported(tmp_path, drive, semantickitti):
    write_sequence(tmp_path, {"car": (0, 0), "walker": (1, 0), "parked": (CAR, 0)})
    label_set = semantickitti.read(tmp_path, drive, PLAIN)
    count = street.POINTS * street.SWEEPS
    assert label_set.tracks == ()
    assert label_set.timestamps_ns == street.TIMES_NS
    assert label_set.lost == (
        f"{2 * count} points without a class (unlabeled, outlier)",
        f"{count} points of car without an instance: left out, stationary",
    )


def test_labels_come_back_as_they_were(tmp_path, drive, semantickitti):
    kinds = {"car": (258, 65535), "walker": (253, 1), "parked": (13, 2)}
    write_sequence(tmp_path / "in", kinds, sweeps=[0, 2, 3])
    label_set = semantickitti.read(tmp_path / "in", drive, PLAIN)
    semantickitti.write(label_set, drive, tmp_path / "out", PLAIN)
    assert sorted(path.name for path in (tmp_path / "out/labels").iterdir()) == [f"00000{i}.label" for i in (0, 2, 3)]
    for i in (0, 2, 3):
        labels, instances = true_labels(i, kinds)
        labels[labels == ROAD] = 9  # what is no object stands
        assert (tmp_path / f"out/labels/00000{i}.label").read_bytes() == packed(labels, instances)


def test_groups_come_back_without_an_instance(tmp_path, drive, semantickitti):
    write_sequence(tmp_path / "in", {"car": (MOVING, 0), "walker": (MOVING_PERSON, 0)})
    label_set = semantickitti.read(tmp_path / "in", drive, LabelOptions(classes={"moving": "vehicle"}))
    semantickitti.write(label_set, drive, tmp_path / "out", PLAIN)
    labels, instances = true_labels(1, {"car": (MOVING, 0), "walker": (MOVING_PERSON, 0)})
    labels[labels == ROAD] = 9
    assert (tmp_path / "out/labels/000001.label").read_bytes() == packed(labels, instances)


def test_boxes_become_labels_of_the_points_in_them(tmp_path, drive, semantickitti):
    """Each point was seen at its own time, with the ego vehicle, the car and its heading elsewhere."""
    lost = semantickitti.write(street.label_set(), drive, tmp_path, PLAIN)
    for i in range(street.SWEEPS):
        _, rows = street.sweep(i)
        values = np.fromfile(tmp_path / f"labels/{i:06d}.label", dtype="<u4")
        for name, label in (("car", MOVING_CAR), ("walker", MOVING_PERSON), ("parked", CAR)):
            assert np.flatnonzero(values & 0xFFFF == label).tolist() == rows[name].tolist()
        assert set((values >> 16)[values & 0xFFFF != 9].tolist()) == {1}
        assert (values == 9).sum() == street.GROUND
    assert any("their points are kept, the shapes are not" in line for line in lost)


def test_without_velocities_boxes_find_theirs(tmp_path, drive, semantickitti):
    semantickitti.write(street.label_set("car", told=False), drive, tmp_path, PLAIN)
    for i in range(street.SWEEPS):
        values = np.fromfile(tmp_path / f"labels/{i:06d}.label", dtype="<u4")
        assert np.flatnonzero(values & 0xFFFF == MOVING_CAR).tolist() == street.sweep(i)[1]["car"].tolist()


def test_overlaps_unclear_objects_and_other_shapes(tmp_path, drive, semantickitti):
    """Named points go over the smaller box, it over the larger; unclear objects get no label."""
    time_ns = street.TIMES_NS[0]
    _, rows = street.sweep(0)
    big = street.box_track("car").states[0]
    far = replace(big, shape=replace(big.shape, size_m=np.array([80.0, 80.0, 9.0])), velocity_mps=np.zeros(3))
    named = ObjectState(
        timestamp_ns=time_ns + 1,  # as annotated at an image; the points count in the sweep
        shape=PointIndices(indices=rows["car"][:5], sweep_timestamp_ns=time_ns),
        velocity_mps=np.zeros(3),
        category="crossing",
    )
    walker = replace(street.box_track("walker").states[0], unclear=True)
    tracks = (
        Track(track_id="named", object_class="cyclist", states=(named,)),
        Track(track_id="unclear", object_class="pedestrian", states=(walker,)),
        Track(track_id="small", object_class="vehicle", states=(big,)),
        Track(track_id="huge", object_class="animal", states=(far,)),
    )
    lost = semantickitti.write(LabelSet(tracks=tracks, timestamps_ns=()), drive, tmp_path, PLAIN)
    labels = np.fromfile(tmp_path / "labels/000000.label", dtype="<u4") & 0xFFFF
    assert np.flatnonzero(labels == 253).tolist() == rows["car"][:5].tolist()
    assert np.flatnonzero(labels == MOVING_CAR).tolist() == rows["car"][5:].tolist()
    assert np.flatnonzero(labels == 0).tolist() == rows["walker"].tolist()
    assert set(rows["parked"].tolist()) <= set(np.flatnonzero(labels == 99).tolist())
    assert "class animal: written as other-object, which does not say it" in lost
    assert "1 unclear observations: their points are unlabeled" in lost
    assert [path.name for path in (tmp_path / "labels").iterdir()] == ["000000.label"]


def test_labels_count_in_the_sweep_as_it_is_read(tmp_path, drive, semantickitti):
    """A reader that leaves points out must have labels of the points that it keeps."""
    ref = drive.sweeps[0]
    short = replace(drive, sweeps=(SweepRef(timestamp_ns=ref.timestamp_ns, path=ref.path, reader=without_first_ten),))
    write_sequence(tmp_path / "raw", sweeps=[0])
    with pytest.raises(DataError, match=r"expected 170 labels .* got 720 bytes, 180 labels; labels count in the sweep"):
        semantickitti.read(tmp_path / "raw", short, PLAIN)
    labels, instances = true_labels(0, WITH_INSTANCES)
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept/000000.label").write_bytes(packed(labels[10:], instances[10:]))
    label_set = semantickitti.read(tmp_path / "kept", short, PLAIN)
    of_car = next(t for t in label_set.tracks if t.track_id == "moving-car-7").states[0].shape.indices
    rows = street.sweep(0)[1]["car"]
    assert of_car.tolist() == (rows[rows >= 10] - 10).tolist()


def without_first_ten(path, timestamp_ns):
    whole = read_sweep(path, timestamp_ns)
    return LidarSweep(
        timestamp_ns=timestamp_ns, points_lidar=whole.points_lidar[10:], time_offset_ns=whole.time_offset_ns[10:]
    )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (Path.exists, "expected a folder of .label files, got nothing"),
        (lambda f: f.write_bytes(b"1234"), "expected a folder of .label files, got a file"),
        (lambda f: f.mkdir(), "expected files <frame>.label"),
        (lambda f: (f / "000000.label").mkdir(parents=True), "got a folder"),
        (lambda f: put(f, "000000", b""), "expected 180 labels .* got 0 bytes"),
        (lambda f: put(f, "000000", bytes(4 * 180 - 1)), "got 719 bytes, 179 labels and a rest"),
        (lambda f: put(f, "000000", bytes(4 * 181)), "181 labels"),
        (lambda f: put(f, "000009", bytes(4 * 180)), "got 000009"),
        (lambda f: put(f, "a", bytes(4 * 180)), "got a;"),
        (lambda f: [put(f / d, "000000", bytes(4 * 180)) for d in ("labels", "predictions")], "labels and predictions"),
    ],
)
def test_files_that_are_not_labels(tmp_path, drive, semantickitti, make, message):
    make(tmp_path / "in")
    with pytest.raises(DataError, match=message):
        semantickitti.read(tmp_path / "in", drive, PLAIN)


def put(folder, stem, content):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{stem}.label").write_bytes(content)


def test_a_link_that_leads_out_is_refused(tmp_path, drive, semantickitti):
    put(tmp_path / "elsewhere", "000000", bytes(4 * 180))
    (tmp_path / "in").mkdir()
    (tmp_path / "in/000000.label").symlink_to(tmp_path / "elsewhere/000000.label")
    with pytest.raises(DataError, match="a link that leads outside"):
        semantickitti.read(tmp_path / "in", drive, PLAIN)


def test_what_cannot_be_written_is_refused_by_name(tmp_path, drive, semantickitti):
    time_ns = street.TIMES_NS[0]
    beyond = ObjectState(
        timestamp_ns=time_ns,
        shape=PointIndices(indices=np.array([3, 180]), sweep_timestamp_ns=time_ns),
        velocity_mps=np.zeros(3),
    )
    label_set = LabelSet(
        tracks=(Track(track_id="x", object_class="vehicle", states=(beyond,)),), timestamps_ns=(time_ns,)
    )
    with pytest.raises(DataError, match=re.escape("point indices of 'x' from 0 to 179, got 3 to 180")):
        semantickitti.write(label_set, drive, tmp_path, PLAIN)
    label_set = street.label_set("car")
    with pytest.raises(UsageError, match="'limousine': SemanticKITTI has no label of this name"):
        semantickitti.write(label_set, drive, tmp_path, LabelOptions(classes={"limousine": "vehicle"}))
    late = replace(drive, sweeps=(replace(drive.sweeps[0], timestamp_ns=street.TIMES_NS[0] + 10**11),))
    state = replace(street.box_track("car").states[0], timestamp_ns=street.TIMES_NS[0] + 10**11)
    label_set = LabelSet(tracks=(Track(track_id="x", object_class="vehicle", states=(state,)),), timestamps_ns=())
    with pytest.raises(DataError, match="ego-motion"):
        semantickitti.write(label_set, late, tmp_path, PLAIN)
    assert not (tmp_path / "labels").exists()


def test_the_user_says_what_ours_is_called(tmp_path, drive, semantickitti):
    label_set = street.label_set("car", "parked")
    semantickitti.write(label_set, drive, tmp_path, LabelOptions(classes={"truck": "vehicle"}))
    labels = np.fromfile(tmp_path / "labels/000000.label", dtype="<u4") & 0xFFFF
    assert set(labels.tolist()) == {9, 18, 258}


def test_a_sweep_without_points(tmp_path, drive, semantickitti):
    empty = replace(drive, sweeps=(replace(drive.sweeps[0], reader=nothing),))
    put(tmp_path / "in", "000000", b"")
    label_set = semantickitti.read(tmp_path / "in", empty, PLAIN)
    assert label_set.tracks == ()
    assert label_set.timestamps_ns == (street.TIMES_NS[0],)
    box = Cuboid(vehicle_from_object=RigidTransform.identity(), size_m=np.ones(3))
    state = ObjectState(timestamp_ns=street.TIMES_NS[0], shape=box, velocity_mps=np.zeros(3))
    label_set = LabelSet(tracks=(Track(track_id="x", object_class="vehicle", states=(state,)),), timestamps_ns=())
    semantickitti.write(label_set, empty, tmp_path / "out", PLAIN)
    assert (tmp_path / "out/labels/000000.label").read_bytes() == b""


def nothing(path, timestamp_ns):
    return LidarSweep(timestamp_ns=timestamp_ns, points_lidar=np.empty((0, 3)))
