"""Everything that is wrong with a recording, found by reading all of it."""

from __future__ import annotations

from collections.abc import Iterator

from bench.errors import DataError
from bench.recordings.gaps import frame_gaps
from bench.recordings.handles import RecordingHandle
from bench.recordings.images import read_image, read_truth
from bench.recordings.records import Recording


def recording_faults(handle: RecordingHandle) -> Iterator[DataError]:
    """Open a recording and read every image, truth image and sweep.

    Where it does not open, the fault that stops it is the only one found: calibration and times are needed to read the
    rest.

    Yields:
        One error per fault, gaps in the times of images and missing ego-motion included.
    """
    try:
        recording = handle.open()
    except DataError as error:
        yield error
        return
    yield from _image_faults(recording)
    for sweep in recording.sweeps:
        try:
            sweep.read()
        except DataError as error:
            yield error


def _image_faults(recording: Recording) -> Iterator[DataError]:
    for name, camera in recording.cameras.items():
        for gap in frame_gaps(recording, name):
            yield DataError(
                recording.images[name][gap.index].path,
                field="timestamp_ns",
                wanted=f"an image about {recording.frame_interval_ns} ns after the one at {gap.previous_ns}",
                came=f"one {gap.current_ns - gap.previous_ns} ns after it",
                do="pairs across the gap are not evaluated",
            )
        for image in recording.images[name]:
            try:
                read_image(image, camera)
                if image.truth_path is not None:
                    read_truth(image, camera)
                recording.trajectory.world_from_vehicle(image.timestamp_ns)
            except DataError as error:
                yield error
