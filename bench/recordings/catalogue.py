"""From a data set's card to its recordings, not opened yet: the adapters, and what of a data set a split holds."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from bench.errors import DataError, UnknownNameError
from bench.plug_ins import imported, known_targets
from bench.recordings.annotations import REVIEW_SUFFIX, annotated_as, annotation_file_in
from bench.recordings.cards import DatasetCard, Exclusion
from bench.records.recording import NO_INPUT_ERRORS, NOT_ANNOTATED, Annotated, ImageRef, InputErrors, Recording

ADAPTERS = {
    "native": "bench.recordings.native:native_recordings",
    "aimotive": "bench.adapters.aimotive:aimotive_recordings",
    "kitti-raw": "bench.adapters.kitti_raw:kitti_raw_recordings",
    "kitti360": "bench.adapters.kitti360:kitti360_recordings",
    "woodscape": "bench.adapters.woodscape:woodscape_recordings",
    "rosbag": "bench.adapters.rosbag:rosbag_recordings",
    "123d": "bench.adapters.log123d:log123d_recordings",
}
ENTRY_POINTS = "fisheye_bench.adapters"
SHOWN = 10  # names that a message lists
FIRST_IMAGES = re.compile(r"\[:([1-9][0-9]{0,8})\]$")


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingHandle:
    """A recording by name; it travels to other processes and is opened there.

    Attributes:
        name: of the recording.
        opener: opens it; a function of a module, or a `functools.partial` of one. The first error ends it.
        exclusions: images that are left out on opening.
        first_images: of each camera that is left, how many there are after opening; None for all.
        input_errors: injected into the method's input.
        annotated: what the card says is annotated of a recording that is; None for what that says itself.
    """

    name: str
    opener: Callable[[], Recording]
    exclusions: tuple[Exclusion, ...] = ()
    first_images: int | None = None
    input_errors: InputErrors = NO_INPUT_ERRORS
    annotated: Annotated | None = None

    def open(self) -> Recording:
        """Open the recording: calibration, lists of images and sweeps, ego-motion and annotations; no bulk data.

        Raises:
            DataError: something in it is not what the format asks for, or an exclusion leaves none of its images out.
        """
        recording = self.opener()
        for exclusion in self.exclusions:
            _refuse_void(exclusion, recording)
        images = {camera: self._included(refs)[: self.first_images] for camera, refs in recording.images.items()}
        by_card = None if recording.annotated == NOT_ANNOTATED else self.annotated
        annotated = by_card or recording.annotated
        return replace(recording, images=images, annotated=annotated, input_errors=self.input_errors)

    def _included(self, refs: tuple[ImageRef, ...]) -> tuple[ImageRef, ...]:
        return tuple(
            ref for i, ref in enumerate(refs) if not any(e.covers(i, ref.timestamp_ns) for e in self.exclusions)
        )


def _refuse_void(exclusion: Exclusion, recording: Recording) -> None:
    """Refuse an exclusion that leaves nothing out: its times may be in another unit, or of another drive."""
    images = [(i, ref.timestamp_ns) for refs in recording.images.values() for i, ref in enumerate(refs)]
    if images and not any(exclusion.covers(*image) for image in images):
        (last, _), times_ns = max(images), [time_ns for _, time_ns in images]
        limits = exclusion.model_dump(include={"frames", "timestamps_ns"}, exclude_none=True)
        raise DataError(
            f"exclusions of {recording.name}",
            expected=f"images that they leave out, of {last + 1} from {min(times_ns)} to {max(times_ns)} ns",
            got=f"{limits}, which leave none out ({exclusion.reason})",
            hint="correct the card: frames count from 0, times are nanoseconds",
        )


def handles_of(
    folders: Iterable[Path], open_folder: Callable[..., Recording], annotations: Path | None
) -> tuple[RecordingHandle, ...]:
    """Handles of recordings that lie in a folder each and are called as it.

    Args:
        folders: of the recordings, in the order that the handles have.
        open_folder: opens one; called with its folder and `annotations`, the file that stands in for its own or None.
        annotations: folder of such files; None for none.
    """

    def opener(folder: Path) -> Callable[[], Recording]:
        return partial(open_folder, folder, annotations=annotation_file_in(annotations, folder.name))

    return tuple(RecordingHandle(name=folder.name, opener=opener(folder)) for folder in folders)


def median_interval_ns(images: Mapping[str, Sequence[ImageRef]], *, file: Path) -> int:
    """Median time between the images of a camera, of all cameras, where a data set does not state it.

    Raises:
        DataError: no camera of the `file` has two images.
    """
    steps_ns = [np.diff([image.timestamp_ns for image in refs]) for refs in images.values()]
    if not sum(map(len, steps_ns)):
        raise DataError(file, expected="two images of a camera at least", got="fewer")
    return int(np.median(np.concatenate(steps_ns)))


class Adapter(Protocol):
    """Adapter of a data set: a function that lists the recordings below a folder without opening them."""

    def __call__(
        self, root: Path, *, options: Mapping[str, Any], card: Path, annotations: Path | None
    ) -> tuple[RecordingHandle, ...]:
        """List recordings.

        Args:
            root: the data set's folder, which exists.
            options: the card's `options`, for the adapter to validate.
            card: the card's file, for messages.
            annotations: folder of `<recording>.json` files that stand in for the data set's own annotations where
                they exist; None for none.

        Raises:
            DataError: options that are wrong, or a folder that is not of this data set.
        """
        ...


def known_adapters() -> dict[str, str]:
    """Name -> "module:function" of the package's adapters and of those that installed packages add."""
    return known_targets(ENTRY_POINTS, ADAPTERS)


