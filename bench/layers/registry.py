"""Formats of annotation layers by name."""

from __future__ import annotations

from bench.errors import UnknownNameError
from bench.layers.layer import LayerFormat
from bench.plug_ins import imported, known_places

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
    return known_places(ENTRY_POINTS, LAYER_FORMATS)


def layer_format(name: str) -> LayerFormat:
    """A format of annotation layers.

    Raises:
        UnknownNameError: no such format.
        UsageError: nothing to import where an installed package says that it is.
    """
    known = known_formats()
    if name not in known:
        raise UnknownNameError("format of annotations", name, known)
    found: LayerFormat = imported(known[name], expected=f"format {name!r}: expected a class")()
    return found
