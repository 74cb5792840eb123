"""Images with those before them and exact masks of what moves, for any network; and the inputs of ours, prepared.

Prepared inputs are computed once and stored as memory-mapped arrays of bytes.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby, islice
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.atomic import make_folder, replacing, write_text
from bench.errors import DataError
from bench.execution import FailedTask, local_executor
from bench.harness.datasets import Frame, open_dataset
from bench.methods.learned import inputs
from bench.methods.rigid_scene.scene import Views
from bench.recordings import load_card
from bench.training import appearance

DATASET = "training"
VALIDATION = "validation"
SplitPart = Literal["training", "validation", "all"]


def training_pairs(
    dataset: str | Path = DATASET,
    *,
    part: SplitPart = "training",
    every: int = 1,
    longest_history: int = 1,
    colour: bool = False,
    workers: int = 1,
) -> Iterator[Frame]:
    """Images, each with the one before it and the exact mask of what moves.

    Args:
        dataset: a rendered data set, by name or card; it is rendered first where it is missing.
        part: the drives of the data set's split "validation", all others, or all. A drive is in one part as a whole.
        every: 1 for every pair of a drive and camera, 2 for every second and so on; neighbours differ little.
        longest_history: earlier images that come with each where a drive has as many; one at least.
        colour: images are BGR instead of grey.
        workers: processes that render.

    Returns:
        Frames in order of drive, camera and time. `Frame.input` holds both images, lens, road, motion of the camera and
        the valid region, all as NumPy arrays and records; `Frame.exact` is the mask, (H, W) bool.

    Raises:
        UnknownNameError: no data set of this name, or none with a split "validation".
        DataError: the data cannot be used, or have no exact masks.
    """
    names = drives_of(dataset, part, workers=workers)
    pairs = _pairs(dataset, names, longest_history=longest_history, colour=colour)
    for _, drive in groupby(pairs, key=lambda frame: (frame.recording, frame.camera)):
        yield from islice(drive, None, None, every)


def drives_of(dataset: str | Path, part: SplitPart, *, workers: int = 1) -> tuple[str, ...]:
    """Names of the drives of a part, as `training_pairs` divides them."""
    names = open_dataset(dataset, workers=workers).names
    if part == "all":
        return names
    held_out = set(open_dataset(dataset, VALIDATION).names)
    return tuple(name for name in names if (name in held_out) == (part == VALIDATION))


def _pairs(dataset: str | Path, names: Sequence[str], *, longest_history: int, colour: bool = False) -> Iterator[Frame]:
    data = open_dataset(dataset)
    # The reference is not used; that of paper-v1 takes least time.
    for frame in data.frames(
        protocol="paper-v1", recordings=names, longest_history=longest_history, colour=colour, exact=True
    ):
        if frame.exact is None:
            raise DataError(data.card.file, expected="exact masks, as rendered data have", got="none")
        yield frame


LEAST_PX = 50  # fine pixels that move, for an image to have an IoU in validation
GREY = ("current", "fine_current")  # the channels that show how the last image looks
DISTURBED = 0.75  # share of the images for which disturbances are drawn before anything is computed from them


@dataclass(frozen=True, slots=True, kw_only=True)
class PreparedDrive:
    """The images of one drive and camera.

    Attributes:
        recording: name of the drive.
        camera: name of the camera.
        folder: of the arrays.
        images: how many.
    """

    recording: str
    camera: str
    folder: Path
    images: int

    def coarse(self) -> NDArray[np.uint8]:
        """(images, C, h, w) uint8, read-only, mapped from disk: `inputs.COARSE`."""
        return self._array("coarse")

    def fine(self) -> NDArray[np.uint8]:
        """(images, F + 1, 2 h, 2 w) uint8, as above: `inputs.FINE`, then the share of moving pixels, 0 to 255."""
        return self._array("fine")

    def _array(self, size: str) -> NDArray[np.uint8]:
        return np.asarray(np.load(self.folder / _arrays(self.recording, self.camera, size), mmap_mode="r"))


def valid_region(coarse: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """The valid region of coarse channels, (C, h, w), at the size of the fine ones, (2 h, 2 w)."""
    return np.asarray(coarse[inputs.COARSE.index("valid")].repeat(2, axis=0).repeat(2, axis=1) > inputs.ZERO)


def vary(channels: NDArray[np.uint8], rows: Sequence[int], gain: float, shift: float = 0.0) -> None:
    """Scale some channels about 0, and shift them, in place."""
    varied = np.rint((np.arange(256) - inputs.ZERO) * gain + inputs.ZERO + shift)
    table = np.clip(varied, 0, 255).astype(np.uint8)
    for row in rows:
        channels[row] = cv2.LUT(channels[row], table)


def prepare(
    dataset: str | Path,
    part: SplitPart,
    folder: Path,
    *,
    disturbed: bool,
    workers: int,
    progress: Callable[[int, int], None],
) -> list[PreparedDrive]:
    """Prepare the drives of one part of a data set that are not prepared yet.

    Args:
        dataset: a rendered data set, by name or card; it is rendered first where it is missing.
        part: of the data set, as `training_pairs` divides it.
        folder: of the arrays; one folder below it for each version of the inputs.
        disturbed: images are those of worse cameras, see `bench.training.appearance`; else as they were rendered.
        workers: processes.
        progress: called with the numbers of prepared and of all drives.

    Returns:
        Every drive and camera, in order.

    Raises:
        DataError: the data cannot be used.
    """
    names = drives_of(dataset, part, workers=workers)
    place = folder / _version(dataset, disturbed=disturbed)
    make_folder(place)
    missing = [name for name in names if not _index(place, name).is_file()]
    progress(len(names) - len(missing), len(names))
    with local_executor(workers) as executor:
        task = partial(_prepare_drive, dataset=dataset, place=place, disturbed=disturbed)
        done = executor.compute(task, missing)
        for count, (name, outcome) in enumerate(done, start=len(names) - len(missing) + 1):
            if isinstance(outcome, FailedTask):
                raise DataError(name, expected="a drive that can be prepared", got=outcome.reason)
            progress(count, len(names))
    return [drive for name in names for drive in _prepared(place, name)]


def _prepare_drive(name: str, *, dataset: str | Path, place: Path, disturbed: bool) -> None:
    lengths = {}
    pairs = _pairs(dataset, [name], longest_history=inputs.BACK)
    frames = (frame for frame in pairs if len(frame.input.images) > 2)  # training itself leaves the earlier one out
    for camera, of_camera in groupby(frames, key=lambda frame: frame.camera):
        rng = np.random.default_rng(list(f"{name} {camera}".encode())) if disturbed else None
        coarse, fine = zip(*(_arrays_of(frame, rng) for frame in of_camera), strict=True)
        for size, arrays in (("coarse", coarse), ("fine", fine)):
            with replacing(place / _arrays(name, camera, size)) as file, file.open("wb") as stream:
                np.save(stream, np.stack(arrays))
        lengths[camera] = len(coarse)
    write_text(_index(place, name), json.dumps(lengths) + "\n")


def _arrays_of(frame: Frame, rng: np.random.Generator | None) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Coarse channels, and fine ones with the target."""
    given = frame.input
    if rng is not None and rng.random() < DISTURBED:
        given = replace(given, images=appearance.disturbed(given.images, rng))
    views = Views.of(given)
    channels = inputs.network_input(views)
    assert frame.exact is not None
    height, width = views.fine[-1].shape
    share = cv2.resize(frame.exact.astype(np.uint8) * 255, (width, height), interpolation=cv2.INTER_AREA)
    fine = np.concatenate([channels.fine, share[None]])
    rows, columns = channels.coarse.shape[1:]
    return channels.coarse, fine[:, : 2 * rows, : 2 * columns]


def _prepared(place: Path, name: str) -> Iterator[PreparedDrive]:
    content: dict[str, int] = json.loads(_index(place, name).read_text(encoding="utf-8"))
    for camera, images in content.items():
        yield PreparedDrive(recording=name, camera=camera, folder=place, images=images)


def _index(place: Path, name: str) -> Path:
    return place / f"{name}.json"


def _arrays(name: str, camera: str, size: str) -> str:
    return f"{name}-{camera}-{size}.npy"


def _version(dataset: str | Path, *, disturbed: bool) -> str:
    """Digest of what decides the arrays: the data set's scenario and all code that channels are made of."""
    scenario = load_card(dataset).scenario
    package = Path(inputs.__file__).parents[2]
    parts = [package / part for part in ("cameras", "flow", "methods/rigid_scene", "methods/spherical")]
    modules = [Path(inputs.__file__), package / "geometry.py"]
    files = modules + sorted(file for part in parts for file in part.rglob("*.py"))
    digest = hashlib.sha256(str(dataset).encode() + (b"" if scenario is None else scenario.read_bytes()))
    for file in files + [Path(appearance.__file__)] * disturbed:
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]
