"""Predictions and images, brought together by their names, camera by camera."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from numpy.typing import NDArray

from bench.errors import DataError
from bench.methods.predictions.faults import Fault, FaultKind, kind_of, reason_of
from bench.methods.predictions.folder import PredictionFiles
from bench.methods.predictions.images import CameraImages, ImageKey, NamedImage
from bench.methods.predictions.names import Naming, named_images
from bench.methods.predictions.reading import Prediction, PredictionReader
from bench.methods.predictions.run_lengths import MaskEntry

Form = Literal["mask", "score"]


@dataclass(kw_only=True)
class Pairing:
    """What comes together while cameras are taken in.

    Attributes:
        files: of the folder.
        naming: what the names are.
        alone: whether the data set has only one recording, whose folder may be left out.
        expected: images that will be scored.
        unscored: predictions of images that will not.
        usable: by image.
        faulty: by image, why its prediction cannot be used.
        faults: all that is wrong.
        first_of: the first file of each form.
        largest_of_16_bits: largest score of all 16-bit files.
        unread: files of many images that cannot be read.
    """

    files: PredictionFiles
    naming: Naming
    alone: bool
    expected: int = 0
    unscored: int = 0
    usable: dict[ImageKey, Prediction] = field(default_factory=dict)
    faulty: dict[ImageKey, DataError] = field(default_factory=dict)
    faults: list[Fault] = field(default_factory=list)
    first_of: dict[Form, str] = field(default_factory=lambda: {"mask": "", "score": ""})
    largest_of_16_bits: float = 0.0
    unread: list[Path] = field(default_factory=list)
    _digests: dict[Path, str] = field(default_factory=dict)
    _seen: set[Path] = field(default_factory=set)
    _reader: PredictionReader = field(default_factory=PredictionReader)

    def take(self, camera: CameraImages) -> None:
        """Pair and read the predictions of a camera.

        Raises:
            UsageError: names that may be times or frame numbers.
        """
        named = list(self._named(camera))
        images = named_images([name for name, _, _ in named], camera, naming=self.naming)
        sources: defaultdict[NamedImage, dict[Path, tuple[str, ...]]] = defaultdict(dict)
        for name, file, listed in named:
            if name not in images:
                self._extra(file, f"no image {name} of {camera.recording}/{camera.camera}")
                continue
            before = sources[images[name]].get(file, ())
            sources[images[name]][file] = (*before, name) if listed else ()
        for image in camera.images:
            if image.scored:
                self.expected += 1
                self._take_image(camera, image, sources.get(image, {}))
            else:
                self.unscored += image in sources

    def end_recording(self, recording: str, cameras: Sequence[CameraImages]) -> None:
        """List the entries of the recording's own file that name none of its cameras."""
        names = [camera.camera for camera in cameras]
        for file in self.files.lists.get(recording, []):
            for entry in (entry for entries in self._entries(file, camera_needed=True).values() for entry in entries):
                if entry.camera not in names:
                    self._extra(file, f"image {entry.name} names the camera {entry.camera!r}, which is not there")

    def end_folder(self, others: Collection[str]) -> int:
        """List the files that name no camera, and count those of other recordings.

        Args:
            others: recordings of the data set that are not scored.
        """
        elsewhere = 0
        for group in (self.files.maps, self.files.lists):
            for place, files in group.items():
                left = [file for file in files if file not in self._seen]
                if any(f"{place}/".startswith(f"{name}/") for name in others):
                    elsewhere += len(left)
                    continue
                for file in left:
                    self._extra(file, "its folder names no recording and camera of the data set")
        self.faults += self.files.faults
        return elsewhere

    def fingerprint(self) -> str:
        """SHA-256 over the usable predictions' images and the content of their files."""
        digest = hashlib.sha256()
        for key, prediction in sorted(self.usable.items()):
            digest.update(f"{key}:{self._digest(prediction.file)}\n".encode())
        return digest.hexdigest()

    def _named(self, camera: CameraImages) -> Iterator[tuple[str, Path, bool]]:
        """Name, file, and whether the file lists many images, of every prediction of a camera."""
        places = [f"{camera.recording}/{camera.camera}"]
        if self.alone and camera.camera != camera.recording:
            places.append(camera.camera)
        for place in places:
            for file in self.files.maps.get(place, []):
                self._seen.add(file)
                yield file.stem, file, False
            for file in self.files.lists.get(place, []):
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
        if file in self.unread:
            return {}
        try:
            entries = self._reader.entries(file)
            if camera_needed and any(entry.camera is None for of_image in entries.values() for entry in of_image):
                raise DataError(file, field="camera", expected="the name of a camera in every entry", got="one without")
        except DataError as error:
            self.unread.append(file)
            self._fault(FaultKind.UNREADABLE, self.files.relative(file), reason_of(error))
            return {}
        return entries

    def _take_image(self, camera: CameraImages, image: NamedImage, sources: Mapping[Path, tuple[str, ...]]) -> None:
        key = camera.key(image)
        if not sources:
            self._fault(FaultKind.MISSING, str(key), "no prediction")
        elif len(sources) > 1:
            got = " and ".join(map(self.files.relative, sources))
            self.faulty[key] = DataError(self.files.root, expected=f"one prediction of {key}", got=got)
            self._fault(FaultKind.TWICE, str(key), reason_of(self.faulty[key]))
        else:
            ((file, names),) = sources.items()
            prediction = Prediction(file=file, camera=camera.camera, names=names, sizes=camera.sizes)
            try:
                self._count(self._reader.read(prediction), prediction)
            except DataError as error:
                self.faulty[key] = error
                self._fault(kind_of(error), self.files.relative(file), reason_of(error))
            else:
                self.usable[key] = prediction

    def _count(self, values: NDArray[Any], prediction: Prediction) -> None:
        form: Form = "mask" if values.dtype == bool else "score"
        self.first_of[form] = self.first_of[form] or self.files.relative(prediction.file)
        if form == "score" and prediction.file.suffix.lower() == ".png":
            self.largest_of_16_bits = max(self.largest_of_16_bits, float(values.max()))

    def _digest(self, file: Path) -> str:
        if file not in self._digests:
            with file.open("rb") as content:
                self._digests[file] = hashlib.file_digest(content, "sha256").hexdigest()
        return self._digests[file]

    def _extra(self, file: Path, reason: str) -> None:
        self._fault(FaultKind.EXTRA, self.files.relative(file), reason)

    def _fault(self, kind: FaultKind, place: str, reason: str) -> None:
        self.faults.append(Fault(kind=kind, place=place, reason=reason))
