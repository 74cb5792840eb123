"""A recording that is known by name but not opened yet."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Annotated as Of

from pydantic import AfterValidator, Field

from bench.errors import DataError
from bench.recordings.validation import FileModel
from bench.records.recording import NO_INPUT_ERRORS, NOT_ANNOTATED, Annotated, ImageRef, InputErrors, Recording


def _in_order(span: tuple[int | None, int | None]) -> tuple[int | None, int | None]:
    first, last = span
    if first is not None and last is not None and first > last:
        raise ValueError(f"first and last in order, not {first} before {last}")
    return span


# First and last, both included; None for open.
Span = Of[tuple[int | None, int | None], AfterValidator(_in_order)]


class Exclusion(FileModel):
    """Images that a card leaves out; without any limit the whole recording.

    Attributes:
        recording: name.
        reason: why.
        frames: images of each camera, counted from 0.
        timestamps_ns: times of images.
    """

    recording: str
    reason: str = Field(min_length=1)
    frames: Span | None = None
    timestamps_ns: Span | None = None

    @property
    def covers_all(self) -> bool:
        """True where the whole recording is left out."""
        return all(limit is None for span in (self.frames, self.timestamps_ns) for limit in span or ())

    def covers(self, frame: int, timestamp_ns: int) -> bool:
        """Return True where an image is left out."""
        return _within(frame, self.frames) and _within(timestamp_ns, self.timestamps_ns)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingHandle:
    """A recording by name; it travels to other processes and is opened there.

    Attributes:
        name: of the recording.
        opener: opens it; a function of a module, or a `functools.partial` of one. The first error ends it.
        parts: gives readers of its files one by one, which `validate` calls where opening fails, so that the errors of
            every file are listed; of other openers the first alone.
        exclusions: images that are left out on opening.
        first_images: of each camera that is left, how many there are after opening; None for all.
        input_errors: injected into the method's input.
        annotated: what the card says is annotated of a recording that is; None for what that says itself.
    """

    name: str
    opener: Callable[[], Recording]
    parts: Callable[[], Iterable[Callable[[], object]]] = tuple
    exclusions: tuple[Exclusion, ...] = ()
    first_images: int | None = None
    input_errors: InputErrors = NO_INPUT_ERRORS
    annotated: Annotated | None = None

    def open(self) -> Recording:
        """Open the recording: calibration, lists of images and sweeps, ego-motion and annotations; no bulk data.

        Raises:
            DataError: something in it is not what the format asks for, or an exclusion leaves none of its images out.
        """
        recording = self.opener()
        if self.input_errors != NO_INPUT_ERRORS:
            recording = replace(recording, input_errors=self.input_errors)
        if self.annotated is not None and recording.annotated != NOT_ANNOTATED:
            recording = replace(recording, annotated=self.annotated)
        if not self.exclusions and self.first_images is None:
            return recording
        for exclusion in self.exclusions:
            _refuse_void(exclusion, recording)
        images = {camera: self._included(refs)[: self.first_images] for camera, refs in recording.images.items()}
        return replace(recording, images=images)

    def _included(self, refs: tuple[ImageRef, ...]) -> tuple[ImageRef, ...]:
        return tuple(
            ref for i, ref in enumerate(refs) if not any(e.covers(i, ref.timestamp_ns) for e in self.exclusions)
        )


def _refuse_void(exclusion: Exclusion, recording: Recording) -> None:
    """Refuse an exclusion that leaves nothing out: its times may be in another unit, or of another drive."""
    images = [(i, ref.timestamp_ns) for refs in recording.images.values() for i, ref in enumerate(refs)]
    if not images or any(exclusion.covers(*image) for image in images):
        return
    times_ns = [time_ns for _, time_ns in images]
    about = [f"frames {exclusion.frames}"] if exclusion.frames else []
    about += [f"times {exclusion.timestamps_ns}"] if exclusion.timestamps_ns else []
    raise DataError(
        f"exclusions of {recording.name}",
        expected=f"images that they leave out, of {max(map(len, recording.images.values()))} from {min(times_ns)} to "
        f"{max(times_ns)} ns",
        got=f"{' and '.join(about)}, which leave none out ({exclusion.reason})",
        hint="correct the card: frames count from 0, times are nanoseconds",
    )


def _within(value: int, span: Span | None) -> bool:
    first, last = span or (None, None)
    return (first is None or value >= first) and (last is None or value <= last)
