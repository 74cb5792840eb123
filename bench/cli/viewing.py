"""Pictures, videos and viewer logs of frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from bench.cli.console import progress_bar, say
from bench.cli.frame_choice import chosen_frames
from bench.cli.rendering import render_if_synthetic
from bench.cli.settings import parse_settings
from bench.errors import BenchError, UnknownNameError, UsageError
from bench.evaluation import Protocol, load_protocol
from bench.harness import FramePipeline, RunSummary, build_scorable, open_tables
from bench.harness.frames import UnscorableFrame
from bench.harness.replay import StoredFrames
from bench.recordings import DatasetCard, RecordingHandle, load_card, open_dataset, read_image
from bench.reporting.frame_pictures import example_frames, write_frame_pictures
from bench.reporting.rerun_log import refuse_other_log, rerun_log, viewer
from bench.reporting.video import SweepViewer, draw_frame, draw_plain, refuse_other_suffix, video_file

PICTURES = Path("reports/runs/view")


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewRequest:
    """What is to be drawn, as the options of `view` say.

    Attributes:
        recording: name; None for the first.
        camera: name; None for the first.
        frame: index of an image.
        frames: span of indices.
        time_ns: a time.
        out: folder of pictures; None for none beside a video or a log.
        video: video file.
        rrd: file for the viewer.
        lidar: draw lidar points into the video.
    """

    recording: str | None = None
    camera: str | None = None
    frame: int | None = None
    frames: str | None = None
    time_ns: int | None = None
    out: Path | None = None
    video: Path | None = None
    rrd: Path | None = None
    lidar: bool = True


def view(dataset: str, request: ViewRequest, *, method: str, settings: Sequence[str], protocol: str) -> None:
    """Draw the frames that are asked for and print the files."""
    card = load_card(dataset)
    chosen = build_scorable(method, parse_settings(settings))
    if request.video is not None:
        refuse_other_suffix(request.video)
    if request.rrd is not None:
        refuse_other_log(request.rrd)
        viewer()
    render_if_synthetic(card)
    opened = _pick(open_dataset(card), request.recording).open()
    name = request.camera or sorted(opened.cameras)[0]
    if name not in opened.cameras:
        raise UnknownNameError("camera", name, opened.cameras)
    pipeline = FramePipeline(opened, name, method=chosen, protocol=load_protocol(protocol))
    films = request.video is not None or request.rrd is not None
    indices = chosen_frames(
        pipeline.images,
        history=chosen.history,
        frame=request.frame,
        frames=request.frames,
        time_ns=request.time_ns,
        all_without=films,
    )
    files: list[Path] = []
    if films:
        files += _film(pipeline, indices, request)
    if request.out is not None or not films:
        files += _pictures(pipeline, indices, request.out or PICTURES)
    for file in files:
        say(str(file))


def _pictures(pipeline: FramePipeline, indices: range, folder: Path) -> Iterator[Path]:
    """Pictures of every frame; of several each in a folder named by its time."""
    for index in indices:
        place = folder if len(indices) == 1 else folder / str(pipeline.images[index].timestamp_ns)
        try:
            yield from write_frame_pictures(pipeline.process(index), pipeline, place)
        except UnscorableFrame as reason:
            if len(indices) == 1:
                raise UsageError(f"this frame has no score: {reason}") from reason
            say(f"left out: {reason}", style="yellow")


def _film(pipeline: FramePipeline, indices: range, request: ViewRequest) -> list[Path]:
    """A video, a log for the viewer, or both in one pass."""
    recording, camera = pipeline.recording, pipeline.camera
    sweeps = SweepViewer(recording, camera)
    rate_hz = 1e9 / recording.frame_interval_ns / indices.step
    with ExitStack() as stack:
        report = stack.enter_context(progress_bar(f"drawing {recording.name}", "images"))
        video = log = None
        if request.video is not None:
            video = stack.enter_context(video_file(request.video, frame_rate_hz=rate_hz))
        if request.rrd is not None:
            log = stack.enter_context(rerun_log(request.rrd, recording=recording, camera=camera.name))
        for number, index in enumerate(indices, start=1):
            image = pipeline.images[index]
            seen = sweeps.see(image) if request.lidar or log is not None else None
            try:
                picture = draw_frame(pipeline.process(index), seen if request.lidar else None)
            except UnscorableFrame as reason:
                picture = draw_plain(read_image(image, camera, colour=True), f"no score: {reason}")
            if video is not None:
                video.add(picture)
            if log is not None:
                log.add(image, picture, seen)
            report(number, len(indices))
    return [file for file in (request.video, request.rrd) if file is not None]


def draw_telling_frames(
    results: Path,
    summary: RunSummary,
    *,
    card: DatasetCard | None,
    protocol: Protocol,
    progress: Callable[[float, int], None],
) -> tuple[list[Path], list[str]]:
    """Draw, as it was scored, the frame of every category in which an object fills most pixels, into `pictures`.

    Returns:
        The files, and a line for every reason why a picture could not be made.
    """
    files, remarks = list[Path](), list[str]()
    try:
        stored = StoredFrames(results, summary, protocol, card=card)
    except BenchError as error:
        return [], [str(error)]
    frames = example_frames(open_tables(results)[0])
    for number, (category, key) in enumerate(frames.items(), start=1):
        try:
            folder = results / "pictures" / category.value
            files += write_frame_pictures(stored.process(*key), stored.pipeline(*key[:2]), folder)
        except (BenchError, UnscorableFrame) as error:
            remarks.append(str(error))
        progress(number, len(frames))
    return files, remarks


def _pick(handles: Sequence[RecordingHandle], name: str | None) -> RecordingHandle:
    by_name = {handle.name: handle for handle in handles}
    if name is None:
        return handles[0]
    if name not in by_name:
        raise UnknownNameError("recording", name, by_name)
    return by_name[name]
