"""Annotation layers of other tools <-> tracks.

A format reads a tool's files into a `Layer` and writes one back. Tools label in the frame of the lidar, sweep by sweep;
layers speak of the vehicle frame at each state's time. What does not fit through is never dropped in silence: it stands
in the layer's `lost`, or it is an error. Called by the command line alone.
"""

from bench.labels.formats import (
    LABEL_FORMATS,
    LabelFormat,
    LabelOptions,
    Layer,
    export_labels,
    import_labels,
    known_formats,
    label_format,
    open_unannotated,
)
from bench.labels.openlabel_calibration import calibration_text

__all__ = [
    "LABEL_FORMATS",
    "LabelFormat",
    "LabelOptions",
    "Layer",
    "calibration_text",
    "export_labels",
    "import_labels",
    "known_formats",
    "label_format",
    "open_unannotated",
]
