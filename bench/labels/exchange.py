"""From a tool's files to an annotation file of a recording, and back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from bench.errors import DataError, UnknownNameError
from bench.labels.formats import LabelOptions, Layer, label_format
from bench.recordings import DatasetCard, Recording, open_dataset, write_annotations


def open_unannotated(card: DatasetCard, name: str) -> Recording:
    """Open a recording without its annotations, which may be missing, old or wrong.

    Args:
        card: the data set.
        name: of the recording.

    Raises:
        UnknownNameError: no such recording.
        DataError: the data set cannot be opened, or takes no annotations.
    """
    with TemporaryDirectory() as folder:
        blank = replace(card, content=card.content.model_copy(update={"annotations": folder}))
        handles = {handle.name: handle for handle in open_dataset(blank)}
        if name not in handles:
            raise UnknownNameError("recording", name, handles)
        write_annotations(Path(folder) / f"{name}.json", ())
        return handles[name].open()


def import_labels(format_name: str, source: Path, recording: Recording, options: LabelOptions, *, file: Path) -> Layer:
    """Read a tool's files and write them as an annotation file.

    Args:
        format_name: of the tool's files.
        source: the tool's file or folder.
        recording: what was annotated.
        options: what the user says about the files.
        file: the annotation file.

    Returns:
        What was written, with one more line where sweeps have no frame.

    Raises:
        UnknownNameError: no such format.
        DataError: files that the format refuses, an object twice, or twice at one time.
    """
    layer = label_format(format_name).read(source, recording, options)
    _refuse_twice(layer, source)
    write_annotations(file, layer.tracks, timestamps_ns=layer.timestamps_ns)
    annotated = set(layer.timestamps_ns)
    missing = [sweep for sweep in recording.sweeps if sweep.timestamp_ns not in annotated]
    if not missing:
        return layer
    line = (
        f"{len(missing)} of {len(recording.sweeps)} sweeps have no frame in the source, first {missing[0].path.name}: "
        f"their images count as annotated and empty unless the card excludes them"
    )
    return replace(layer, lost=(*layer.lost, line))


def export_labels(
    format_name: str, recording: Recording, out: Path, options: LabelOptions
) -> tuple[Layer, tuple[str, ...]]:
    """Write a recording's annotations as a tool's files.

    Args:
        format_name: of the tool's files.
        recording: with its annotations; all its sweeps count as looked at.
        out: folder of the tool's files.
        options: what the files should look like.

    Returns:
        layer: what was handed to the format.
        lost: one line for each thing that it cannot hold.

    Raises:
        UnknownNameError: no such format.
        DataError: a recording without sweeps.
    """
    chosen = label_format(format_name)
    if not recording.sweeps:
        raise DataError(recording.root, expected="lidar sweeps, which tools label", got=f"none in {recording.name!r}")
    times_ns = {sweep.timestamp_ns for sweep in recording.sweeps}
    times_ns |= {state.timestamp_ns for track in recording.tracks for state in track.states}
    layer = Layer(tracks=recording.tracks, timestamps_ns=tuple(sorted(times_ns)))
    return layer, chosen.write(layer, recording, out, options)


def _refuse_twice(layer: Layer, source: Path) -> None:
    seen: set[str] = set()
    for track in layer.tracks:
        if track.track_id in seen:
            raise DataError(source, field=f"object {track.track_id!r}", expected="each object once", got="it twice")
        seen.add(track.track_id)
        times_ns = [state.timestamp_ns for state in track.states]
        if len(set(times_ns)) < len(times_ns):
            twice = next(time_ns for i, time_ns in enumerate(times_ns) if time_ns in times_ns[:i])
            field = f"object {track.track_id!r}"
            raise DataError(source, field=field, expected="one state at each time", got=f"two at {twice}")
