"""Annotation layers of other tools <-> tracks.

A format reads a tool's files into a `Layer` and writes one back. Tools label in the frame of the lidar, sweep by sweep;
layers speak of the vehicle frame at each state's time. What does not fit through is never dropped in silence: it stands
in the layer's `lost`, or it is an error. Called by the command line alone.
"""

from bench.layers.exchange import export_layer, import_layer, open_unannotated
from bench.layers.formats import LAYER_FORMATS, Layer, LayerFormat, LayerOptions, known_formats, layer_format
from bench.layers.openlabel_calibration import calibration_text

__all__ = [
    "LAYER_FORMATS",
    "Layer",
    "LayerFormat",
    "LayerOptions",
    "calibration_text",
    "export_layer",
    "import_layer",
    "known_formats",
    "layer_format",
    "open_unannotated",
]
