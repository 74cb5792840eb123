"""One pass over a folder of predictions: which image has which prediction, and all that is wrong."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Literal, NamedTuple

from bench.errors import BenchError, DataError
from bench.methods.predictions.maps import STATEMENT, ImageSizes, Prediction
from bench.plain_yaml import parse_yaml
from bench.recordings import DatasetCard, RecordingHandle, frame_gaps, open_dataset
from bench.recordings.files import read_text
from bench.recordings.validation import FileModel, validated

LARGEST_STATEMENT_BYTES = 100_000


class FolderStatement(FileModel):
    """`predictions.yaml` of a folder of predictions.

    Attributes:
        sixteen_bits: "score" where the PNG files have 16 bits and hold scores, 0 to 65535 for 0 to 1.
    """

    sixteen_bits: Literal["score"] | None = None


def read_statement(root: Path) -> FolderStatement:
    """What a folder says of its predictions; nothing without a file.

    Raises:
        DataError: there is no such folder, or its file says something else.
    """
    if not root.is_dir():
        raise DataError(root, expected="a folder of predictions", got="no such folder")
    file = root / STATEMENT
    if not file.exists():
        return FolderStatement()
    content = parse_yaml(read_text(file, largest_bytes=LARGEST_STATEMENT_BYTES), file=file)
    return validated(FolderStatement, content or {}, file=file)


class FaultKind(StrEnum):
    """Kinds of faults, in the order of reports."""

    MISSING = "missing"
    UNUSABLE = "unusable"
    TWICE = "twice"
    EXTRA = "extra"


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One thing that is wrong.

    Attributes:
        kind: of fault.
        place: the file relative to the folder of predictions, or the image that has none.
        reason: what was expected and what was found.
    """

    kind: FaultKind
    place: str
    reason: str


class ImageKey(NamedTuple):
    """An image of a data set; it sorts by recording, camera and time."""

    recording: str
    camera: str
    timestamp_ns: int

    def __str__(self) -> str:
        return f"{self.recording}/{self.camera}/{self.timestamp_ns}"


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictionIndex:
    """A folder of predictions, gone through.

    Attributes:
        form: of all predictions, as the folder says.
        predictions: of all images that will be scored; one without files is missing.
        usable: images whose prediction can be read.
        faults: all that is wrong, by kind and place.
        unscored: predictions of images that are not scored: first ones, those after a gap, excluded ones.
        elsewhere: files of recordings that are not of the split, excluded, or cannot be opened.
        largest: value of all usable predictions, in [0, 1].
        digest: SHA-256 over the usable predictions' images and the content of their files.
    """

    form: Literal["mask", "score"]
    predictions: Mapping[ImageKey, Prediction]
    usable: frozenset[ImageKey]
    faults: tuple[Fault, ...]
    unscored: int
    elsewhere: int
    largest: float
    digest: str

    @property
    def expected(self) -> int:
        """Images that need a prediction."""
        return len(self.predictions)

    def of_kind(self, kind: FaultKind) -> tuple[Fault, ...]:
        """The faults of a kind."""
        return tuple(fault for fault in self.faults if fault.kind is kind)


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedImage:
    """An image and where its prediction may lie.

    Attributes:
        key: recording, camera and time.
        places: files of predictions relative to the folder, without the suffix.
        sizes: of the image.
        is_scored: it will be: not excluded, with an image before it and no gap between.
        is_annotated: it is there to be scored and somebody knows what moves in it.
    """

    key: ImageKey
    places: tuple[str, ...]
    sizes: ImageSizes
    is_scored: bool
    is_annotated: bool


def named_images(handle: RecordingHandle, *, alone: bool) -> Iterator[NamedImage]:
    """The images of a recording, excluded ones included, by camera and time.

    Args:
        handle: of the recording.
        alone: the data set has no other recording, so that the recording's folder may be left out.

    Raises:
        DataError: the recording cannot be opened.
    """
    whole = replace(handle, exclusions=()).open()
    included = {
        name: [ref for i, ref in enumerate(refs) if not any(e.covers(i, ref.timestamp_ns) for e in handle.exclusions)]
        for name, refs in whole.images.items()
    }
    remaining = replace(whole, images={name: tuple(refs) for name, refs in included.items()})
    for name, camera in sorted(whole.cameras.items()):
        late = frame_gaps(remaining, name)
        followed_ns = {ref.timestamp_ns for i, ref in enumerate(included[name]) if i >= 1 and i not in late}
        included_ns = {ref.timestamp_ns for ref in included[name]}
        folders = dict.fromkeys((f"{whole.name}/{name}", *([name] if alone else ())))
        for ref in whole.images[name]:
            time_ns = ref.timestamp_ns
            names = dict.fromkeys((ref.path.stem, str(time_ns)))
            yield NamedImage(
                key=ImageKey(whole.name, name, time_ns),
                places=tuple(f"{folder}/{name}" for folder in folders for name in names),
                sizes=ImageSizes(
                    evaluated_px=(camera.model.width, camera.model.height),
                    stored_px=(camera.stored_size_px[0], camera.stored_size_px[1]),
                ),
                is_scored=time_ns in followed_ns,
                is_annotated=time_ns in included_ns and whole.annotated.covers(time_ns),
            )


