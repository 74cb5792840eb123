"""`.label` files of moving points: to objects, with their velocities."""

from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
import pytest

from bench.annotation.formats.conversion import LabelOptions, import_labels
from bench.annotation.formats.semantickitti import near_groups
from bench.errors import DataError
from bench.lidar.files import read_sweep
from bench.lidar.sweep import LidarSweep
from tests.annotation.formats import street

CAR, MOVING_CAR, MOVING_PERSON, ROAD, MOVING = 10, 252, 254, 40, 251
PLAIN = LabelOptions()


def read(source, drive, options=PLAIN):
    return import_labels("semantickitti", source, drive, options)


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


def test_label_and_instance_together_are_an_object_and_what_stands_is_none(tmp_path, drive):
    write_sequence(tmp_path / "00" / "labels")
    label_set = read(tmp_path / "00", drive)
    assert label_set.timestamps_ns == street.TIMES_NS
    car, person = sorted(label_set.tracks, key=lambda track: track.track_id)
    assert (car.track_id, person.track_id) == ("moving-car-7", "moving-person-7")
    for track, name, within in ((car, "car", 1.0), (person, "walker", 0.3)):
        assert track.object_class == street.CLASSES[name]
        assert [state.timestamp_ns for state in track.states] == list(street.TIMES_NS)
        for i, state in enumerate(track.states):
            assert state.shape.sweep_timestamp_ns == street.TIMES_NS[i]
            assert state.shape.indices.tolist() == street.sweep(i)[1][name].tolist()
            world = drive.trajectory.world_from_vehicle(state.timestamp_ns).rotate(state.velocity_mps)
            assert np.abs(world - street.SPEEDS_MPS[name]).max() < within  # points are drawn at random
    assert f"points of label {CAR}, which does not say moving ({street.POINTS * street.SWEEPS})" in label_set.lost


def test_moving_points_without_instance_are_grouped_and_followed(tmp_path, drive):
    """Masks of moving-object segmentation: 9 and 251, in a folder predictions/."""
    kinds = {"car": (MOVING, 0), "walker": (MOVING, 0), "parked": (9, 0)}
    write_sequence(tmp_path / "predictions", kinds)
    options = LabelOptions(classes={"moving": "vehicle"})
    label_set = read(tmp_path, drive, options)
    found = [sorted(s.shape.indices.tolist() for s in t.states) for t in label_set.tracks]
    truth = [sorted(street.sweep(i)[1][name].tolist() for i in range(street.SWEEPS)) for name in ("car", "walker")]
    # The random points of a car lie up to a metre apart: what belongs together stays together, over all sweeps.
    whole = [sorted(chain(*rows)) for rows in found]
    assert all(any(set(part) <= set(chain(*rows)) for rows in truth) for part in whole)
    assert sum(map(len, whole)) == 2 * street.POINTS * street.SWEEPS
    assert max(len(track.states) for track in label_set.tracks) == street.SWEEPS
    assert any("places of moving without an id: followed by nearness" in line for line in label_set.lost)


def test_a_moving_mask_does_not_say_of_which_class(tmp_path, drive):
    write_sequence(tmp_path / "predictions", {"car": (MOVING, 0)})
    with pytest.raises(DataError, match=r"got 'moving'; map each of them, as --class 'moving=CLASS'"):
        read(tmp_path, drive)


def test_a_chain_of_short_steps_is_one_group():
    chain = [[0.4 * i, 0.0, 0.0] for i in range(10)]
    apart = [[4.2, 0.0, 0.0], [4.2, 0.4, 0.0]]
    assert near_groups(np.array(chain)).tolist() == [0] * 10
    assert near_groups(np.array([*apart, *chain])).tolist() == [0, 0, *[1] * 10]
    assert near_groups(np.array([[0.0, 0.0, 0.0], [0.0, 0.51, 0.0]])).tolist() == [0, 1]


