"""Open a data set and walk through its images, with what a method may see and the reference; and those of a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.errors import BenchError, UnknownNameError
from bench.evaluation.counts import count_frame
from bench.evaluation.protocol import load_protocol
from bench.harness.answers import is_answered, segmentation_of
from bench.harness.counts import read_counts
from bench.harness.exact import read_exact_mask
from bench.harness.frames import FramePipeline, InputOnly, ProcessedFrame, UnscorableFrame
from bench.harness.stored import StoredRun, find_answer
from bench.methods import MethodInput
from bench.recordings import DatasetCard, Recording, RecordingHandle, chosen_recordings, list_cards, load_card
from bench.recordings import open_dataset as list_recordings
from bench.recordings.cards import shipped_folder
from bench.records.reference import ReferenceFrame


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """One image of a recording.

    Attributes:
        recording: name.
        camera: name.
        timestamp_ns: time of exposure.
        input: what a method may see: this image and those before it, lens, road, motion of the camera, valid pixels.
        reference: what a mask of this image is scored against: labels, ignored and valid pixels, objects.
        exact: (H, W) bool, the exact pixels of all objects that move, evaluated or not; None where it was not asked for
            and where the data have none.
    """

    recording: str
    camera: str
    timestamp_ns: int
    input: MethodInput
    reference: ReferenceFrame
    exact: NDArray[np.bool_] | None = None

    @property
    def image(self) -> NDArray[np.uint8]:
        """The current image, (H, W) grey or (H, W, 3) BGR."""
        return self.input.images[-1]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Dataset:
    """The recordings of a data set, or of a split of it; iterating opens one after the other.

    Attributes:
        card: what the data set's card says.
        handles: its recordings, not opened yet.
    """

    card: DatasetCard
    handles: tuple[RecordingHandle, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the recordings."""
        return tuple(handle.name for handle in self.handles)

    def __len__(self) -> int:
        return len(self.handles)

    def __iter__(self) -> Iterator[Recording]:
        return (handle.open() for handle in self.handles)

    def __getitem__(self, name: str) -> Recording:
        """Open a recording.

        Raises:
            UnknownNameError: no recording of this name.
            DataError: it cannot be opened.
        """
        found = next((handle for handle in self.handles if handle.name == name), None)
        if found is None:
            raise UnknownNameError("recording", name, self.names)
        return found.open()

    def frames(
        self,
        *,
        protocol: str | Path = "surface-v1",
        recordings: Sequence[str] | None = None,
        camera: str | None = None,
        history: int = 1,
        longest_history: int = 0,
        colour: bool = False,
        exact: bool = False,
    ) -> Iterator[Frame]:
        """The images that a run would score, in order of recording, camera and time.

        Images without enough others before them are passed over.

        Args:
            protocol: of the reference, by name or file.
            recordings: names; None for all.
            camera: name; None for all.
            history: earlier images that `Frame.input` holds beside the current one.
            longest_history: earlier images that it holds where there are as many; 0 for no more than `history`.
            colour: read images in colour, BGR.
            exact: read the exact masks of rendered data.

        Raises:
            UnknownNameError: no recording, camera or protocol of this name.
            DataError: a recording or image that cannot be read.
        """
        looks = InputOnly(history=history, longest_history=longest_history, colour=colour)
        rules = load_protocol(protocol)
        for name in self.names if recordings is None else recordings:
            recording = self[name]
            if camera is not None and camera not in recording.cameras:
                raise UnknownNameError("camera", camera, recording.cameras)
            for chosen in recording.cameras if camera is None else (camera,):
                pipeline = FramePipeline(recording, chosen, method=looks, protocol=rules)
                yield from _frames(pipeline, history, exact=exact)


def open_dataset(dataset: str | Path, split: str | None = None, *, workers: int = 1) -> Dataset:
    """Open a data set, rendered first where its card names a scenario that is not rendered yet.

    Args:
        dataset: path of a card, or a name that `fisheye-bench list` shows.
        split: of the data set; None for all of it.
        workers: processes that render; more than one need `if __name__ == "__main__":` in a program.

    Raises:
        UnknownNameError: no card or split of this name.
        DataError: the card or its data cannot be used.
    """
    card = load_card(dataset)
    render_if_missing(card, split, workers=workers)
    return Dataset(card=card, handles=list_recordings(card, split))


def render_if_missing(
    card: DatasetCard,
    split: str | None,
    *,
    workers: int | None = None,
    progress: Callable[[float, int], None] | None = None,
) -> int:
    """Render what of a split a card's scenario asks for and is not there yet.

    Returns:
        How many recordings of the split are rendered then; 0 of data that are not.

    Raises:
        UnknownNameError: no such split, nor recordings of these names.
        DataError: the scenario is not one, or something else lies where a recording goes.
    """
    if card.scenario is None:
        return 0
    from bench.synthesis import read_scenario, synthesize  # a second, and recorded data need none of it

    known = [spec.name for spec in read_scenario(card.scenario).recordings]
    names, _ = chosen_recordings(card, split, known)
    return len(synthesize(card.scenario, card.root, only=names, workers=workers, progress=progress))


