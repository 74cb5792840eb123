"""`.label` files in the layout of SemanticKITTI: the points that move, as segmenters of moving points write them.

A label says of each point whether it moved, and perhaps as what and as which instance. Points without an instance are
grouped by proximity, and the groups followed from sweep to sweep. Labels hold no velocity: it is estimated from the
middles of the points.

Source:
    config/semantic-kitti-mos.yaml and auxiliary/laserscan.py of the data set's API.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from bench.annotation.formats.conversion import (
    LabelFormat,
    LabelOptions,
    Observation,
    ToolLabels,
    lost_lines,
    pair_with_sweeps,
)
from bench.atomic import refuse_escape
from bench.errors import DataError
from bench.recordings import ObjectState, PointIndices, Recording, SweepRef
from bench.recordings.files import read_whole
from bench.reference.sweeps import pose_sweep

MOVING = {  # number -> name and our class; 251 is "moving" alone, whose class is for the user to say
    251: "moving",
    252: "moving-car", 253: "moving-bicyclist", 254: "moving-person", 255: "moving-motorcyclist",
    256: "moving-on-rails", 257: "moving-bus", 258: "moving-truck", 259: "moving-other-vehicle",
}  # fmt: skip
SUFFIX, FOLDERS = ".label", ("labels", "predictions")
INSTANCE_BITS = 16
NEIGHBOUR_M = 0.5  # points nearer than this belong together; people who walk abreast stay apart


class SemanticKitti(LabelFormat):
    """The moving points of SemanticKITTI's layout."""

    name = "semantickitti"
    description = "SemanticKITTI's moving points: labels/ or predictions/ with one .label for each sweep; read only"

    def read(self, source: Path, recording: Recording, options: LabelOptions) -> ToolLabels:
        """Read a sequence's labels; arguments and errors as in `LabelFormat`."""
        files = {file.stem: file for file in _label_files(source)}
        frames = pair_with_sweeps(files, recording, options, source=source)
        passed: Counter[int] = Counter()
        observations = [o for stem, ref in frames.items() for o in _moving_objects(files[stem], ref, recording, passed)]
        other = {f"points of label {number}, which does not say moving": passed[number] for number in sorted(passed)}
        return ToolLabels(
            observations=observations,
            timestamps_ns=[sweep.timestamp_ns for sweep in frames.values()],
            lost=lost_lines(other),
        )


def _label_files(source: Path) -> list[Path]:
    """By name; of the source, or of the folder in it that holds them.

    Raises:
        DataError: no such files, more than one of the folders, a link that leads out of `source`.
    """
    if not source.is_dir():
        got = "a file" if source.exists() else "nothing"
        raise DataError(source, expected=f"a folder of {SUFFIX} files", got=got)
    inner = [source / name for name in FOLDERS if (source / name).is_dir()]
    if len(inner) > 1:
        got = " and ".join(path.name for path in inner)
        raise DataError(source, expected="one folder of labels", got=got, hint="give the one that is meant")
    folder = inner[0] if inner else source
    files = sorted(path for path in folder.iterdir() if path.suffix == SUFFIX and not path.name.startswith("."))
    if not files:
        also = "".join(f" or {name}/" for name in FOLDERS)
        raise DataError(folder, expected=f"files <frame>{SUFFIX}, here{also}", got="none")
    for file in files:
        refuse_escape(source, file, file=file)
    return files


def _read_labels(file: Path, *, points: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Read a `.label` file: one little-endian uint32 for each point.

    Args:
        file: the file.
        points: number of rows of its sweep as it is stored, lost returns among them.

    Returns:
        labels: (N,) int64, the lower 16 bits.
        instances: (N,) int64, the upper 16 bits; 0 where a point belongs to no instance.

    Raises:
        DataError: missing, or not one number for each point.
    """
    content = read_whole(file)
    if len(content) != 4 * points:
        expected, got = f"{points} labels of 4 bytes, one for each point of its sweep", f"{len(content) / 4:g} labels"
        hint = "labels count in the sweep as it is stored: give those of the same, uncut sweeps"
        raise DataError(file, expected=expected, got=got, hint=hint)
    values = np.frombuffer(content, dtype="<u4").astype(np.int64)
    return values & ((1 << INSTANCE_BITS) - 1), values >> INSTANCE_BITS


def _moving_objects(file: Path, ref: SweepRef, recording: Recording, passed: Counter[int]) -> Iterator[Observation]:
    """The objects of one sweep; counts points of other labels in `passed`."""
    sweep = ref.read()
    times_ns = sweep.times_ns
    stored_rows = np.arange(len(sweep.points_lidar)) if sweep.stored_rows is None else sweep.stored_rows
    labels, instances = (of_all[stored_rows] for of_all in _read_labels(file, points=sweep.rows_stored))
    placed = pose_sweep(sweep, recording.trajectory, recording.vehicle_from_lidar)
    for label in np.unique(labels).tolist():
        rows = np.flatnonzero(labels == label)
        if label not in MOVING:
            passed[label] += len(rows)
            continue
        for instance in np.unique(instances[rows]).tolist():
            members = rows[instances[rows] == instance]
            groups = np.zeros(len(members)) if instance else near_groups(sweep.points_lidar[members])
            for group in np.unique(groups):
                of_object = members[groups == group]
                shape = PointIndices(indices=stored_rows[of_object], sweep_timestamp_ns=ref.timestamp_ns)
                later_ns = round(float((times_ns[of_object] - ref.timestamp_ns).mean()))
                yield Observation(
                    track=f"{MOVING[label]}-{instance}" if instance else "",
                    label=MOVING[label].removeprefix("moving-"),
                    state=ObjectState(timestamp_ns=ref.timestamp_ns, shape=shape, velocity_mps=np.full(3, np.nan)),
                    middle_m=np.full(3, np.nan) if placed is None else placed.points_world(of_object).mean(axis=0),
                    seen_ns=ref.timestamp_ns + later_ns,
                )


def near_groups(points: NDArray[np.floating]) -> NDArray[np.int64]:
    """Euclidean clustering: points that a chain of steps under half a metre joins are one group.

    Args:
        points: (N, 3), m.

    Returns:
        (N,) int64, number of the group of each point, from 0 on.
    """
    first, second = KDTree(points).query_pairs(NEIGHBOUR_M, output_type="ndarray").T
    near = coo_array((np.ones(len(first), dtype=bool), (first, second)), shape=(len(points), len(points)))
    return connected_components(near, directed=False)[1].astype(np.int64)
