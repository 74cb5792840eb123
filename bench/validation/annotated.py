"""The statement of what is annotated, against the annotations."""

from __future__ import annotations

from collections.abc import Iterator

from bench.recordings import COMPLETELY, NOT_ANNOTATED, Recording
from bench.validation.findings import Finding, Severity


def check_annotated(recording: Recording) -> Iterator[Finding]:
    """Complete annotations without any object, ones that nothing uses, stated times at which no image was taken."""
    images = [image for images in recording.images.values() for image in images]
    annotated, objects = recording.annotated, [track for track in recording.tracks if track.states]
    if annotated == NOT_ANNOTATED and objects:
        yield Finding(
            check="annotated",
            severity=Severity.WARNING,
            field="annotated",
            expected="no annotations, as the recording is said to be not annotated",
            got=f"{len(objects)} objects, which nothing uses",
            hint="take `annotated: none` out of the card or recording.json to score by them",
        )
    if annotated == NOT_ANNOTATED or any(image.moving_path is not None for image in images):
        return
    if not objects:
        part = "all of the recording" if annotated == COMPLETELY else "part of the recording"
        yield Finding(
            check="annotated",
            severity=Severity.WARNING,
            field="annotated",
            expected=f"objects, as {part} is said to be annotated",
            got="none",
            hint="right if nothing moves there; else whatever is detected counts as wrong: state annotated: none",
        )
    if images and not any(annotated.covers(image.timestamp_ns) for image in images):
        times_ns = sorted(image.timestamp_ns for image in images)
        yield Finding(
            check="annotated",
            field="annotated.timestamps_ns",
            expected=f"times of the images, {times_ns[0]} to {times_ns[-1]}",
            got="times at which there is none",
            hint="check the unit and the epoch of the clock",
        )
