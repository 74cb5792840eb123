"""Pictures of single frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from bench.cli.console import console
from bench.cli.rendering import render_if_synthetic
from bench.cli.settings import parse_settings
from bench.errors import UnknownNameError, UsageError
from bench.evaluation import Protocol, load_protocol
from bench.harness import FramePipeline, read_tables
from bench.methods import Method, build_method
from bench.recordings import DatasetCard, RecordingHandle, load_card, open_dataset
from bench.reporting.frame_pictures import telling_frames, write_frame_pictures


def view(
    dataset: str,
    *,
    recording: str | None,
    camera: str | None,
    frame: int | None,
    method: str,
    settings: Sequence[str],
    protocol: str,
    out: Path,
) -> None:
    """Draw one frame and print the files."""
    card = load_card(dataset)
    chosen = build_method(method, parse_settings(settings))
    render_if_synthetic(card)
    opened = _pick(open_dataset(card), recording).open()
    name = camera or sorted(opened.cameras)[0]
    if name not in opened.cameras:
        raise UnknownNameError("camera", name, opened.cameras)
    pipeline = FramePipeline(opened, name, method=chosen, protocol=load_protocol(protocol))
    index = len(pipeline.images) // 2 if frame is None else frame
    if not chosen.history <= index < len(pipeline.images):
        raise UsageError(f"--frame: wanted {chosen.history} to {len(pipeline.images) - 1}, came {index}")
    for file in write_frame_pictures(pipeline.process(index), pipeline, out):
        console().print(str(file), highlight=False, soft_wrap=True)


def draw_telling_frames(
    card: DatasetCard,
    run: Path,
    *,
    method: Method,
    protocol: Protocol,
    split: str | None,
    progress: Callable[[float, int], None],
) -> list[Path]:
    """Draw the frame of every category in which an object fills most pixels, into `<run>/pictures`."""
    handles = {handle.name: handle for handle in open_dataset(card, split)}
    objects, _ = read_tables(run)
    frames, files = telling_frames(objects), list[Path]()
    for number, (category, (recording, camera, timestamp_ns)) in enumerate(frames.items(), start=1):
        pipeline = FramePipeline(handles[recording].open(), camera, method=method, protocol=protocol)
        index = [image.timestamp_ns for image in pipeline.images].index(timestamp_ns)
        files += write_frame_pictures(pipeline.process(index), pipeline, run / "pictures" / category.value)
        progress(number, len(frames))
    return files


def _pick(handles: Sequence[RecordingHandle], name: str | None) -> RecordingHandle:
    by_name = {handle.name: handle for handle in handles}
    if name is None:
        return handles[0]
    if name not in by_name:
        raise UnknownNameError("recording", name, by_name)
    return by_name[name]
