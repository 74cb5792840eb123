"""Formats of annotation layers by name."""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import entry_points

from bench.errors import UnknownNameError, UsageError
from bench.layers.layer import LayerFormat

ENTRY_POINTS = "fisheye_bench.layers"

LAYER_FORMATS = {
    "openlabel": "bench.layers.openlabel_format:OpenLabelFormat",
    "kitti-tracklets": "bench.layers.kitti_tracklets:KittiTracklets",
    "cvat-tracklets": "bench.layers.kitti_tracklets:CvatTracklets",
    "sustechpoints": "bench.layers.sustechpoints:SustechPoints",
    "labelcloud-centroid-abs": "bench.layers.labelcloud:LabelCloudCentroidAbs",
    "labelcloud-centroid-rel": "bench.layers.labelcloud:LabelCloudCentroidRel",
    "labelcloud-vertices": "bench.layers.labelcloud:LabelCloudVertices",
    "semantickitti": "bench.layers.semantickitti:SemanticKitti",
}


def known_formats() -> dict[str, str]:
    """Name -> "module:Class" of the package's formats and of those that installed packages add."""
    added = {point.name: point.value for point in entry_points(group=ENTRY_POINTS)}
    return added | LAYER_FORMATS


def layer_format(name: str) -> LayerFormat:
    """A format of annotation layers.

    Raises:
        UnknownNameError: no such format.
        UsageError: nothing to import where an installed package says that it is.
    """
    known = known_formats()
    if name not in known:
        raise UnknownNameError("format of annotations", name, known)
    module, _, attribute = known[name].partition(":")
    try:
        found: LayerFormat = getattr(import_module(module), attribute)()
    except (ImportError, AttributeError) as error:
        raise UsageError(f"format {name!r}: wanted a class that can be imported; {error}") from error
    return found
