"""The reference: which moving objects an image shows, and the polygon of each.

Annotation -> lidar points on the object -> where they were at exposure -> pixels -> bounding polygon -> occlusion.
Beside it the words of the protocol: category and direction of motion, and why an object is ignored.

Source:
    Mariotti and Eising, section IV-B: moving objects are annotated in the lidar point cloud and projected into the
    image, where a bounding reference polygon is generated.
"""

from bench.records.reference import (
    Category,
    Direction,
    IgnoreReason,
    ReferenceFrame,
    ReferenceObject,
    Status,
)
from bench.records.rules import MotionSettings, OutlineErrors, ReferenceSettings
from bench.reference.build import ReferenceBuilder
from bench.reference.exposure import visible_region
from bench.reference.regions import REGION_KINDS

__all__ = [
    "REGION_KINDS",
    "Category",
    "Direction",
    "IgnoreReason",
    "MotionSettings",
    "OutlineErrors",
    "ReferenceBuilder",
    "ReferenceFrame",
    "ReferenceObject",
    "ReferenceSettings",
    "Status",
    "visible_region",
]
