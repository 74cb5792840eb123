"""Label formats of other tools <-> tracks.

A format reads a tool's files into a `LabelSet` and writes one back. Tools label in the frame of the lidar, sweep by
sweep; label sets are in the vehicle frame at each state's time. What does not fit is never dropped in silence: it
stands in the label set's `lost`, or it is an error.
"""

from bench.labels.formats import (
    LABEL_FORMATS,
    LabelFormat,
    LabelOptions,
    LabelSet,
    describe_labels,
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
    "LabelSet",
    "calibration_text",
    "describe_labels",
    "export_labels",
    "import_labels",
    "known_formats",
    "label_format",
    "open_unannotated",
]
