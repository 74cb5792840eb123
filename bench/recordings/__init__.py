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
    Cuboid,
    GroundPolygon,
    ImageRef,
    MountedCamera,
    ObjectState,
    PointIndices,
    Recording,
    SweepRef,
    Track,
)

__all__ = [
    "ADAPTERS",
    "Cuboid",
    "DatasetCard",
    "Exclusion",
    "GroundPolygon",
    "ImageRef",
    "MountedCamera",
    "ObjectState",
    "PointIndices",
    "Recording",
    "RecordingHandle",
    "RecordingWriter",
    "SweepRef",
    "Track",
    "chosen_recordings",
    "list_cards",
    "load_card",
    "open_dataset",
    "open_native",
    "read_annotations",
    "read_image",
    "read_truth",
    "write_annotations",
]
