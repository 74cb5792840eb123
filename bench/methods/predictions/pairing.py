"""One pass over a folder of predictions: which image has which prediction, and all that is wrong."""

from __future__ import annotations

import hashlib
import os
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bench.atomic import open_regular, refuse_escape
from bench.errors import BenchError, DataError
from bench.methods.predictions.files import (
    LARGEST_SCORE,
    STATEMENT,
    Fault,
    FaultKind,
    FolderStatement,
    MaskEntry,
    Prediction,
    PredictionReader,
    kind_of,
    read_statement,
    reason_of,
    shown_values,
)
from bench.methods.predictions.images import CameraImages, ImageKey, NamedImage, Naming, camera_images, named_images
from bench.recordings import DatasetCard, open_dataset

MAP_SUFFIXES = (".png", ".npz")
LIST_SUFFIX = ".json"
Group = dict[str, list[Path]]


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictionFiles:
    """Files of a folder of predictions.

    Attributes:
        root: the folder.
        statement: what it says of its files.
        maps: by folder relative to the root, with "/" in between, the files of single images.
        lists: by path relative to the root without the suffix, the files of many images; one each.
        faults: files that are no predictions.
    """

    root: Path
    statement: FolderStatement = field(default_factory=FolderStatement)
    maps: Group = field(default_factory=lambda: defaultdict(list))
    lists: Group = field(default_factory=lambda: defaultdict(list))
    faults: list[Fault] = field(default_factory=list)

    def relative(self, file: Path) -> str:
        """A file as messages name it."""
        return file.relative_to(self.root).as_posix()


def list_predictions(root: Path) -> PredictionFiles:
    """List the files below a folder; hidden ones are passed over, links to folders not followed.

    Raises:
        DataError: there is no such folder, or one below it cannot be read.
    """
    if not root.is_dir():
        raise DataError(root, expected="a folder of predictions", got="no such folder")
    found = PredictionFiles(root=root, statement=read_statement(root))

    def unreadable(error: OSError) -> None:
        raise DataError(error.filename or root, expected="a folder to read", got=error.strerror or str(error))

    for folder, subfolders, files in os.walk(root, onerror=unreadable):
        links = [name for name in subfolders if (Path(folder) / name).is_symlink()]
        subfolders[:] = sorted(name for name in subfolders if not name.startswith(".") and name not in links)
        for name in sorted([*files, *links]):
            if not name.startswith(".") and Path(folder, name) != root / STATEMENT:
                _sort_in(found, Path(folder) / name)
    return found


def _sort_in(found: PredictionFiles, path: Path) -> None:
    suffix = path.suffix.lower()
    if path.is_dir():
        reason = "a link to a folder, which is not followed"
    elif suffix not in (*MAP_SUFFIXES, LIST_SUFFIX):
        reason = "no .png, .npz or .json"
    elif not path.is_file():
        reason = "no regular file"
    else:
        try:
            refuse_escape(found.root, path, file=path)
        except DataError as error:
            reason = f"{error.got.split(', ')[-1]}, which is not read"
        else:
            if suffix == LIST_SUFFIX:
                found.lists[found.relative(path.with_suffix(""))].append(path)
            else:
                found.maps[found.relative(path.parent)].append(path)
            return
    found.faults.append(Fault(kind=FaultKind.EXTRA, place=found.relative(path), reason=reason))


