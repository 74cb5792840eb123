"""Images of a stored run as they were scored: its masks, and the reference built once more from the data set.

The run's method is neither imported nor called. Images whose counts differ from the stored ones, because code or data
changed since, are refused: a picture shows what was scored, or nothing.
"""

from __future__ import annotations

from pathlib import Path

from bench.errors import DataError
from bench.evaluation import Protocol
from bench.evaluation.counts import count_frame
from bench.harness.frames import FramePipeline, InputOnly, ProcessedFrame, UnscorableFrame
from bench.harness.masks import MASKS, read_mask
from bench.harness.stored import RunSummary, open_tables
from bench.recordings import DatasetCard, load_card, open_dataset
from bench.records.segmentation import segmentation_fault

COUNTS = ("valid_px", "reference_px", "ignored_px", "tp_px", "fp_px")
_KEY = ("camera", "timestamp_ns")


class StoredFrames:
    """The images of a run.

    Args:
        run: folder of the results.
        summary: of the run.
        protocol: its rules.
        card: the data set; None for the card that the summary names.

    Raises:
        DataError: the run holds no masks, or its card or data set is not there.
    """

    def __init__(self, run: Path, summary: RunSummary, protocol: Protocol, *, card: DatasetCard | None = None) -> None:
        self._protocol = protocol
        self._input = InputOnly(history=summary.manifest.method.history)
        self._masks = run / MASKS
        if not self._masks.is_file():
            hint = "run again: pictures are drawn from stored masks, and the method of a stored run is never called"
            raise DataError(self._masks, expected="the masks that were scored", got="no such file", hint=hint)
        self._card = card or load_card(summary.manifest.dataset.card)
        self._handles = {handle.name: handle for handle in open_dataset(self._card, summary.manifest.dataset.split)}
        self._frames = open_tables(run)[1]
        self._pipelines: dict[tuple[str, str], FramePipeline] = {}
        self._stored: tuple[str, dict[tuple[str, int], tuple[int, ...]]] = ("", {})

    def pipeline(self, recording: str, camera: str) -> FramePipeline:
        """The pipeline of the images of a camera.

        Raises:
            DataError: the data set has no such recording or camera any more.
        """
        key = recording, camera
        if key not in self._pipelines:
            if recording not in self._handles:
                hint = "name the data set that the run was scored on"
                got = f"{len(self._handles)} others"
                raise DataError(self._card.file, expected=f"recording {recording!r} of the run", got=got, hint=hint)
            opened = self._handles[recording].open()
            if camera not in opened.cameras:
                got = ", ".join(opened.cameras)
                raise DataError(opened.root, expected=f"the camera {camera!r} of the run", got=got)
            self._pipelines.clear()  # a recording at a time, or memory would grow with their number
            self._pipelines[key] = FramePipeline(opened, camera, method=self._input, protocol=self._protocol)
        return self._pipelines[key]

    def process(self, recording: str, camera: str, timestamp_ns: int) -> ProcessedFrame:
        """An image with its stored mask and its reference.

        Raises:
            DataError: the image, its mask or its reference cannot be read.
            UnscorableFrame: its counts differ from the stored ones.
        """
        pipeline = self.pipeline(recording, camera)
        times_ns = [image.timestamp_ns for image in pipeline.images]
        if timestamp_ns not in times_ns:
            raise DataError(
                pipeline.recording.root, expected=f"an image of {camera!r} at {timestamp_ns} ns", got="none"
            )
        index = times_ns.index(timestamp_ns)
        given, reference = pipeline.method_input(index), pipeline.reference(index)
        answer = read_mask(self._masks, recording=recording, camera=camera, timestamp_ns=timestamp_ns)
        height, width = reference.valid.shape
        if (fault := segmentation_fault(answer, width=width, height=height)) is not None:
            raise DataError(self._masks, expected="the segmentation that was scored", got=fault)
        counted, _ = count_frame(reference, answer.mask_at(width, height), component_size_px=0)
        now, then = (
            tuple(getattr(counted, name) for name in COUNTS),
            self._counts(recording).get((camera, timestamp_ns)),
        )
        if now != then:
            stored = "no counts" if then is None else _difference(then, now)
            raise UnscorableFrame(
                f"recording {recording!r}, camera {camera!r}, image at {timestamp_ns} ns: the run stored {stored}; "
                f"code or data changed since, so that a picture would not show what was scored"
            )
        return ProcessedFrame(image=pipeline.images[index], given=given, segmentation=answer, reference=reference)

    def _counts(self, recording: str) -> dict[tuple[str, int], tuple[int, ...]]:
        if self._stored[0] != recording:
            rows = self._frames.read([recording], [*_KEY, *COUNTS]).to_dict("records")
            counts = {(row["camera"], row["timestamp_ns"]): tuple(row[name] for name in COUNTS) for row in rows}
            self._stored = recording, counts
        return self._stored[1]


def _difference(then: tuple[int, ...], now: tuple[int, ...]) -> str:
    pairs = zip(COUNTS, then, now, strict=True)
    return ", ".join(f"{name} {before}, now {after}" for name, before, after in pairs if before != after)
