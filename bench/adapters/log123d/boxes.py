"""Boxes of a log: labels of the original data sets brought into our classes, rows joined to tracks."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.adapters.log123d.tables import LogTable, TableHead, pose
from bench.egomotion import Trajectory
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.records.recording import Cuboid, ObjectState, Track, world_velocities, world_yaw_rates

BOX_WIDTH, VELOCITY_WIDTH = 10, 3  # x, y, z, qw, qx, qy, qz, length, width, height


def _classes(
    *,
    vehicle: Iterable[int] = (),
    cyclist: Iterable[int] = (),
    pedestrian: Iterable[int] = (),
    animal: Iterable[int] = (),
) -> Mapping[int, str]:
    """Numbers of labels; the rest, such as signs and cones, are no objects that move by themselves."""
    named = {"vehicle": vehicle, "cyclist": cyclist, "pedestrian": pedestrian, "animal": animal}
    return {number: name for name, numbers in named.items() for number in numbers}


# As the enumerations of py123d 0.7 number them. Riders count as cyclists; people in wheelchairs, with strollers and on
# small wheeled devices as pedestrians.
CLASSES: Mapping[str, Mapping[int, str]] = {
    "DefaultBoxDetectionLabel": _classes(vehicle=(1, 2), cyclist=(3,), pedestrian=(4,), animal=(5,)),
    "AV2SensorBoxDetectionLabel": _classes(
        vehicle=(1, 5, 6, 10, 11, 17, 18, 19, 23, 24, 25, 26),
        cyclist=(2, 3, 13, 14),
        pedestrian=(15, 16, 22, 27, 28, 29),
        animal=(0, 9),
    ),
    "KITTI360BoxDetectionLabel": _classes(vehicle=(2, 3, 4, 14, 15, 17), cyclist=(0, 6, 9), pedestrian=(7,)),
    "NuPlanBoxDetectionLabel": _classes(vehicle=(0,), cyclist=(1,), pedestrian=(2,)),
    "NuScenesBoxDetectionLabel": _classes(vehicle=range(8), cyclist=(8, 9), pedestrian=range(10, 17), animal=(22,)),
    "PandasetBoxDetectionLabel": _classes(
        vehicle=(3, 4, 7, 8, 11, 12, 13, 17, 21, 24, 25, 26),
        cyclist=(2, 9, 10),
        pedestrian=(14, 15, 16),
        animal=(0, 1),
    ),
    "WODPerceptionBoxDetectionLabel": _classes(vehicle=(1,), pedestrian=(2,), cyclist=(4,)),
    "PhysicalAIAVBoxDetectionLabel": _classes(
        vehicle=(0, 2, 3, 4, 8, 10, 11), cyclist=(6,), pedestrian=(1, 7), animal=(9,)
    ),
}


class BoxesHead(TableHead):
    """The boxes: the class that numbers their labels."""

    box_detection_label_class: str


def read_tracks(table: LogTable, trajectory: Trajectory) -> tuple[Track, ...]:
    """Join the boxes of a log to tracks.

    Boxes and their velocities lie in the frame of the world. A velocity that is not stored follows from the positions,
    and so does one of zero where neither the row before nor the one after has the object: 123D writes zero there.
    Of several boxes of an object at one time the first counts: 123D gives one time to what NVIDIA's set has in 100 ms.

    Args:
        table: `box_detections_se3.arrow`.
        trajectory: of the ego vehicle.

    Returns:
        Tracks by token; those of objects that do not move by themselves are left out.

    Raises:
        DataError: labels of an unknown data set, columns that do not fit together, or times without ego-motion.
    """
    label_class = table.head(BoxesHead).box_detection_label_class.rpartition(".")[2]
    if label_class not in CLASSES:
        expected = f"labels of one of {', '.join(CLASSES)}"
        raise DataError(
            table.path, field="metadata.box_detection_label_class", expected=expected, got=repr(label_class)
        )
    classes = CLASSES[label_class]
    times_ns = table.times_ns()
    stored = [row or () for row in table.column("track_token").to_pylist()]
    counts = np.array([len(row) for row in stored], dtype=np.int64)
    tokens = [str(token) for row in stored for token in row]
    labels = [label for row in table.column("label").to_pylist() for label in row or ()]
    boxes = _flat(table, "bounding_box_se3", BOX_WIDTH, len(tokens))
    velocities = _flat(table, "velocity_3d", VELOCITY_WIDTH, len(tokens))
    if len(labels) != len(tokens):
        got = f"{len(labels)} labels, {len(tokens)} track tokens"
        raise DataError(table.path, expected="a label for each track token", got=got)
    at_row = np.repeat(np.arange(len(counts)), counts)
    at_ns = times_ns[at_row]
    velocities[~_has_neighbour(tokens, at_row) & ~velocities.any(axis=1)] = np.nan
    rows: dict[str, list[int]] = defaultdict(list)
    for row, (token, label) in enumerate(zip(tokens, labels, strict=True)):
        if label in classes:
            own = rows[token]
            if not own or at_row[own[-1]] != at_row[row]:
                own.append(row)
    return tuple(
        _track(token, np.array(own), classes[labels[own[0]]], at_ns, boxes, velocities, trajectory, table)
        for token, own in sorted(rows.items())
    )


def _flat(table: LogTable, name: str, width: int, count: int) -> NDArray[np.float64]:
    """(count, width) float64 of a column of lists of lists; NaN where one is missing."""
    rows = [values for row in table.column(name).to_pylist() for values in row or ()]
    flat = np.array([values or (np.nan,) * width for values in rows], dtype=np.float64).reshape(-1, width)
    if len(flat) != count:
        raise DataError(table.path, field=name, expected=f"one for each of {count} boxes", got=str(len(flat)))
    return flat


def _has_neighbour(tokens: list[str], at_row: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(N,) bool, whether the row before or after has the same track."""
    tracks = np.unique(tokens, return_inverse=True)[1]
    order = np.lexsort((at_row, tracks))
    joined = (np.diff(tracks[order]) == 0) & (np.diff(at_row[order]) == 1)
    beside = np.zeros(len(tokens), dtype=bool)
    beside[order[1:]] |= joined
    beside[order[:-1]] |= joined
    return beside