Form = Literal["mask", "score"]
LARGEST_BYTE = 255  # 16-bit scores that go no further were likely meant to have 8 bits
FEW_SCORES = 32  # values of a whole folder; instances and classes have as few


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictionIndex:
    """A folder of predictions, gone through.

    Attributes:
        form: of all usable predictions; "mask" without any.
        expected: images that will be scored and so need a prediction.
        usable: predictions of these that can be read.
        faulty: by image, why its prediction cannot be used.
        faults: all that is wrong, by kind and place.
        unscored: predictions of images that are not scored: first ones, those after a gap, excluded ones.
        elsewhere: files of recordings that are not of the split, excluded, or cannot be opened.
        unread: files of many images that cannot be read, relative to the folder; which images they are of is unknown.
        largest: value of all usable predictions, in [0, 1].
        doubts: what is odd about the values of all predictions together.
        digest: SHA-256 over the usable predictions' images and the content of their files.
    """

    form: Form
    expected: int
    usable: Mapping[ImageKey, Prediction]
    faulty: Mapping[ImageKey, DataError]
    faults: tuple[Fault, ...]
    unscored: int
    elsewhere: int
    unread: tuple[str, ...]
    largest: float
    doubts: tuple[str, ...]
    digest: str

    def of_kind(self, kind: FaultKind) -> tuple[Fault, ...]:
        """The faults of a kind."""
        return tuple(fault for fault in self.faults if fault.kind is kind)


