"""One pass over a folder of predictions: which image has which prediction, and all that is wrong."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Literal, NamedTuple

from bench.errors import BenchError, DataError
from bench.methods.predictions.maps import STATEMENT, ImageSizes, Prediction
from bench.plain_text import listed
from bench.plain_yaml import parse_yaml
from bench.recordings import DatasetCard, Exclusion, Recording, open_dataset
from bench.recordings.files import read_text
from bench.recordings.validation import FileModel, validated
from bench.records.recording import NOT_ANNOTATED, frame_gaps

LARGEST_STATEMENT_BYTES = 100_000


class FolderStatement(FileModel):
    """`predictions.yaml` of a folder of predictions.

    Attributes:
        sixteen_bits: "score" where the PNG files have 16 bits and hold scores, 0 to 65535 for 0 to 1.
    """

    sixteen_bits: Literal["score"] | None = None


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
class NamedImage:
    """An image and where its prediction may lie.

    Attributes:
        key: recording, camera and time.
        places: files of predictions relative to the folder, without the suffix.
        sizes: of the image.
        is_scored: it will be: not excluded, with an image before it and no gap between.
    """

    key: ImageKey
    places: tuple[str, ...]
    sizes: ImageSizes
    is_scored: bool


def named_images(whole: Recording, exclusions: Sequence[Exclusion], *, alone: bool) -> Iterator[NamedImage]:
    """The images of a recording, excluded ones included, by camera and time.

    Args:
        whole: the recording, with excluded images.
        exclusions: of the card.
        alone: the data set has no other recording, so that the recording's folder may be left out.
    """
    included = {
        name: tuple(ref for i, ref in enumerate(refs) if not any(e.covers(i, ref.timestamp_ns) for e in exclusions))
        for name, refs in whole.images.items()
    }
    remaining = replace(whole, images=included)
    for name, camera in sorted(whole.cameras.items()):
        late = frame_gaps(remaining, name)
        followed_ns = {ref.timestamp_ns for i, ref in enumerate(included[name]) if i >= 1 and i not in late}
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
            )


class PredictionIndex:
    """A folder of predictions, from which images take theirs one by one.

    Args:
        root: the folder; hidden files are passed over, links to folders not followed.

    Attributes:
        form: "mask" or "score", of all predictions, as the folder says.
        predictions: of all images that will be scored; one without files is missing.
        usable: SHA-256 of the file of each image whose prediction can be read.
        faults: all that is wrong.
        unscored: predictions of images that are not scored: first ones, those after a gap, excluded ones.
        elsewhere: files of recordings that are not of the split, excluded, or cannot be opened.
        largest: value of all usable predictions, in [0, 1].

    Raises:
        DataError: there is no such folder, or its statement is none.
    """

    def __init__(self, root: Path) -> None:
        if not root.is_dir():
            raise DataError(root, expected="a folder of predictions", got="no such folder")
        self._root, file = root, root / STATEMENT
        stated = parse_yaml(read_text(file, largest_bytes=LARGEST_STATEMENT_BYTES), file=file) if file.exists() else {}
        self.form = validated(FolderStatement, stated, file=file).sixteen_bits or "mask"
        self.predictions: dict[ImageKey, Prediction] = {}
        self.usable: dict[ImageKey, str] = {}
        self.faults: list[Fault] = []
        self.unscored, self.elsewhere, self.largest = 0, 0, 0.0
        self._files = defaultdict[str, list[Path]](list)  # by place, without the suffix; those that are not yet taken
        for path in sorted(root.rglob("*")):
            place = path.relative_to(root)
            is_hidden = any(part.startswith(".") for part in place.parts)
            if is_hidden or place.as_posix() == STATEMENT or (path.is_dir() and not path.is_symlink()):
                continue
            if path.suffix.lower() == ".png":
                self._files[place.with_suffix("").as_posix()].append(path)
            else:
                self._fault(FaultKind.EXTRA, path, "no .png")

    @property
    def expected(self) -> int:
        """Images that need a prediction."""
        return len(self.predictions)

    @property
    def digest(self) -> str:
        """SHA-256 over the usable predictions' images and the content of their files."""
        lines = (f"{key}:{digest}\n" for key, digest in self.usable.items())
        return hashlib.sha256("".join(lines).encode()).hexdigest()

    def of_kind(self, kind: FaultKind) -> list[Fault]:
        """The faults of a kind, by place."""
        return sorted((fault for fault in self.faults if fault.kind is kind), key=lambda fault: fault.place)

    def take(self, image: NamedImage) -> None:
        """Take and read the prediction of an image."""
        files = tuple(file for place in image.places for file in self._files.pop(place, ()))
        if not image.is_scored:
            self.unscored += bool(files)
            return
        prediction = Prediction(root=self._root, files=files, sizes=image.sizes, are_scores=self.form == "score")
        self.predictions[image.key] = prediction
        try:
            content = prediction.content()
            self.largest = max(self.largest, float(prediction.values(content).max()))
        except DataError as error:
            reason = f"expected {error.expected}, got {error.got}" + (f"; {error.hint}" if error.hint else "")
            if len(files) == 1:
                self._fault(FaultKind.UNUSABLE, files[0], reason)
            else:
                self._fault(FaultKind.TWICE if files else FaultKind.MISSING, image.key, reason)
        else:
            self.usable[image.key] = hashlib.sha256(content).hexdigest()

    def close(self, *, others: Collection[str]) -> None:
        """Tell files that no image took: those of other recordings are counted, the rest are faults.

        Args:
            others: recordings of the data set that are not scored.

        Raises:
            DataError: nothing names an image that is scored.
        """
        for place, files in self._files.items():
            if any(place.startswith(f"{name}/") for name in others):
                self.elsewhere += len(files)
                continue
            for file in files:
                self._fault(FaultKind.EXTRA, file, "its recording, camera and name are of no image of the data set")
        if not any(prediction.files for prediction in self.predictions.values()):
            got = listed([fault.place for fault in self.of_kind(FaultKind.EXTRA)], most=1) or "no file"
            example = f", such as {next(iter(self.predictions))}.png" if self.predictions else ""
            raise DataError(self._root, expected=f"predictions that name images that are scored{example}", got=got)

    def _fault(self, kind: FaultKind, place: Path | ImageKey, reason: str) -> None:
        shown = place.relative_to(self._root).as_posix() if isinstance(place, Path) else str(place)
        self.faults.append(Fault(kind=kind, place=shown, reason=reason))


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
    index, handles = PredictionIndex(root), open_dataset(card, split)
    everywhere = {handle.name for handle in open_dataset(card)} | {e.recording for e in card.content.exclusions}
    opened, unopened, is_annotated = set[str](), None, False
    for number, handle in enumerate(handles):
        try:
            whole = replace(handle, exclusions=()).open()
        except BenchError as error:
            unopened = unopened or error
            continue  # the run lists it; its files count as of elsewhere
        opened.add(handle.name)
        is_annotated |= whole.annotated != NOT_ANNOTATED
        images = list(named_images(whole, handle.exclusions, alone=len(everywhere) == 1))
        for done, image in enumerate(images, start=1):
            index.take(image)
            if progress is not None:
                progress(number + done / len(images), len(handles))
    if not opened and unopened is not None:
        raise unopened  # else its predictions would be told to name nothing
    if opened and not is_annotated:
        hint = "annotate some first (annotations/README.md)"
        raise DataError(card.file, field="annotations", expected="an annotated image", got="none", hint=hint)
    index.close(others=everywhere - opened)
    return index
