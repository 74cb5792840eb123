"""Inputs of the network for every pair of a data set, computed once and stored as memory-mapped arrays of bytes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.api.datasets import Frame, open_dataset
from bench.atomic import make_folder, replacing, write_text
from bench.errors import DataError
from bench.execution import FailedTask, local_executor
from bench.methods.learned import inputs
from bench.recordings import load_card
from bench.training.pairs import Part, drives_of, pairs_of

TARGET = "moving"  # the last channel: share of moving pixels of each cell, 0 to 255
EVERY = 2  # of a drive's pairs: neighbours teach little that is new
INDEX = "drives.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class PreparedDrive:
    """The pairs of one drive and camera.

    Attributes:
        recording: name of the drive.
        camera: name of the camera.
        file: of the arrays.
        pairs: how many.
    """

    recording: str
    camera: str
    file: Path
    pairs: int

    def arrays(self) -> NDArray[np.uint8]:
        """(pairs, channels + 1, h, w) uint8, read-only, mapped from disk: `inputs.ALL_CHANNELS`, then the target."""
        return np.asarray(np.load(self.file, mmap_mode="r"))


def prepare(
    dataset: str | Path, part: Part, folder: Path, *, workers: int, progress: Callable[[int, int], None]
) -> list[PreparedDrive]:
    """Prepare the drives of one part of a data set that are not prepared yet.

    Args:
        dataset: a rendered data set, by name or card; it is rendered first where it is missing.
        part: of the data set, see `training_pairs`.
        folder: of the arrays; one folder below it for each version of the inputs.
        workers: processes.
        progress: called with the numbers of prepared and of all drives.

    Returns:
        Every drive and camera, in order.

    Raises:
        DataError: the data cannot be used.
    """
    names = drives_of(dataset, part, workers=workers)
    place = folder / _version(dataset)
    make_folder(place)
    missing = [name for name in names if not _index(place, name).is_file()]
    progress(len(names) - len(missing), len(names))
    with local_executor(workers) as executor:
        done = executor.compute(partial(_prepare_drive, dataset=dataset, place=place), missing)
        for count, (name, outcome) in enumerate(done, start=len(names) - len(missing) + 1):
            if isinstance(outcome, FailedTask):
                raise DataError(name, expected="a drive that can be prepared", got=outcome.reason)
            progress(count, len(names))
    return [drive for name in names for drive in _prepared(place, name)]


def _prepare_drive(name: str, *, dataset: str | Path, place: Path) -> None:
    found = {}
    for camera, frames in groupby(pairs_of(open_dataset(dataset), [name], every=EVERY), key=lambda frame: frame.camera):
        arrays = np.stack([_channels_and_target(frame) for frame in frames])
        with replacing(_arrays(place, name, camera)) as file, file.open("wb") as stream:
            np.save(stream, arrays)
        found[camera] = len(arrays)
    write_text(_index(place, name), json.dumps(found) + "\n")


def _channels_and_target(frame: Frame) -> NDArray[np.uint8]:
    pair = inputs.working_pair(frame.input)
    channels = inputs.network_input(pair, inputs.ALL_CHANNELS)
    assert frame.exact is not None
    size = pair.valid.shape[1], pair.valid.shape[0]
    share = cv2.resize(frame.exact.astype(np.uint8) * 255, size, interpolation=cv2.INTER_AREA)
    return np.concatenate([channels, share[None]])


def _prepared(place: Path, name: str) -> Iterator[PreparedDrive]:
    content: dict[str, int] = json.loads(_index(place, name).read_text(encoding="utf-8"))
    for camera, pairs in content.items():
        yield PreparedDrive(recording=name, camera=camera, file=_arrays(place, name, camera), pairs=pairs)


def _index(place: Path, name: str) -> Path:
    return place / f"{name}.json"


def _arrays(place: Path, name: str, camera: str) -> Path:
    return place / f"{name}-{camera}.npy"


def _version(dataset: str | Path) -> str:
    """Digest of what decides the arrays: the data set's scenario and all code that channels are made of."""
    scenario = load_card(dataset).scenario
    package = Path(inputs.__file__).parents[2]
    parts = [package / part for part in ("cameras", "flow", "geometry", "methods/rigid_scene", "methods/spherical")]
    digest = hashlib.sha256(f"{dataset} {EVERY}".encode() + (b"" if scenario is None else scenario.read_bytes()))
    for file in (Path(inputs.__file__), *sorted(path for part in parts for path in part.rglob("*.py"))):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]
