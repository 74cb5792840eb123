"""`view`: pictures, videos and viewer logs of frames: the reference, what a method finds, lidar and calibration."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.commands import options
from bench.commands.command import TEXT, Flag, Place
from bench.commands.console import Report, note_files, progress_bar, say
from bench.errors import UnknownNameError, UsageError

if TYPE_CHECKING:
    from bench.harness.frames import FramePipeline
    from bench.methods import Scorable
    from bench.recordings import DatasetCard, ImageRef, Recording
    from bench.records.reference import ReferenceObject

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
    recording: Annotated[str | None, typer.Option()] = None,
    camera: Annotated[str | None, typer.Option()] = None,
    frame: Annotated[int | str | None, typer.Option(metavar="N|FIRST:LAST[:STEP]"), TEXT] = None,
    time_ns: Annotated[int | None, typer.Option()] = None,
    method: Annotated[str | Scorable | None, typer.Option(), TEXT] = None,
    settings: options.Settings = None,
    protocol: options.Protocol = "surface-v1",
    out: Place = None,
    video: Place = None,
    rrd: Place = None,
    calibration: Flag = False,
    progress: Report | None = None,
) -> View:
    """Draw reference and lidar points onto images, with --method also its mask; or write a video or a viewer log.

    Args:
        dataset: card, by path or by name.
        recording: name of one recording (commands that take several have --split); default: the first.
        camera: name of the camera; default: the first, with --calibration each.
        frame: index of an image, or a range that includes its last one; default: the middle image, for videos all.
        time_ns: the image nearest to this time, in ns.
        method: also draw what this method finds: a name, or module:Class; default: none.
        settings: parameters of a method that is given by name.
        protocol: of the reference, by name or file.
        out: folder of pictures; default: reports/runs/view/<data set>/<camera>/<image>; none with --video or --rrd.
        video: write a video (.mp4, .webm) of right and wrong areas.
        rrd: write a log for the rerun viewer (extra `viewer`), with lidar and boxes.
        calibration: draw lidar, road grid, lens and predicted flow onto the images of each camera; without a method.
        progress: called with the images that are drawn, and their number.

    Raises:
        UnknownNameError: no data set, recording, camera, method or protocol of this name.
        UsageError: two choices of frames, or one that does not exist or cannot be scored; a suffix or codec that is
            missing; settings without the name of a method; a video or log of calibration.
        DataError: an image or sweep that cannot be read.

    Examples:
        fisheye-bench view demo --method spherical --frame 20
        fisheye-bench view demo --recording crossing-car --frame 10:40 --video crossing.mp4
    """
    from bench.evaluation.protocol import load_protocol
    from bench.harness.exact import build_scorable
    from bench.harness.frames import FramePipeline, InputOnly
    from bench.reporting.formats import file_name, made_by
    from bench.reporting.frame_pictures import refuse_other_files, write_calibration, write_film

    # mistakes are told before anything is rendered
    if settings and not isinstance(method, str):
        raise UsageError("--set: expected --method, the name of the method whose setting it is, got none")
    built = build_scorable(method, settings) if isinstance(method, str) else method
    rules = load_protocol(protocol)
    if calibration and (video is not None or rrd is not None):
        raise UsageError("--video, --rrd: expected none with --calibration, which draws pictures (--out)")
    pictures, film, log = (None if file is None else Path(file) for file in (out, video, rrd))
    refuse_other_files(video=film, rrd=log)
    span = None if frame is None else parsed_span(str(frame))
    if span is not None and time_ns is not None:
        raise UsageError("expected one of --frame and --time-ns, got both")
    card = options.as_card(dataset)
    opened, cameras = _open(card, recording, camera)
    usual = PICTURES / file_name(card.name)
    with progress_bar(f"drawing {opened.name}", "images", progress) as report:
        if calibration:
            chosen = {
                name: chosen_frames(opened.images[name], history=1, span=span, time_ns=time_ns)
                for name in (cameras if camera is None else [camera])
            }
            return View(files=tuple(write_calibration(opened, chosen, out=pictures or usual, progress=report)))
        asked = built or InputOnly(history=0)
        pipeline = FramePipeline(opened, cameras[0], method=asked, protocol=rules)
        made = rules.name if built is None else made_by(asked.name, rules.name)
        filmed, files = film is not None or log is not None, list[Path]()
        indices = chosen_frames(pipeline.images, history=asked.history, span=span, time_ns=time_ns, all_else=filmed)
        if filmed:
            files += write_film(
                pipeline, indices, video=film, rrd=log, made_by=made, with_method=built is not None, progress=report
            )
        if filmed and pictures is None:
            return View(files=tuple(files))
        drawn = _draw(pipeline, indices, pictures, usual=usual, made_by=made, with_method=built is not None)
        return View(files=(*files, *drawn.files), remarks=drawn.remarks)


def _open(card: DatasetCard, recording: str | None, camera: str | None) -> tuple[Recording, list[str]]:
    """A recording and the names of its cameras, the one that is asked for first.

    Raises:
        UnknownNameError: no such recording or camera, of a scenario before anything is rendered.
        UsageError: the name of a split.
    """
    from bench.harness.datasets import Dataset
    from bench.recordings import open_dataset

    if recording in card.splits:
        raise UsageError(f"--recording: expected one recording, got the split {recording!r}")
    if card.scenario is not None:
        from bench.synthesis import read_scenario

        scenario = read_scenario(card.scenario)
        _refuse_unknown("recording", recording, [spec.name for spec in scenario.recordings])
        _refuse_unknown("camera", camera, [mounted.name for mounted in scenario.cameras])
    options.rendered_card(card, recording)
    data = Dataset(card=card, handles=open_dataset(card))
    opened = data[recording or data.names[0]]
    _refuse_unknown("camera", camera, opened.cameras)
    return opened, sorted(opened.cameras, key=lambda name: (name != camera, name))


def _refuse_unknown(kind: str, name: str | None, known: Collection[str]) -> None:
    if name is not None and name not in known:
        raise UnknownNameError(kind, name, known)


def _draw(
    pipeline: FramePipeline, indices: Sequence[int], out: Path | None, *, usual: Path, made_by: str, with_method: bool
) -> View:
    """Draw frames of a camera with their reference and what a method finds.

    The folder of a frame's pictures is named by its image: its index and the name of its file. Those of a single frame
    lie in the folder that was asked for itself.

    Raises:
        UsageError: the only frame has no score.
    """
    from bench.harness.frames import UnscorableFrame
    from bench.reporting.formats import file_name
    from bench.reporting.frame_pictures import write_frame_pictures

    named = usual / f"{file_name(pipeline.recording.name)}-{file_name(pipeline.camera.name)}"
    alone, files, remarks = len(indices) == 1, list[Path](), list[str]()
    for index in indices:
        name = f"{index:06d}-{file_name(pipeline.images[index].path.stem)}"
        place = out if out is not None and alone else (out or named) / name
        try:
            processed = pipeline.process(index) if with_method else None
            reference = pipeline.reference(index) if processed is None else processed.reference
            image = pipeline.images[index]
            files += write_frame_pictures(reference, image, pipeline, place, made_by=made_by, processed=processed)
        except UnscorableFrame as reason:
            if alone:
                raise UsageError(f"this frame has no score: {reason}") from reason
            remarks.append(f"left out: {reason}")
            continue
        not_scored = [_not_scored(target) for target in reference.objects if target.status != "evaluated"]
        remarks += [text if alone else f"{name}: {text}" for text in not_scored]
    return View(files=tuple(files), remarks=tuple(remarks))


def _not_scored(target: ReferenceObject) -> str:
    """For example "van 'v1': ignored, too few points (0)"."""
    from bench.records.reference import IgnoreReason

    what = f"{target.object_class} {target.track_id!r}"
    if target.reason is None:
        return f"{what}: does not move"
    number = f" ({target.points})" if target.reason is IgnoreReason.FEW_POINTS else ""
    return f"{what}: ignored, {target.reason.value.replace('_', ' ')}{number}"


Span = tuple[int | None, int | None, int]


def parsed_span(frame: str) -> Span:
    """First and last index, either of which may be left out, and step; of "N" both are that.

    Raises:
        UsageError: neither a number nor a span.
    """
    match = re.fullmatch(r"(\d{1,9})|(\d{0,9}):(\d{0,9})(?::(\d{1,9}))?", frame)
    if match is None:
        raise UsageError(f"--frame: expected N, FIRST:LAST or FIRST:LAST:STEP, got {frame!r}")
    if match[1]:
        return int(match[1]), int(match[1]), 1
    return int(match[2]) if match[2] else None, int(match[3]) if match[3] else None, int(match[4] or 1)


def chosen_frames(
    images: tuple[ImageRef, ...], *, history: int, span: Span | None, time_ns: int | None, all_else: bool = False
) -> range:
    """Indices of images.

    Args:
        images: of the camera.
        history: images before the first that can be chosen.
        span: of indices, as of `parsed_span`.
        time_ns: the image nearest to this time.
        all_else: without span or time all images, else the middle one.

    Raises:
        UsageError: an index that does not exist, or a time outside of the images.
    """
    import numpy as np

    last = len(images) - 1
    if history > last:
        raise UsageError(f"expected more than {history} images of the camera, got {len(images)}")
    if span is not None:
        first, end = history if span[0] is None else span[0], last if span[1] is None else span[1]
        if not (history <= first <= end <= last and span[2] > 0):
            raise UsageError(f"--frame: expected indices from {history} to {last}, rising, got {first}:{end}:{span[2]}")
        return range(first, end + 1, span[2])
    if time_ns is None:
        middle = max(len(images) // 2, history)
        return range(history, last + 1) if all_else else range(middle, middle + 1)
    times_ns = [image.timestamp_ns for image in images]
    away_ns = [abs(image_ns - time_ns) for image_ns in times_ns]
    index = away_ns.index(min(away_ns))
    if index < history or away_ns[index] > np.median(np.diff(times_ns)):
        raise UsageError(f"--time-ns: expected a time from {times_ns[history]} to {times_ns[-1]}, got {time_ns}")
    return range(index, index + 1)


def show(drawn: View) -> None:
    """Print what is left out, and the files."""
    for remark in drawn.remarks:
        say(remark)
    note_files(drawn.files)