class Pairing:
    """The files of a folder, taken image by image.

    Args:
        root: the folder; hidden files are passed over, links to folders not followed.

    Raises:
        DataError: there is no such folder, or its statement is none.
    """

    def __init__(self, root: Path) -> None:
        self._root, self._statement = root, read_statement(root)
        self._files = defaultdict[str, list[Path]](list)  # by place, without the suffix; those that are not yet taken
        self._faults: list[Fault] = []
        self._predictions: dict[ImageKey, Prediction] = {}
        self._usable: set[ImageKey] = set()
        self._unscored, self._largest, self._digest = 0, 0.0, hashlib.sha256()
        self.is_annotated = False
        for path in sorted(root.rglob("*")):
            place = path.relative_to(root)
            is_hidden = any(part.startswith(".") for part in place.parts)
            if is_hidden or place.as_posix() == STATEMENT or (path.is_dir() and not path.is_symlink()):
                continue
            if path.suffix.lower() == ".png":
                self._files[place.with_suffix("").as_posix()].append(path)
            else:
                self._fault(FaultKind.EXTRA, place.as_posix(), "no .png")

    def take(self, image: NamedImage) -> None:
        """Take and read the prediction of an image."""
        self.is_annotated |= image.is_annotated
        files = tuple(file for place in image.places for file in self._files.pop(place, ()))
        if not image.is_scored:
            self._unscored += bool(files)
            return
        are_scores = self._statement.sixteen_bits == "score"
        prediction = Prediction(root=self._root, files=files, sizes=image.sizes, are_scores=are_scores)
        self._predictions[image.key] = prediction
        try:
            content = prediction.content()
            self._largest = max(self._largest, float(prediction.values(content).max()))
        except DataError as error:
            reason = f"expected {error.expected}, got {error.got}" + (f"; {error.hint}" if error.hint else "")
            if len(files) == 1:
                self._fault(FaultKind.UNUSABLE, self._relative(files[0]), reason)
            else:
                self._fault(FaultKind.TWICE if files else FaultKind.MISSING, str(image.key), reason)
        else:
            self._usable.add(image.key)
            self._digest.update(f"{image.key}:{hashlib.sha256(content).hexdigest()}\n".encode())

    def index(self, *, others: Collection[str]) -> PredictionIndex:
        """All that was found; files of no image are faults, those of other recordings are counted.

        Args:
            others: recordings of the data set that are not scored.

        Raises:
            DataError: nothing names an image that is scored.
        """
        elsewhere = 0
        for place, files in self._files.items():
            if any(place.startswith(f"{name}/") for name in others):
                elsewhere += len(files)
                continue
            for file in files:
                reason = "its recording, camera and name are of no image of the data set"
                self._fault(FaultKind.EXTRA, self._relative(file), reason)
        if not any(prediction.files for prediction in self._predictions.values()):
            extra = [fault.place for fault in self._faults if fault.kind is FaultKind.EXTRA]
            got = f"{len(extra)} files and none of them does, the first {min(extra)}" if extra else "no file that does"
            expected = "predictions that name images that are scored"
            if self._predictions:
                expected += f", such as {next(iter(self._predictions))}.png"
            raise DataError(self._root, expected=expected, got=got)
        order = list(FaultKind)
        return PredictionIndex(
            form=self._statement.sixteen_bits or "mask",
            predictions=self._predictions,
            usable=frozenset(self._usable),
            faults=tuple(sorted(self._faults, key=lambda fault: (order.index(fault.kind), fault.place))),
            unscored=self._unscored,
            elsewhere=elsewhere,
            largest=self._largest,
            digest=self._digest.hexdigest(),
        )

    def _relative(self, file: Path) -> str:
        return file.relative_to(self._root).as_posix()

    def _fault(self, kind: FaultKind, place: str, reason: str) -> None:
        self._faults.append(Fault(kind=kind, place=place, reason=reason))


def index_predictions(
    root: Path,
    card: DatasetCard,
    *,
    split: str | None = None,
    progress: Callable[[float, int], None] | None = None,
) -> PredictionIndex:
    """Pair the files of a folder with the images of a data set and read every one of them once.

    Args:
        root: the folder.
        card: the data set.
        split: of the data set; None for all of it.
        progress: called with the recordings done, fractions included, and their number.

    Raises:
        DataError: no such folder, no recording can be opened, no image is annotated, or nothing in the folder names an
            image that is scored.
    """
    pairing = Pairing(root)
    handles = open_dataset(card, split)
    everywhere = {handle.name for handle in open_dataset(card)} | {e.recording for e in card.content.exclusions}
    opened, unopened, images = set[str](), None, list[NamedImage]()
    for number, handle in enumerate(handles):
        try:
            images = list(named_images(handle, alone=len(everywhere) == 1))
        except BenchError as error:
            unopened = unopened or error
            continue  # the run lists it; its files count as of elsewhere
        opened.add(handle.name)
        for done, image in enumerate(images, start=1):
            pairing.take(image)
            if progress is not None:
                progress(number + done / len(images), len(handles))
    if not opened and unopened is not None:
        raise unopened  # else its predictions would be told to name nothing
    if opened and not pairing.is_annotated:
        hint = "annotate some first (annotations/README.md)"
        raise DataError(card.file, field="annotations", expected="an annotated image", got="none", hint=hint)
    return pairing.index(others=everywhere - opened)
