"""`view`: pictures, videos and viewer logs of frames: the reference, what a method finds, lidar and calibration."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.commands import options
from bench.commands.command import PATH, TEXT
from bench.commands.console import note_files, say
from bench.commands.progress import Report, progress_bar
from bench.errors import UnknownNameError, UsageError

if TYPE_CHECKING:
    from bench.evaluation import Protocol
    from bench.harness import FramePipeline
    from bench.methods import Scorable
    from bench.recordings import DatasetCard, ImageRef, Recording
    from bench.reference import ReferenceObject

PICTURES = Path("reports/runs/view")


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """Frames that were drawn.

    Attributes:
        files: that were written.
        remarks: frames that are left out, and annotated objects that are not scored, and so have no outline in the
            pictures; one line each.
    """

    files: tuple[Path, ...]
    remarks: tuple[str, ...] = ()


def view(
    dataset: options.Dataset,
    *,
    recording: Annotated[str | None, typer.Option(help="Name of the recording; default: the first.")] = None,
    camera: Annotated[
        str | None, typer.Option(help="Name of the camera; default: the first, with --calibration each.")
    ] = None,
    frame: Annotated[int | None, typer.Option(help="Index of the image; default: the middle one.")] = None,
    frames: Annotated[
        str | None, typer.Option(metavar="FIRST:LAST[:STEP]", help="Several images, the last one included.")
    ] = None,
    time_ns: Annotated[int | None, typer.Option(help="The image nearest to this time, in ns.")] = None,
    method: Annotated[
        str | Scorable | None,
        typer.Option(help="Also draw what this method finds: a name, or module:Class; default: none."),
        TEXT,
    ] = None,
    settings: options.Settings = None,
    protocol: options.ProtocolName = "paper-v1",
    out: Annotated[
        str | Path | None,
        typer.Option(
            help="Folder of pictures; default: reports/runs/view/<camera>/<image>; none with --video or --rrd."
        ),
        PATH,
    ] = None,
    video: Annotated[
        str | Path | None, typer.Option(help="Write a video (.mp4, .webm, .avi) of right and wrong areas."), PATH
    ] = None,
    rrd: Annotated[
        str | Path | None,
        typer.Option(help="Write a log for the rerun viewer (extra `viewer`), with lidar and boxes."),
        PATH,
    ] = None,
    lidar: Annotated[bool, typer.Option(help="Draw lidar points in the video.")] = True,
    calibration: Annotated[
        bool,
        typer.Option(
            "--calibration",
            help="Draw lidar, road grid, lens and predicted flow onto the images of each camera; without a method.",
        ),
    ] = False,
    progress: Report | None = None,
) -> View:
    """Draw images with reference and lidar points, with --method also what it finds; or a video or viewer log.

    Args:
        dataset: card, by path or by name.
        recording: name.
        camera: name.
        frame: index of the image; of a video or log None is for all.
        frames: "FIRST:LAST" or "FIRST:LAST:STEP".
        time_ns: of an image.
        method: by name, as "module:Class", or an object; None for the reference alone.
        settings: parameters of a method that is given by name.
        protocol: of the reference, by name or file.
        out: folder of pictures.
        video: file; None for none.
        rrd: file; None for none.
        lidar: False for none.
        calibration: in place of reference and method.
        progress: called with the images that are drawn, and their number.

    Raises:
        UnknownNameError: no data set, recording, camera, method or protocol of this name.
        UsageError: two choices of frames, or one that does not exist or cannot be scored; a suffix or codec that is
            missing; settings without the name of a method; a video of calibration.
        DataError: an image or sweep that cannot be read.
    """
    from bench.evaluation import load_protocol
    from bench.harness import build_scorable
    from bench.reporting.film import refuse_other_files, write_calibration

    # mistakes are told before anything is rendered
    if settings and not isinstance(method, str):
        raise UsageError("--set: expected --method, the name of the method whose setting it is, got none")
    built = build_scorable(method, settings) if isinstance(method, str) else method
    rules = load_protocol(protocol)
    if calibration and video is not None:
        raise UsageError("--video: expected none with --calibration, which draws pictures and logs (--out, --rrd)")
    film, log = _path(video), _path(rrd)
    refuse_other_files(video=film, rrd=log)
    _refuse_several(frame=frame, frames=frames, time_ns=time_ns)
    opened, cameras = _open(dataset, recording, camera)
    choose = partial(chosen_frames, frame=frame, frames=frames, time_ns=time_ns)
    with progress_bar(f"drawing {opened.name}", "images", progress) as report:
        if not calibration:
            return _view(opened, cameras[0], built, rules, choose, out=_path(out), video=film, rrd=log, lidar=lidar,
                         progress=report)  # fmt: skip
        files = write_calibration(
            opened,
            {
                name: choose(opened.images[name], history=1, all_without=False)
                for name in (cameras if camera is None else [camera])
            },
            out=_path(out) or PICTURES,
            rrd=log,
            progress=report,
        )
    return View(files=tuple(files))


def _view(
    recording: Recording,
    camera: str,
    method: Scorable | None,
    protocol: Protocol,
    choose: partial[range],
    *,
    out: Path | None,
    video: Path | None,
    rrd: Path | None,
    lidar: bool,
    progress: Report,
) -> View:
    """Draw frames of a camera with their reference and what a method finds."""
    from bench.harness import FramePipeline
    from bench.harness.frames import InputOnly, UnscorableFrame
    from bench.records.reference import Status
    from bench.reporting.film import write_film
    from bench.reporting.formats import made_by

    built = method or InputOnly(history=0)
    pipeline = FramePipeline(recording, camera, method=built, protocol=protocol)
    made = protocol.name if method is None else made_by(built.name, protocol.name)
    filmed = video is not None or rrd is not None
    indices = choose(pipeline.images, history=built.history, all_without=filmed)
    with_method, files, remarks = method is not None, [], []
    if filmed:
        files += write_film(
            pipeline,
            indices,
            video=video,
            rrd=rrd,
            lidar=lidar,
            made_by=made,
            with_method=with_method,
            progress=progress,
        )
    if out is not None or not filmed:
        for index in indices:
            place = _picture_folder(pipeline, index, out, alone=len(indices) == 1)
            try:
                drawn, objects = _draw(pipeline, index, place, made_by=made, with_method=with_method)
            except UnscorableFrame as reason:
                if len(indices) == 1:
                    raise UsageError(f"this frame has no score: {reason}") from reason
                remarks.append(f"left out: {reason}")
                continue
            files += drawn
            of_frame = "" if len(indices) == 1 else f"{place.name}: "
            remarks += [
                f"{of_frame}{_not_scored(target)}" for target in objects if target.status is not Status.EVALUATED
            ]
    return View(files=tuple(files), remarks=tuple(remarks))


def _open(dataset: str | Path | DatasetCard, recording: str | None, camera: str | None) -> tuple[Recording, list[str]]:
    """A recording and the names of its cameras, the one that is asked for first.

    Raises:
        UnknownNameError: no such recording or camera.
    """
    from bench.commands.data import rendered_card
    from bench.harness.datasets import Dataset
    from bench.recordings import open_dataset

    card = rendered_card(dataset, recording)
    data = Dataset(card=card, handles=open_dataset(card, recording))
    if recording is not None and data.names != (recording,):
        raise UnknownNameError("recording", recording, data.names)
    opened = data[data.names[0]]
    if camera is not None and camera not in opened.cameras:
        raise UnknownNameError("camera", camera, opened.cameras)
    return opened, sorted(opened.cameras, key=lambda name: (name != camera, name))


def _path(file: str | Path | None) -> Path | None:
    return None if file is None else Path(file)


def _picture_folder(pipeline: FramePipeline, index: int, out: Path | None, *, alone: bool) -> Path:
    """Folder of a frame's pictures, named by its image: its index and the name of its file.

    Those of a single frame lie in the folder that was asked for itself.
    """
    from bench.reporting.formats import file_name

    if out is not None and alone:
        return out
    usual = PICTURES / f"{file_name(pipeline.recording.name)}-{file_name(pipeline.camera.name)}"
    return (out or usual) / f"{index:06d}-{file_name(pipeline.images[index].path.stem)}"


def _draw(
    pipeline: FramePipeline, index: int, place: Path, *, made_by: str, with_method: bool
) -> tuple[list[Path], Sequence[ReferenceObject]]:
    """Draw a frame; the files, and its annotated objects."""
    from bench.reporting.frame_pictures import write_frame_pictures, write_reference_pictures

    if not with_method:
        objects = pipeline.reference(index).objects
        return [*write_reference_pictures(pipeline, index, place, made_by=made_by)], objects
    processed = pipeline.process(index)
    return [*write_frame_pictures(processed, pipeline, place, made_by=made_by)], processed.reference.objects


def _not_scored(target: ReferenceObject) -> str:
    """For example "van 'v1': ignored, too few points (0)"."""
    from bench.records.reference import IgnoreReason

    what = f"{target.object_class} {target.track_id!r}"
    if target.reason is None:
        return f"{what}: does not move"
    number = f" ({target.points})" if target.reason is IgnoreReason.FEW_POINTS else ""
    return f"{what}: ignored, {target.reason.value.replace('_', ' ')}{number}"


def chosen_frames(
    images: tuple[ImageRef, ...],
    *,
    history: int,
    frame: int | None,
    frames: str | None,
    time_ns: int | None,
    all_without: bool,
) -> range:
    """Indices of images, from whichever of the three options is given.

    Args:
        images: of the camera.
        history: images before the first that can be chosen.
        frame: one index.
        frames: "FIRST:LAST" or "FIRST:LAST:STEP", the last one included; either end may be left out.
        time_ns: the image nearest to this time.
        all_without: without an option all images, else the middle one.

    Raises:
        UsageError: an index that does not exist, or a time outside of the images.
    """
    last = len(images) - 1
    if history > last:
        raise UsageError(f"expected more than {history} images of the camera, got {len(images)}")
    if frames is not None:
        return _span(frames, history, last)
    if time_ns is not None:
        return _at(images, time_ns, history)
    if frame is None and all_without:
        return range(history, last + 1)
    index = max(len(images) // 2, history) if frame is None else frame
    if not history <= index <= last:
        raise UsageError(f"--frame: expected {history} to {last}, got {index}")
    return range(index, index + 1)


def _refuse_several(*, frame: int | None, frames: str | None, time_ns: int | None) -> None:
    """Refuse two choices of frames, and one that is none of any recording."""
    given = [
        name for name, value in (("--frame", frame), ("--frames", frames), ("--time-ns", time_ns)) if value is not None
    ]
    if len(given) > 1:
        raise UsageError(f"expected one of --frame, --frames and --time-ns, got {' and '.join(given)}")
    if frames is not None:
        _parsed_span(frames)


def _parsed_span(frames: str) -> re.Match[str]:
    match = re.fullmatch(r"(\d{0,9}):(\d{0,9})(?::(\d{1,9}))?", frames)
    if match is None:
        raise UsageError(f"--frames: expected FIRST:LAST or FIRST:LAST:STEP, got {frames!r}")
    return match


def _span(frames: str, history: int, last: int) -> range:
    match = _parsed_span(frames)
    first = int(match[1]) if match[1] else history
    end = int(match[2]) if match[2] else last
    step = int(match[3]) if match[3] else 1
    if not (history <= first <= end <= last and step > 0):
        raise UsageError(f"--frames: expected indices from {history} to {last}, rising, got {frames!r}")
    return range(first, end + 1, step)


def _at(images: tuple[ImageRef, ...], time_ns: int, history: int) -> range:
    import numpy as np

    times_ns = [image.timestamp_ns for image in images]
    index = int(np.argmin([abs(time - time_ns) for time in times_ns]))
    first, last = times_ns[history], times_ns[-1]
    step_ns = int(np.median(np.diff(times_ns)))
    if index < history or abs(times_ns[index] - time_ns) > step_ns:
        raise UsageError(f"--time-ns: expected a time from {first} to {last}, got {time_ns}")
    return range(index, index + 1)


def show(drawn: View) -> None:
    """Print what is left out, and the files."""
    for remark in drawn.remarks:
        say(remark)
    note_files(drawn.files)