class Pairing:
    """Pairs the files of a folder with images and reads them, camera by camera.

    Args:
        files: of the folder.
        naming: what the names are.
        alone: whether the data set has only one recording, whose folder may be left out.
    """

    def __init__(self, files: PredictionFiles, *, naming: Naming, alone: bool) -> None:
        self.files, self._naming, self._alone = files, naming, alone
        self._expected = self._unscored = 0
        self._usable: dict[ImageKey, Prediction] = {}
        self._faulty: dict[ImageKey, DataError] = {}
        self._faults: list[Fault] = []
        self._first_of: dict[Form, str] = {"mask": "", "score": ""}
        self._scores = np.zeros(LARGEST_SCORE + 1, dtype=bool)  # that PNG files hold
        self._largest = 0.0
        self._unread: list[Path] = []
        self._digests: dict[Path, str] = {}
        self._seen: set[Path] = set()
        self._reader = PredictionReader()

    def take(self, camera: CameraImages) -> None:
        """Pair and read the predictions of a camera.

        Raises:
            UsageError: names that may be times or frame numbers.
        """
        named = list(self._named(camera))
        images = named_images(
            [name for name, _, _ in named],
            camera,
            naming=self._naming,
            first_frame=self.files.statement.first_frame,
        )
        sources: defaultdict[NamedImage, dict[Path, tuple[str, ...]]] = defaultdict(dict)
        for name, file, listed in named:
            if name not in images:
                self._extra(
                    file, f"no image {name} of {camera.recording}/{camera.camera}{_how_others_are_read(name, images)}"
                )
                continue
            before = sources[images[name]].get(file, ())
            sources[images[name]][file] = (*before, name) if listed else ()
        for image in camera.images:
            if image.scored:
                self._expected += 1
                self._take_image(camera, image, sources.get(image, {}))
            else:
                self._unscored += image in sources

    def end_recording(self, recording: str, cameras: Sequence[CameraImages]) -> None:
        """List the entries of the recording's own file that name none of its cameras."""
        names = [camera.camera for camera in cameras]
        for file in self.files.lists.get(recording, []):
            for entry in (entry for entries in self._entries(file, camera_needed=True).values() for entry in entries):
                if entry.camera not in names:
                    self._extra(file, f"image {entry.name} names the camera {entry.camera!r}, which is not there")

    def index(self, *, others: Collection[str], example: str) -> PredictionIndex:
        """All that was found; files that name no camera are faults, those of other recordings are counted.

        Args:
            others: recordings of the data set that are not scored.
            example: an image that is scored, as a prediction may name it.

        Raises:
            DataError: nothing names an image, masks and scores together, or scores on a scale of 8 bits in files of 16.
        """
        elsewhere = 0
        for group in (self.files.maps, self.files.lists):
            for folder, files in group.items():
                left = [file for file in files if file not in self._seen]
                if any(f"{folder}/".startswith(f"{name}/") for name in others):
                    elsewhere += len(left)
                    continue
                for file in left:
                    self._extra(file, "its folder names no recording and camera of the data set")
        self._faults += self.files.faults
        if not (self._usable or self._faulty or self._unread):
            self._refuse_unpaired(example)
        self._refuse_mixture()
        order = list(FaultKind)
        return PredictionIndex(
            form="score" if self._first_of["score"] else "mask",
            expected=self._expected,
            usable=self._usable,
            faulty=self._faulty,
            faults=tuple(sorted(self._faults, key=lambda fault: (order.index(fault.kind), fault.place))),
            unscored=self._unscored,
            elsewhere=elsewhere,
            unread=tuple(map(self.files.relative, self._unread)),
            largest=self._largest,
            doubts=tuple(self._doubts()),
            digest=self._whole_digest(),
        )

    def _whole_digest(self) -> str:
        """SHA-256 over the usable predictions' images and the content of their files."""
        digest = hashlib.sha256()
        for key, prediction in sorted(self._usable.items()):
            digest.update(f"{key}:{self._digest(prediction.file)}\n".encode())
        return digest.hexdigest()

    def _named(self, camera: CameraImages) -> Iterator[tuple[str, Path, bool]]:
        """Name, file, and whether the file lists many images, of every prediction of a camera."""
        folders = [f"{camera.recording}/{camera.camera}"]
        if self._alone and camera.camera != camera.recording:
            folders.append(camera.camera)
        for folder in folders:
            for file in self.files.maps.get(folder, []):
                self._seen.add(file)
                yield file.stem, file, False
            for file in self.files.lists.get(folder, []):
                for name, entries in self._entries(file).items():
                    if all(entry.is_of(camera.camera) for entry in entries):
                        yield name, file, True
                    else:
                        self._extra(file, f"image {name} names another camera than {camera.camera!r}")
        for file in self.files.lists.get(camera.recording, []):
            for name, entries in self._entries(file, camera_needed=True).items():
                if any(entry.camera == camera.camera for entry in entries):
                    yield name, file, True

    def _entries(self, file: Path, *, camera_needed: bool = False) -> Mapping[str, list[MaskEntry]]:
        """The entries of a file of many images; none, and a fault, where it cannot be read."""
        self._seen.add(file)
        if file in self._unread:
            return {}
        try:
            entries = self._reader.entries(file)
            if camera_needed and any(entry.camera is None for of_image in entries.values() for entry in of_image):
                raise DataError(file, field="camera", expected="the name of a camera in every entry", got="one without")
        except DataError as error:
            self._unread.append(file)
            self._fault(FaultKind.UNREADABLE, self.files.relative(file), reason_of(error))
            return {}
        return entries

    def _take_image(self, camera: CameraImages, image: NamedImage, sources: Mapping[Path, tuple[str, ...]]) -> None:
        key = camera.key(image)
        if not sources:
            self._fault(FaultKind.MISSING, str(key), "no prediction")
        elif len(sources) > 1:
            got = " and ".join(map(self.files.relative, sources))
            self._faulty[key] = DataError(self.files.root, expected=f"one prediction of {key}", got=got)
            self._fault(FaultKind.TWICE, str(key), reason_of(self._faulty[key]))
        else:
            ((file, names),) = sources.items()
            bits = self.files.statement.sixteen_bits
            prediction = Prediction(file=file, camera=camera.camera, names=names, sizes=camera.sizes, sixteen_bits=bits)
            try:
                self._count(self._reader.read(prediction), prediction)
            except DataError as error:
                self._faulty[key] = error
                self._fault(kind_of(error), self.files.relative(file), reason_of(error))
            else:
                self._usable[key] = prediction

    def _count(self, values: NDArray[Any], prediction: Prediction) -> None:
        form: Form = "mask" if values.dtype == bool else "score"
        self._first_of[form] = self._first_of[form] or self.files.relative(prediction.file)
        self._largest = max(self._largest, float(values.max()))
        if form == "score" and prediction.file.suffix.lower() == ".png":
            self._scores[np.rint(values * LARGEST_SCORE).astype(np.int64)] = True

    def _digest(self, file: Path) -> str:
        if file not in self._digests:
            with open_regular(file) as content:
                self._digests[file] = hashlib.file_digest(content, "sha256").hexdigest()
        return self._digests[file]

    def _extra(self, file: Path, reason: str) -> None:
        self._fault(FaultKind.EXTRA, self.files.relative(file), reason)

    def _fault(self, kind: FaultKind, place: str, reason: str) -> None:
        self._faults.append(Fault(kind=kind, place=place, reason=reason))

    def _refuse_unpaired(self, example: str) -> None:
        names = [fault.place for fault in self._faults if fault.kind is FaultKind.EXTRA]
        got = f"{len(names)} files and none of them does, the first {names[0]}" if names else "no file that does"
        expected = f"predictions that name images that are scored, such as {example}.png"
        raise DataError(self.files.root, expected=expected, got=got)

    def _refuse_mixture(self) -> None:
        mask, score = self._first_of["mask"], self._first_of["score"]
        if mask and score:
            got = f"both, for example the mask {mask} and the score {score}"
            raise DataError(self.files.root, expected="masks only or scores only", got=got)
        scores = np.flatnonzero(self._scores)
        if scores.any() and scores[-1] <= LARGEST_BYTE:
            raise DataError(
                self.files.root,
                expected="16-bit scores of 0 to 65535",
                got=f"{scores[-1]} as the largest of all",
                hint="multiply scores of 0 to 255 by 257, or write masks as 8-bit PNG",
            )

    def _doubts(self) -> Iterator[str]:
        if self._usable and not self._largest:
            yield f"{len(self._usable)} predictions, none of which marks anything"
        scores = np.flatnonzero(self._scores).tolist()
        if 2 < len(scores) <= FEW_SCORES:
            yield f"16-bit scores of {len(scores)} values alone ({shown_values(scores)}), as numbers of instances have"