def test_points_of_other_labels_are_counted(tmp_path, drive):
    write_sequence(tmp_path, {"car": (0, 0), "walker": (300, 0), "parked": (CAR, 0)})
    label_set = read(tmp_path, drive)
    count = street.POINTS * street.SWEEPS
    assert label_set.tracks == ()
    assert label_set.timestamps_ns == street.TIMES_NS
    lost = {f"points of label {label}, which does not say moving ({count})" for label in (0, 300, CAR)}
    assert lost <= set(label_set.lost)


def test_labels_count_in_the_sweep_as_it_is_stored(tmp_path, drive):
    """Lost returns have labels, too: a reader leaves them out, and the rows of an object stay those of the file."""
    ref = drive.sweeps[0]
    short = replace(drive, sweeps=(replace(ref, reader=first_ten_lost),))
    write_sequence(tmp_path, sweeps=[0])
    (of_car,) = (t.states[0].shape.indices for t in read(tmp_path, short).tracks if t.track_id == "moving-car-7")
    rows = street.sweep(0)[1]["car"]
    assert of_car.tolist() == rows[rows >= 10].tolist()
    assert first_ten_lost(ref.path, ref.timestamp_ns).rows_of(of_car).tolist() == (rows[rows >= 10] - 10).tolist()
    labels, instances = true_labels(0, WITH_INSTANCES)
    put(tmp_path, "000000", packed(labels[10:], instances[10:]))
    with pytest.raises(DataError, match=r"expected 180 labels .* got 170 labels; labels count in the sweep"):
        read(tmp_path, short)


def first_ten_lost(path, timestamp_ns):
    whole = read_sweep(path, timestamp_ns)
    return LidarSweep(
        timestamp_ns=timestamp_ns,
        points_lidar=whole.points_lidar[10:],
        time_offset_ns=whole.time_offset_ns[10:],
        stored_rows=np.arange(10, len(whole.points_lidar)),
        stored_count=len(whole.points_lidar),
    )


def put(folder, stem, content):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{stem}.label").write_bytes(content)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (Path.exists, "expected a folder of .label files, got nothing"),
        (lambda f: f.write_bytes(b"1234"), "expected a folder of .label files, got a file"),
        (lambda f: f.mkdir(), "expected files <frame>.label"),
        (lambda f: (f / "000000.label").mkdir(parents=True), "got a folder"),
        (lambda f: put(f, "000000", b""), "expected 180 labels .* got 0 labels"),
        (lambda f: put(f, "000000", bytes(4 * 180 - 1)), "got 179.75 labels"),
        (lambda f: put(f, "000000", bytes(4 * 181)), "181 labels"),
        (lambda f: put(f, "000009", bytes(4 * 180)), "got 000009"),
        (lambda f: [put(f / d, "000000", bytes(4 * 180)) for d in ("labels", "predictions")], "labels and predictions"),
    ],
)
def test_files_that_are_not_labels(tmp_path, drive, make, message):
    make(tmp_path / "in")
    with pytest.raises(DataError, match=message):
        read(tmp_path / "in", drive)


def test_a_link_that_leads_out_is_refused(tmp_path, drive):
    put(tmp_path / "elsewhere", "000000", bytes(4 * 180))
    (tmp_path / "in").mkdir()
    (tmp_path / "in/000000.label").symlink_to(tmp_path / "elsewhere/000000.label")
    with pytest.raises(DataError, match="a link that leads outside"):
        read(tmp_path / "in", drive)


def test_a_sweep_without_points(tmp_path, drive):
    def nothing(path, timestamp_ns):
        return LidarSweep(timestamp_ns=timestamp_ns, points_lidar=np.empty((0, 3)))

    empty = replace(drive, sweeps=(replace(drive.sweeps[0], reader=nothing),))
    put(tmp_path / "in", "000000", b"")
    label_set = read(tmp_path / "in", empty)
    assert (label_set.tracks, label_set.timestamps_ns) == ((), street.TIMES_NS[:1])