def _frames(pipeline: FramePipeline, history: int, *, exact: bool) -> Iterator[Frame]:
    for index in range(history, len(pipeline.images)):
        image = pipeline.images[index]
        if not image.scored:
            continue
        try:
            given, reference = pipeline.method_input(index), pipeline.reference(index)
        except UnscorableFrame:
            continue
        yield Frame(
            recording=pipeline.recording.name,
            camera=pipeline.camera.name,
            timestamp_ns=image.timestamp_ns,
            input=given,
            reference=reference,
            exact=read_exact_mask(image, pipeline.recording, reference) if exact else None,
        )


def shipped_card(name: str) -> DatasetCard | None:
    """The card of a data set that ships with the package; None where it is none of these."""
    return next((card for card in list_cards(shipped_folder()) if card.name == name), None)


def card_of_run(run: StoredRun) -> DatasetCard:
    """The card by which the data of a run are found: the one that it names, else the shipped one of this name.

    Raises:
        BenchError: neither can be read.
    """
    try:
        return load_card(run.manifest.dataset.card)
    except BenchError:  # the run was made in another folder, or on another machine
        if (shipped := shipped_card(run.manifest.dataset.name)) is None:
            raise
        return shipped


COMPARED = ("valid_px", "reference_px", "ignored_px", "tp_px", "fp_px")


class StoredFrames:
    """Images of a stored run as they were scored: its answers, and the reference.

    The run's method is neither imported nor called. Images whose counts differ from the stored ones, because code or
    data changed since, are refused: a picture shows what was scored, or nothing.

    Args:
        run: whose images they are.
        card: the data set; None for that of `card_of_run`.

    Raises:
        DataError: its card or data set is not there.
    """

    def __init__(self, run: StoredRun, *, card: DatasetCard | None = None) -> None:
        card = card or card_of_run(run)
        self._run = run
        self._dataset = Dataset(card=card, handles=list_recordings(card, run.manifest.dataset.split))
        # A recording at a time, or memory would grow with their number.
        self.pipeline = lru_cache(maxsize=1)(self._pipeline)
        self._counts = lru_cache(maxsize=1)(self._read_counts)

    def _pipeline(self, recording: str, camera: str) -> FramePipeline:
        opened = self._dataset[recording]
        if camera not in opened.cameras:
            raise UnknownNameError("camera", camera, opened.cameras)
        looks = InputOnly(history=self._run.manifest.method.history)
        return FramePipeline(opened, camera, method=looks, protocol=self._run.protocol)

    def process(self, recording: str, camera: str, timestamp_ns: int) -> ProcessedFrame:
        """An image with its stored answer and its reference.

        Raises:
            BenchError: the image, its answer or its reference is not there or cannot be used.
            UnscorableFrame: it has no answer, or its counts differ from the stored ones.
        """
        where = f"recording {recording!r}, camera {camera!r}, image at {timestamp_ns} ns"
        pipeline, answer = (
            self.pipeline(recording, camera),
            find_answer(self._run.answers, recording, camera, timestamp_ns),
        )
        index = next((k for k, image in enumerate(pipeline.images) if image.timestamp_ns == timestamp_ns), None)
        if index is None or answer is None or not is_answered(answer):
            lacks = "the data set has no such image" if index is None else "the run holds no answer"
            raise UnscorableFrame(f"{where}: {lacks if index is None or answer is None else answer['problem']}")
        frame = ProcessedFrame(
            image=pipeline.images[index],
            given=pipeline.method_input(index),
            segmentation=segmentation_of(answer),
            reference=pipeline.reference(index),
        )
        height, width = frame.reference.valid.shape
        counted, _ = count_frame(frame.reference, frame.segmentation.mask_at(width, height), component_size_px=0)
        if [getattr(counted, name) for name in COMPARED] != self._counts(recording).get((camera, timestamp_ns)):
            raise UnscorableFrame(
                f"{where}: its counts are not those that the run stored; code or data changed since, so that a picture "
                f"would not show what was scored"
            )
        return frame

    def _read_counts(self, recording: str) -> dict[tuple[str, int], list[int]]:
        rows = read_counts(self._run.folder, "frames", recording, ["camera", "timestamp_ns", *COMPARED])
        return {(camera, timestamp_ns): counts for camera, timestamp_ns, *counts in rows.to_numpy().tolist()}
