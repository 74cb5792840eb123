"""`view`: pictures, videos and viewer logs of frames."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.cli import options
from bench.cli.console import note_files, say
from bench.cli.progress import progress_bar
from bench.errors import UnknownNameError, UsageError

if TYPE_CHECKING:
    from bench.harness import FramePipeline
    from bench.recordings import ImageRef
    from bench.reference import ReferenceObject

PICTURES = Path("reports/runs/view")


def view(
    dataset: options.Dataset,
    recording: Annotated[str | None, typer.Option(help="Name of the recording; default: the first.")] = None,
    camera: Annotated[str | None, typer.Option(help="Name of the camera; default: the first.")] = None,
    frame: Annotated[int | None, typer.Option(help="Index of the image; default: the middle one.")] = None,
    frames: Annotated[
        str | None, typer.Option(metavar="FIRST:LAST[:STEP]", help="Several images, the last one included.")
    ] = None,
    time_ns: Annotated[int | None, typer.Option(help="The image nearest to this time.")] = None,
    method: Annotated[
        str | None, typer.Option(help="Draw what this method finds, too: a name, or module:Class; default: none.")
    ] = None,
    set_: options.Settings = None,
    protocol: options.ProtocolName = "paper-v1",
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder of pictures; default: reports/runs/view/<camera>/<image>, none beside a video or log."
        ),
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(help="Video (.mp4, .webm, .avi) of true and false areas."),
    ] = None,
    rrd: Annotated[
        Path | None, typer.Option(help="File for the viewer rerun (the optional extra `viewer`), with lidar and boxes.")
    ] = None,
    lidar: Annotated[bool, typer.Option(help="Draw lidar points into the video.")] = True,
    calibration: Annotated[
        bool,
        typer.Option(
            "--calibration",
            help="Draw lidar, road, lens and flow by ego-motion onto the images of each camera instead; no method.",
        ),
    ] = False,
) -> None:
    """Draw frames: reference and lidar clusters, with --method what it finds; a video, or a log for the viewer."""
    from bench.api.datasets import Dataset
    from bench.cli.request import rendered_card
    from bench.evaluation import load_protocol
    from bench.harness import FramePipeline, build_scorable
    from bench.harness.frames import InputOnly
    from bench.methods.settings import parse_settings
    from bench.recordings import open_dataset
    from bench.reporting.calibration_view import write_calibration
    from bench.reporting.film import refuse_other_files, write_film
    from bench.reporting.formats import made_by

    if method is None and set_:
        raise UsageError("--set: expected --method, whose setting it is, got none")
    built = InputOnly(history=0) if method is None else build_scorable(method, parse_settings(set_))
    rules = load_protocol(protocol)
    if calibration and video is not None:
        raise UsageError("--video: expected none with --calibration, which draws pictures and logs (--out, --rrd)")
    refuse_other_files(video=video, rrd=rrd)
    choose = partial(chosen_frames, frame=frame, frames=frames, time_ns=time_ns)
    card = rendered_card(dataset)
    data = Dataset(card=card, handles=open_dataset(card))
    opened = data[recording or data.names[0]]
    if camera is not None and camera not in opened.cameras:
        raise UnknownNameError("camera", camera, opened.cameras)
    if calibration:
        cameras = sorted(opened.cameras) if camera is None else [camera]
        chosen = {name: choose(opened.images[name], history=1, all_without=False) for name in cameras}
        with progress_bar(f"drawing {opened.name}", "images") as progress:
            note_files(write_calibration(opened, chosen, out=out or PICTURES, rrd=rrd, progress=progress))
        return
    name = camera or sorted(opened.cameras)[0]
    pipeline = FramePipeline(opened, name, method=built, protocol=rules)
    made = rules.name if method is None else made_by(built.name, rules.name)
    films = video is not None or rrd is not None
    indices = choose(pipeline.images, history=built.history, all_without=films)
    files: list[Path] = []
    if films:
        with progress_bar(f"drawing {opened.name}", "images") as progress:
            files += write_film(
                pipeline,
                indices,
                video=video,
                rrd=rrd,
                lidar=lidar,
                made_by=made,
                with_method=method is not None,
                progress=progress,
            )
    if out is not None or not films:
        files += _pictures(pipeline, indices, out, made_by=made, with_method=method is not None)
    note_files(files)


def _pictures(
    pipeline: FramePipeline, indices: range, out: Path | None, *, made_by: str, with_method: bool
) -> Iterator[Path]:
    """Pictures of every frame, in a folder named by its image: its index for `--frame`, and the name of its file.

    Those of a single frame lie in the folder that was asked for itself. Annotated objects that are not scored, and so
    have no outline in the pictures, are said.
    """
    from bench.harness.frames import UnscorableFrame
    from bench.reference import Status
    from bench.reporting.formats import file_name
    from bench.reporting.frame_pictures import write_frame_pictures, write_reference_pictures

    usual = PICTURES / f"{file_name(pipeline.recording.name)}-{file_name(pipeline.camera.name)}"
    for index in indices:
        name = f"{index:06d}-{file_name(pipeline.images[index].path.stem)}"
        place = (out or usual) / name if out is None or len(indices) > 1 else out
        try:
            if with_method:
                processed = pipeline.process(index)
                reference = processed.reference
                yield from write_frame_pictures(processed, pipeline, place, made_by=made_by)
            else:
                reference = pipeline.reference(index)
                yield from write_reference_pictures(pipeline, index, place, made_by=made_by)
        except UnscorableFrame as reason:
            if len(indices) == 1:
                raise UsageError(f"this frame has no score: {reason}") from reason
            say(f"left out: {reason}", style="yellow")
            continue
        for found in reference.objects:
            if found.status is not Status.EVALUATED:
                say(f"{name}: {_not_scored(found)}" if len(indices) > 1 else _not_scored(found))


def _not_scored(found: ReferenceObject) -> str:
    """For example "van 'v1': ignored, too few points (0)"."""
    from bench.records.reference import IgnoreReason

    what = f"{found.object_class} {found.track_id!r}"
    if found.reason is None:
        return f"{what}: does not move"
    number = f" ({found.points})" if found.reason is IgnoreReason.FEW_POINTS else ""
    return f"{what}: ignored, {found.reason.value.replace('_', ' ')}{number}"


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
        UsageError: two options, an index that does not exist, or a time outside of the images.
    """
    given = [
        name for name, value in (("--frame", frame), ("--frames", frames), ("--time-ns", time_ns)) if value is not None
    ]
    if len(given) > 1:
        raise UsageError(f"expected one of --frame, --frames and --time-ns, got {' and '.join(given)}")
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


def _span(frames: str, history: int, last: int) -> range:
    match = re.fullmatch(r"(\d{0,9}):(\d{0,9})(?::(\d{1,9}))?", frames)
    if match is None:
        raise UsageError(f"--frames: expected FIRST:LAST or FIRST:LAST:STEP, got {frames!r}")
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