def _track(
    token: str,
    rows: NDArray[np.int64],
    object_class: str,
    at_ns: NDArray[np.int64],
    boxes: NDArray[np.float64],
    velocities: NDArray[np.float64],
    trajectory: Trajectory,
    table: LogTable,
) -> Track:
    times_ns, own = at_ns[rows], boxes[rows]
    if (np.diff(times_ns) <= 0).any() or not np.isfinite(own).all() or not (own[:, 7:] > 0).all():
        expected = "finite boxes of positive size, one at a time"
        raise DataError(table.path, field=f"track {token[:60]}", expected=expected, got="another")
    world_from_object = Rotation.from_quat(own[:, 3:7], scalar_first=True).as_matrix()
    velocities_world = np.where(np.isfinite(velocities[rows]), velocities[rows], world_velocities(times_ns, own[:, :3]))
    yaw_rates_radps = world_yaw_rates(times_ns, world_from_object)
    states = []
    for i, time_ns in enumerate(times_ns.tolist()):
        vehicle_from_world = trajectory.world_from_vehicle(time_ns).inverse()
        box: RigidTransform = vehicle_from_world @ pose(own[i, :7])
        states.append(
            ObjectState(
                timestamp_ns=time_ns,
                shape=Cuboid(vehicle_from_object=box, size_m=own[i, 7:]),
                velocity_mps=vehicle_from_world.rotate(velocities_world[i]),
                yaw_rate_radps=float(yaw_rates_radps[i]),
            )
        )
    return Track(track_id=token, object_class=object_class, states=tuple(states))
