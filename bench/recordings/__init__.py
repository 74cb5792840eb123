"""Recordings: what a drive is (`records`), the native format, and the adapters that read other data sets into it.

Opening a recording reads calibration, lists of files, ego-motion and annotations; images and sweeps are read one by one
when they are wanted. Every fault of a file is a `DataError` that names file and field. Adapters translate a data set's
conventions once, here, so that no other package depends on the data set.
"""

from bench.recordings.annotations import read_annotations
from bench.recordings.cards import DatasetCard, Exclusion, list_cards, load_card
from bench.recordings.catalogue import ADAPTERS, RecordingHandle, chosen_recordings, open_dataset
from bench.recordings.images import read_image, read_truth
from bench.recordings.native import open_native
from bench.recordings.writing import RecordingWriter, write_annotations
from bench.records.recording import (
    COMPLETELY,
    MOTION_KINDS,
    NO_INPUT_ERRORS,
    NOT_ANNOTATED,
    Annotated,
    Cuboid,
    GroundPolygon,
    ImageRef,
    InputErrors,
    MountedCamera,
    ObjectShape,
    ObjectState,
    PointIndices,
    Recording,
    SweepRef,
    Track,
    frame_gaps,
)
from bench.records.reference import OBJECT_CLASSES

__all__ = [
    "ADAPTERS",
    "COMPLETELY",
    "MOTION_KINDS",
    "NOT_ANNOTATED",
    "NO_INPUT_ERRORS",
    "OBJECT_CLASSES",
    "Annotated",
    "Cuboid",
    "DatasetCard",
    "Exclusion",
    "GroundPolygon",
    "ImageRef",
    "InputErrors",
    "MountedCamera",
    "ObjectShape",
    "ObjectState",
    "PointIndices",
    "Recording",
    "RecordingHandle",
    "RecordingWriter",
    "SweepRef",
    "Track",
    "chosen_recordings",
    "frame_gaps",
    "list_cards",
    "load_card",
    "open_dataset",
    "open_native",
    "read_annotations",
    "read_image",
    "read_truth",
    "write_annotations",
]
