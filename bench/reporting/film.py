"""Frames as a film: a video, a log for the viewer rerun, or both in one pass."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

from bench.harness import FramePipeline
from bench.harness.frames import UnscorableFrame
from bench.harness.stages import Progress
from bench.recordings import read_image
from bench.reporting.formats import image_name
from bench.reporting.rerun_log import refuse_other_log, rerun_log, viewer
from bench.reporting.video import SweepViewer, draw_frame, draw_plain, draw_reference, refuse_other_suffix, video_file


def refuse_other_files(*, video: Path | None, rrd: Path | None) -> None:
    """Refuse what `write_film` could not write, before anything is rendered.

    Raises:
        UsageError: another suffix, or no viewer.
    """
    if video is not None:
        refuse_other_suffix(video)
    if rrd is not None:
        refuse_other_log(rrd)
        viewer()


def write_film(
    pipeline: FramePipeline,
    indices: range,
    *,
    video: Path | None,
    rrd: Path | None,
    lidar: bool,
    made_by: str,
    with_method: bool,
    progress: Progress,
) -> list[Path]:
    """Draw frames, those without a score as they are.

    Args:
        pipeline: processes the images of a camera.
        indices: of images, in steps that give the rate.
        video: the video file; None for none.
        rrd: the file for the viewer; None for none.
        lidar: draw lidar points into the pictures.
        made_by: method and protocol, in every picture.
        with_method: ask the method; else the reference is drawn alone.
        progress: called with the pictures done and their number.

    Returns:
        The files.

    Raises:
        UsageError: as `refuse_other_files`, or a codec that is missing.
        OutputError: a file cannot be written.
        DataError: an image or sweep cannot be read.
    """
    recording, camera = pipeline.recording, pipeline.camera
    sweeps = SweepViewer(recording, camera)
    rate_hz = 1e9 / recording.frame_interval_ns / indices.step
    with ExitStack() as stack:
        film = None if video is None else stack.enter_context(video_file(video, frame_rate_hz=rate_hz))
        log = None if rrd is None else stack.enter_context(rerun_log(rrd, recording=recording, cameras=[camera.name]))
        for number, index in enumerate(indices, start=1):
            image = pipeline.images[index]
            seen = sweeps.see(image) if lidar or log is not None else None
            name = f"{image_name(recording.name, camera.name, image.timestamp_ns)}; {made_by}"
            shown = seen if lidar else None
            try:
                if with_method:
                    picture = draw_frame(pipeline.process(index), name, shown)
                else:
                    pixels = read_image(image, camera, colour=True)
                    picture = draw_reference(pixels, pipeline.reference(index), name, shown)
            except UnscorableFrame as reason:
                picture = draw_plain(read_image(image, camera, colour=True), name, f"no score: {reason}")
            if film is not None:
                film.add(picture)
            if log is not None:
                log.add(image, picture, seen)
            progress(number, len(indices))
    return [file for file in (video, rrd) if file is not None]
