"""Images of a stored run as they were scored: its answers, and the reference.

The run's method is neither imported nor called. Images whose counts differ from the stored ones, because code or data
changed since, are refused: a picture shows what was scored, or nothing.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from bench.errors import DataError
from bench.evaluation.counts import count_frame
from bench.harness.frames import FramePipeline, InputOnly, ProcessedFrame, UnscorableFrame
from bench.harness.stored import StoredRun, find_answer
from bench.methods import Method, MethodInput, Segmentation, UnansweredImage
from bench.recordings import DatasetCard, load_card, open_dataset

COUNTS = ("valid_px", "reference_px", "ignored_px", "tp_px", "fp_px")
_KEY = ("camera", "timestamp_ns")


class StoredAnswers(Method):
    """Answers as a run did, in place of the method that made the answers; it reads no images.

    Args:
        run: folder of the results.
        history: images that the run's method needs before one.
    """

    name = "stored-answers"
    reads_images = False

    def __init__(self, run: str, history: int) -> None:
        self.run, self.history = run, history

    @classmethod
    def of(cls, run: StoredRun) -> StoredAnswers:
        """The answers of a run."""
        return cls(str(run.folder.absolute()), run.manifest.method.history)

    def segment(self, frame: MethodInput) -> Segmentation:
        """The answer of the current image.

        Raises:
            UnansweredImage: the run has none, and says why.
            DataError: the run's answers are damaged.
        """
        answer = find_answer(Path(self.run), frame.recording, frame.camera_name, frame.timestamps_ns[-1])
        if answer is None or not answer.is_answered:
            tuple(frame.images)  # one that cannot be read fails here, as it did in the run
            raise UnansweredImage("the run holds no answer, though the data allow to score the image")
        return answer.segmentation()


class StoredFrames:
    """The images of a run.

    Args:
        run: whose images they are.
        card: the data set; None for the card that the run names.

    Raises:
        DataError: its card or data set is not there.
    """

    def __init__(self, run: StoredRun, *, card: DatasetCard | None = None) -> None:
        self._run, self._method = run, InputOnly(history=run.manifest.method.history)
        dataset = run.manifest.dataset
        self._card = card or load_card(dataset.card)
        self._handles = {handle.name: handle for handle in open_dataset(self._card, dataset.split)}
        self._pipelines: dict[tuple[str, str], FramePipeline] = {}
        self._counts = lru_cache(maxsize=1)(self._read_counts)

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
            self._pipelines[key] = FramePipeline(opened, camera, method=self._method, protocol=self._run.protocol)
        return self._pipelines[key]

    def process(self, recording: str, camera: str, timestamp_ns: int) -> ProcessedFrame:
        """An image with its stored answer and its reference.

        Raises:
            BenchError: the image, its answer or its reference cannot be used.
            UnscorableFrame: it has no answer, or its counts differ from the stored ones.
        """
        pipeline = self.pipeline(recording, camera)
        times_ns = [image.timestamp_ns for image in pipeline.images]
        if timestamp_ns not in times_ns:
            raise DataError(
                pipeline.recording.root, expected=f"an image of {camera!r} at {timestamp_ns} ns", got="none"
            )
        index, answer = times_ns.index(timestamp_ns), self._run.answer(recording, camera, timestamp_ns)
        if answer is None or not answer.is_answered:
            reason = "the run holds no answer" if answer is None else answer.problem
            raise UnscorableFrame(f"recording {recording!r}, camera {camera!r}, image at {timestamp_ns} ns: {reason}")
        frame = ProcessedFrame(
            image=pipeline.images[index],
            given=pipeline.method_input(index),
            segmentation=answer.segmentation(),
            reference=pipeline.reference(index),
        )
        height, width = frame.reference.valid.shape
        counted, _ = count_frame(frame.reference, frame.segmentation.mask_at(width, height), component_size_px=0)
        now = tuple(getattr(counted, name) for name in COUNTS)
        then = self._counts(recording).get((camera, timestamp_ns))
        if now != then:
            stored = "no counts" if then is None else _difference(then, now)
            raise UnscorableFrame(
                f"recording {recording!r}, camera {camera!r}, image at {timestamp_ns} ns: the run stored {stored}; "
                f"code or data changed since, so that a picture would not show what was scored"
            )
        return frame

    def _read_counts(self, recording: str) -> dict[tuple[str, int], tuple[int, ...]]:
        rows = self._run.frames.read([recording], [*_KEY, *COUNTS]).to_dict("records")
        return {(row["camera"], row["timestamp_ns"]): tuple(row[name] for name in COUNTS) for row in rows}


def _difference(then: tuple[int, ...], now: tuple[int, ...]) -> str:
    pairs = zip(COUNTS, then, now, strict=True)
    return ", ".join(f"{name} {before}, now {after}" for name, before, after in pairs if before != after)
