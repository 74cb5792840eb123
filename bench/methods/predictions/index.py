"""One pass over a folder of predictions: which image has which prediction, and all that is wrong."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from bench.errors import BenchError, DataError
from bench.methods.predictions.faults import Fault, FaultKind
from bench.methods.predictions.folder import PredictionFiles, list_predictions
from bench.methods.predictions.images import CameraImages, ImageKey, camera_images
from bench.methods.predictions.names import Naming
from bench.methods.predictions.pairing import Form, Pairing
from bench.methods.predictions.reading import Prediction
from bench.recordings import DatasetCard, open_dataset

LARGEST_BYTE = 255 / 65535  # 16-bit scores that go no further were likely meant to have 8 bits


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
        fingerprint: SHA-256 over the usable predictions' images and the content of their files.
    """

    form: Form
    expected: int
    usable: Mapping[ImageKey, Prediction]
    faulty: Mapping[ImageKey, DataError]
    faults: tuple[Fault, ...]
    unscored: int
    elsewhere: int
    unread: tuple[str, ...]
    fingerprint: str

    def of_kind(self, kind: FaultKind) -> tuple[Fault, ...]:
        """The faults of a kind."""
        return tuple(fault for fault in self.faults if fault.kind is kind)


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
        DataError: no such folder, nothing in it names an image, masks and scores together, or scores on a scale of
            8 bits in files of 16.
        UsageError: names that may be times or frame numbers.
    """
    files = list_predictions(root)
    handles = open_dataset(card, split)
    everywhere = {handle.name for handle in open_dataset(card)} | {e.recording for e in card.content.exclusions}
    pairing = Pairing(files=files, naming=naming, alone=len(everywhere) == 1)
    opened, example = set[str](), ""
    for number, handle in enumerate(handles):
        try:
            cameras = list(camera_images(handle, history=history))
        except BenchError:
            continue  # the run lists it; its files count as of elsewhere
        opened.add(handle.name)
        example = example or _example(cameras)
        for share, camera in enumerate(cameras):
            pairing.take(camera)
            if progress is not None:
                progress(number + (share + 1) / len(cameras), len(handles))
        pairing.end_recording(handle.name, cameras)
    elsewhere = pairing.end_folder(everywhere - opened)
    if not (pairing.usable or pairing.faulty or pairing.unread):
        _refuse_strangers(files, pairing, example)
    _refuse_mixture(files, pairing)
    order = list(FaultKind)
    return PredictionIndex(
        form="score" if pairing.first_of["score"] else "mask",
        expected=pairing.expected,
        usable=pairing.usable,
        faulty=pairing.faulty,
        faults=tuple(sorted(pairing.faults, key=lambda fault: (order.index(fault.kind), fault.place))),
        unscored=pairing.unscored,
        elsewhere=elsewhere,
        unread=tuple(map(files.relative, pairing.unread)),
        fingerprint=pairing.fingerprint(),
    )


def _example(cameras: list[CameraImages]) -> str:
    return next((str(camera.key(image)) for camera in cameras for image in camera.images if image.scored), "")


def _refuse_strangers(files: PredictionFiles, pairing: Pairing, example: str) -> None:
    names = [fault.place for fault in pairing.faults if fault.kind is FaultKind.EXTRA]
    got = f"{len(names)} files and none of them does, the first {names[0]}" if names else "no file that does"
    raise DataError(
        files.root, expected=f"predictions that name images that are scored, such as {example}.png", got=got
    )


def _refuse_mixture(files: PredictionFiles, pairing: Pairing) -> None:
    mask, score = pairing.first_of["mask"], pairing.first_of["score"]
    if mask and score:
        got = f"both, for example the mask {mask} and the score {score}"
        raise DataError(files.root, expected="masks only or scores only", got=got)
    if 0 < pairing.largest_of_16_bits <= LARGEST_BYTE:
        raise DataError(
            files.root,
            expected="16-bit scores of 0 to 65535",
            got=f"{round(pairing.largest_of_16_bits * 65535)} as the largest of all",
            do="multiply scores of 0 to 255 by 257, or write masks as 8-bit PNG",
        )
