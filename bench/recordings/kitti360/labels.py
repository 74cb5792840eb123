"""The labels of KITTI-360 that can move, and what they are here."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Label:
    """A label that things which move can have.

    Attributes:
        name: as the data set writes it.
        number: its number in label images and global ids.
        kitti_number: its number in the files of boxes, there called semanticId.
        object_class: what it is here.
    """

    name: str
    number: int
    kitti_number: int
    object_class: str


# name, number, number in the files of boxes, class; the numbers are facts of the data set's label table.
_TABLE = (
    ("person", 24, 19, "pedestrian"),
    ("rider", 25, 20, "cyclist"),
    ("car", 26, 13, "vehicle"),
    ("truck", 27, 14, "vehicle"),
    ("bus", 28, 34, "vehicle"),
    ("caravan", 29, 16, "vehicle"),
    ("trailer", 30, 15, "vehicle"),
    ("train", 31, 33, "vehicle"),
    ("motorcycle", 32, 17, "cyclist"),
    ("bicycle", 33, 18, "cyclist"),
    ("unknown vehicle", 43, 36, "vehicle"),
)
LABELS = tuple(Label(name=n, number=i, kitti_number=k, object_class=c) for n, i, k, c in _TABLE)
BY_KITTI_NUMBER = {label.kitti_number: label for label in LABELS}
BY_NAME = {label.name: label for label in LABELS} | {
    "pedestrian": LABELS[0],
    "unknownVehicle": LABELS[-1],
}
GLOBAL_ID_STEP = 1000  # global id = number * 1000 + instance