def _how_others_are_read(name: str, images: Mapping[str, NamedImage]) -> str:
    """For a number that may have been meant in another way."""
    if not (name.isdigit() and images):
        return ""
    other, image = next(iter(images.items()))
    by_time = other.isdigit() and int(other) == image.timestamp_ns
    kind = "times" if by_time else "file names" if other in (image.file, Path(image.file).stem) else "frame numbers"
    return f"; the other names were read as {kind}"


def index_predictions(
    root: Path,
    card: DatasetCard,
    *,
    split: str | None = None,
    naming: Naming = "auto",
    history: int = 1,
    progress: Callable[[float, int], None] | None = None,
) -> PredictionIndex:
    """Pair the files of a folder with the images of a data set and read every one of them once.

    Args:
        root: the folder.
        card: the data set.
        split: of the data set; None for all of it.
        naming: what the names are.
        history: images that must lie before one that is scored.
        progress: called with the recordings done, fractions included, and their number.

    Raises:
        DataError: no such folder, no recording can be opened, no image is annotated, nothing in it names an image,
            masks and scores together, or scores on a scale of 8 bits in files of 16.
        UsageError: names that may be times or frame numbers.
    """
    files = list_predictions(root)
    handles = open_dataset(card, split)
    everywhere = {handle.name for handle in open_dataset(card)} | {e.recording for e in card.content.exclusions}
    pairing = Pairing(files, naming=naming, alone=len(everywhere) == 1)
    opened, example, annotated, unopened = set[str](), "", False, None
    for number, handle in enumerate(handles):
        try:
            cameras = list(camera_images(handle, history=history))
        except BenchError as error:
            unopened = unopened or error
            continue  # the run lists it; its files count as of elsewhere
        opened.add(handle.name)
        example = example or _example(cameras)
        annotated = annotated or any(camera.annotated for camera in cameras)
        for share, camera in enumerate(cameras):
            pairing.take(camera)
            if progress is not None:
                progress(number + (share + 1) / len(cameras), len(handles))
        pairing.end_recording(handle.name, cameras)
    if not opened and unopened is not None:
        raise unopened  # else its predictions would be told to name nothing
    if opened and not annotated:
        hint = "annotate some first (annotations/README.md)"
        raise DataError(card.file, field="annotations", expected="an annotated image", got="none", hint=hint)
    return pairing.index(others=everywhere - opened, example=example)


def _example(cameras: list[CameraImages]) -> str:
    return next((str(camera.key(image)) for camera in cameras for image in camera.images if image.scored), "")
