"""Draw frames: the reference, what a method finds, lidar and calibration."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from bench.api.datasets import Dataset, rendered_card
from bench.api.runs import DEFAULT_PROTOCOL
from bench.errors import UnknownNameError, UsageError
from bench.evaluation import load_protocol
from bench.harness import FramePipeline, build_scorable
from bench.harness.frames import InputOnly, UnscorableFrame
from bench.harness.stages import Progress, no_progress
from bench.methods import Scorable
from bench.recordings import DatasetCard, ImageRef, Recording, open_dataset
from bench.records.reference import IgnoreReason
from bench.reference import ReferenceObject, Status
from bench.reporting.calibration_view import write_calibration
from bench.reporting.film import refuse_other_files, write_film
from bench.reporting.formats import file_name, made_by
from bench.reporting.frame_pictures import write_frame_pictures, write_reference_pictures

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
    dataset: str | Path | DatasetCard,
    *,
    recording: str | None = None,
    camera: str | None = None,
    frame: int | None = None,
    frames: str | None = None,
    time_ns: int | None = None,
    method: str | Scorable | None = None,
    settings: Mapping[str, object] | None = None,
    protocol: str | Path = DEFAULT_PROTOCOL,
    out: str | Path | None = None,
    video: str | Path | None = None,
    rrd: str | Path | None = None,
    lidar: bool = True,
    progress: Progress | None = None,
) -> View:
    """Draw frames with their reference and, where a method is given, with what it finds, as `fisheye-bench view` does.

    Args:
        dataset: card, by path or by a name that `fisheye-bench list` shows.
        recording: name; None for the first.
        camera: name; None for the first.
        frame: index of the image; None for the middle one, of a video or log for all.
        frames: several, as "FIRST:LAST" or "FIRST:LAST:STEP", the last one included.
        time_ns: the image nearest to this time.
        method: by name, as "module:Class", or an object; None for the reference alone.
        settings: parameters of a method that is given by name.
        protocol: of the reference, by name or file.
        out: folder of pictures; None for `reports/runs/view/<recording>-<camera>/<image>`, none beside a video or log.
        video: file (.mp4, .webm, .avi) of true and false areas; None for none.
        rrd: file for the viewer rerun (the optional extra `viewer`), with lidar and boxes; None for none.
        lidar: draw lidar points into the video.
        progress: called with the images of video or log that are drawn, and their number.

    Raises:
        UnknownNameError: no data set, recording, camera, method or protocol of this name.
        UsageError: two choices of frames, or one that does not exist or cannot be scored; a suffix or codec that is
            missing; settings without the name of a method.
        DataError: an image or sweep that cannot be read.
    """
    if settings and not isinstance(method, str):
        raise UsageError("settings: expected the name of a method, whose settings they are")
    built = build_scorable(method, settings) if isinstance(method, str) else method or InputOnly(history=0)
    rules = load_protocol(protocol)
    film, log = _path(video), _path(rrd)
    refuse_other_files(video=film, rrd=log)
    opened, cameras = _open(dataset, recording, camera)
    pipeline = FramePipeline(opened, cameras[0], method=built, protocol=rules)
    made = rules.name if method is None else made_by(built.name, rules.name)
    filmed = film is not None or log is not None
    indices = chosen_frames(
        pipeline.images, history=built.history, frame=frame, frames=frames, time_ns=time_ns, all_without=filmed
    )
    with_method, files, remarks = method is not None, [], []
    if filmed:
        files += write_film(
            pipeline,
            indices,
            video=film,
            rrd=log,
            lidar=lidar,
            made_by=made,
            with_method=with_method,
            progress=progress or no_progress,
        )
    if out is not None or not filmed:
        for index in indices:
            place = _picture_folder(pipeline, index, _path(out), alone=len(indices) == 1)
            try:
                drawn, objects = _draw(pipeline, index, place, made_by=made, with_method=with_method)
            except UnscorableFrame as reason:
                if len(indices) == 1:
                    raise UsageError(f"this frame has no score: {reason}") from reason
                remarks.append(f"left out: {reason}")
                continue
            files += drawn
            of_frame = "" if len(indices) == 1 else f"{place.name}: "
            remarks += [f"{of_frame}{_not_scored(one)}" for one in objects if one.status is not Status.EVALUATED]
    return View(files=tuple(files), remarks=tuple(remarks))


def view_calibration(
    dataset: str | Path | DatasetCard,
    *,
    recording: str | None = None,
    camera: str | None = None,
    frame: int | None = None,
    frames: str | None = None,
    time_ns: int | None = None,
    out: str | Path | None = None,
    rrd: str | Path | None = None,
    progress: Progress | None = None,
) -> View:
    """Draw lidar, road, lens and flow by ego-motion onto images, as `fisheye-bench view --calibration` does.

    Args:
        dataset: as of `view`.
        recording: name; None for the first.
        camera: name; None for each.
        frame: as of `view`.
        frames: as of `view`.
        time_ns: as of `view`.
        out: folder of pictures; None for `reports/runs/view`.
        rrd: file for the viewer rerun (the optional extra `viewer`); None for none.
        progress: called with the pictures that are drawn, and their number.

    Raises:
        UnknownNameError: no data set, recording or camera of this name.
        UsageError: two choices of frames, or one that does not exist; a suffix that is none of a log.
        DataError: an image or its sweep cannot be read.
    """
    refuse_other_files(video=None, rrd=_path(rrd))
    opened, cameras = _open(dataset, recording, camera)
    choose = partial(chosen_frames, history=1, frame=frame, frames=frames, time_ns=time_ns, all_without=False)
    files = write_calibration(
        opened,
        {name: choose(opened.images[name]) for name in (cameras if camera is None else [camera])},
        out=_path(out) or PICTURES,
        rrd=_path(rrd),
        progress=progress or no_progress,
    )
    return View(files=tuple(files))


def _open(dataset: str | Path | DatasetCard, recording: str | None, camera: str | None) -> tuple[Recording, list[str]]:
    """A recording and the names of its cameras, the one that is asked for first.

    Raises:
        UnknownNameError: no such recording or camera.
    """
    card = rendered_card(dataset)
    data = Dataset(card=card, handles=open_dataset(card))
    opened = data[recording or data.names[0]]
    if camera is not None and camera not in opened.cameras:
        raise UnknownNameError("camera", camera, opened.cameras)
    return opened, sorted(opened.cameras, key=lambda name: (name != camera, name))


def _path(file: str | Path | None) -> Path | None:
    return None if file is None else Path(file)


def _picture_folder(pipeline: FramePipeline, index: int, out: Path | None, *, alone: bool) -> Path:
    """Folder of a frame's pictures, named by its image: its index and the name of its file.

    Those of a single frame lie in the folder that was asked for itself.
    """
    if out is not None and alone:
        return out
    usual = PICTURES / f"{file_name(pipeline.recording.name)}-{file_name(pipeline.camera.name)}"
    return (out or usual) / f"{index:06d}-{file_name(pipeline.images[index].path.stem)}"


def _draw(
    pipeline: FramePipeline, index: int, place: Path, *, made_by: str, with_method: bool
) -> tuple[list[Path], Sequence[ReferenceObject]]:
    """Draw a frame; the files, and its annotated objects."""
    if not with_method:
        objects = pipeline.reference(index).objects
        return [*write_reference_pictures(pipeline, index, place, made_by=made_by)], objects
    processed = pipeline.process(index)
    return [*write_frame_pictures(processed, pipeline, place, made_by=made_by)], processed.reference.objects


def _not_scored(found: ReferenceObject) -> str:
    """For example "van 'v1': ignored, too few points (0)"."""
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
    times_ns = [image.timestamp_ns for image in images]
    index = int(np.argmin([abs(time - time_ns) for time in times_ns]))
    first, last = times_ns[history], times_ns[-1]
    step_ns = int(np.median(np.diff(times_ns)))
    if index < history or abs(times_ns[index] - time_ns) > step_ns:
        raise UsageError(f"--time-ns: expected a time from {first} to {last}, got {time_ns}")
    return range(index, index + 1)