def describe_adapter(target: str) -> str:
    """Describe an adapter in one line: the first of its docstring.

    Args:
        target: "module:function".

    Raises:
        UsageError: nothing to import there.
    """
    adapter = imported(target, expected=f"adapter {target!r}: expected a function")
    return next(iter((inspect.getdoc(adapter) or "").splitlines()), "")


def open_dataset(card: DatasetCard, split: str | None = None) -> tuple[RecordingHandle, ...]:
    """The recordings of a split, not opened yet, so that one that fails does not stop the others.

    Args:
        card: the data set.
        split: name of a split, or recordings with commas in between; None for every recording. Behind it `[:N]` for
            the first N images of each camera alone, as if each recording ended there.

    Raises:
        UnknownNameError: no such split or adapter.
        UsageError: nothing to import where an installed package says that its adapter is.
        DataError: the data or the folder of annotations is not there, the options are wrong, or a named recording does
            not exist.
    """
    listed = _listed(card)
    handles = {handle.name: handle for handle in listed}
    if len(handles) < len(listed):
        twice = next(handle.name for handle in listed if handles[handle.name] is not handle)
        raise DataError(card.root, expected="recordings of different names", got=f"{twice!r} twice")
    for name in handles:
        if any("\ud800" <= character <= "\udfff" for character in name):
            raise DataError(card.root, expected="recordings with names in UTF-8", got=repr(name), hint="rename it")
    if not handles:
        expected, hint = f"recordings of the adapter {card.content.adapter!r}", card.content.how_to_get
        raise DataError(card.root, expected=expected, got="none", hint=hint)
    names, limit = chosen_recordings(card, split, tuple(handles))
    excluded = card.content.exclusions
    _refuse_unknown((e.recording for e in excluded), handles, card, "exclusions")
    _refuse_strange_annotations(card, handles)
    whole = {e.recording for e in excluded if e.covers_all}
    annotated = None if card.content.annotated is None else annotated_as(card.content.annotated)
    return tuple(
        replace(
            handles[name],
            annotated=annotated,
            exclusions=tuple(e for e in excluded if e.recording == name),
            first_images=limit,
        )
        for name in names
        if name not in whole
    )


def chosen_recordings(card: DatasetCard, split: str | None, known: Sequence[str]) -> tuple[tuple[str, ...], int | None]:
    """The recordings that a split names, and how many images of each camera it takes; None for all.

    Args:
        card: the data set.
        split: as of `open_dataset`.
        known: names of the data set's recordings.

    Raises:
        UnknownNameError: no such split.
        DataError: a split of the card names a recording that does not exist, or has the name of one and is another.
    """
    for name, recordings in card.content.splits.items():
        if name in known and recordings != (name,):
            expected, got = "splits with other names than recordings", f"{name!r}, which is a recording too"
            raise DataError(card.file, field=f"splits.{name}", expected=expected, got=got, hint="rename the split")
    limited = FIRST_IMAGES.search(split or "")
    limit = int(limited[1]) if limited else None
    name = FIRST_IMAGES.sub("", split or "")
    if not name and (limited or split is None):
        return tuple(known), limit
    if name not in card.content.splits:
        recordings = tuple(name.split(","))
        if not set(known) >= set(recordings) or len(set(recordings)) < len(recordings):
            nearest = get_close_matches(name, known, n=SHOWN, cutoff=0.0)
            hint = "separate recordings by commas, each once"
            raise UnknownNameError("split or recording", name, [*card.content.splits, *nearest], hint=hint)
        return recordings, limit
    chosen = card.content.splits[name]
    names = tuple(known) if chosen == "*" else chosen
    _refuse_unknown(names, known, card, f"splits.{name}")
    return names, limit


def _listed(card: DatasetCard) -> tuple[RecordingHandle, ...]:
    known = known_adapters()
    if (name := card.content.adapter) not in known:
        raise UnknownNameError("adapter", name, known, hint=f"correct it in {card.file}")
    adapter: Adapter = imported(known[name], expected=f"adapter {name!r}: expected a function")
    if not card.root.is_dir():
        hint, got = card.content.how_to_get or "see the card", f"{card.root}, which is missing"
        raise DataError(card.file, field="root", expected="a folder with the data", got=got, hint=hint)
    return adapter(card.root, options=card.content.options, card=card.file, annotations=card.annotations)


def _refuse_unknown(names: Iterable[str], known: Collection[str], card: DatasetCard, field: str) -> None:
    for name in names:
        if name not in known:
            some = ", ".join(sorted(known)[:SHOWN])
            raise DataError(card.file, field=field, expected=f"recordings of {card.root}: {some}", got=repr(name))


def _refuse_strange_annotations(card: DatasetCard, handles: Mapping[str, RecordingHandle]) -> None:
    """Refuse a folder of annotations that nobody reads: old ones would be scored, or none, without a word."""
    folder = card.annotations
    if folder is None:
        return
    if not folder.is_dir():
        hint = "the path counts from the card's own folder; correct it, or take the key out"
        expected, got = "a folder of <recording>.json files", f"{folder}, which is missing"
        raise DataError(card.file, field="annotations", expected=expected, got=got, hint=hint)
    files = sorted(file for file in folder.glob("*.json") if not file.name.endswith(REVIEW_SUFFIX))
    if files and not any(file.stem in handles for file in files):
        expected = f"files called as recordings in {folder}: {', '.join(sorted(handles)[:SHOWN])}"
        raise DataError(card.file, field="annotations", expected=expected, got=f"{len(files)}, as {files[0].name}")
