"""KITTI-360's files of boxes, read object by object: an XML file may hold tens of thousands.

A child `object<n>` is a box (or the outline of a building, a road, ...): `transform` maps its local `vertices` into the
global world and holds the size of the box as a scale, so orientation and size come from a polar decomposition. What
stands has `timestamp` -1, what moves one child per frame, joined by semanticId and instanceId. `start_frame` and
`end_frame` are the stretch of the drive that was annotated together, not the time for which the object is seen
(kitti360Scripts #103).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import polar

from bench.errors import DataError
from bench.recordings.files import numbers, xml_parts


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
BY_NAME = {label.name: label for label in LABELS} | {"pedestrian": LABELS[0], "unknownVehicle": LABELS[-1]}
GLOBAL_ID_STEP = 1000  # global id = number * 1000 + instance


LARGEST_OBJECT_BYTES = 32_000_000  # of XML without the end of a child of the root
LARGEST_MATRIX = 1_000_000  # numbers
DEEPEST = 50
STATIONARY = -1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WorldBox:
    """A box at a frame, or a stationary one.

    Attributes:
        key: what joins the boxes of one object.
        label: None for one that is marked dynamic but has a label that is not known to move.
        dynamic: as marked.
        frame: of the box; -1 for a stationary one.
        window: first and last annotated frame; None where the file does not say.
        rotation: (3, 3) float64, global world from box, a proper rotation.
        centre_m: (3,) float64, global world.
        size_m: (3,) float64, full lengths along the box's own axes.
    """

    key: str
    label: Label | None
    dynamic: bool
    frame: int
    window: tuple[int, int] | None
    rotation: NDArray[np.float64]
    centre_m: NDArray[np.float64]
    size_m: NDArray[np.float64]


def read_boxes(file: Path) -> Iterator[WorldBox | tuple[int, int]]:
    """Read the boxes of everything that can move.

    Args:
        file: of boxes.

    Yields:
        Boxes in the order of the file; for every other object its window of annotated frames, if it has one.

    Raises:
        DataError: missing, cut short, not XML, with a document type or entities, or an object that is not whole.
    """
    for element in xml_parts(file, level=1, parts="objects", largest_bytes=LARGEST_OBJECT_BYTES, deepest=DEEPEST):
        box = _object(element, file)
        if box is not None:
            yield box


def _object(element: Element, file: Path) -> WorldBox | tuple[int, int] | None:
    if element.find("transform") is None:
        return None
    field = element.tag
    window = _window(element, file)
    semantic, name = _integer(element, "semanticId", file), (element.findtext("label") or "").strip()
    label = BY_NAME.get(name) if semantic is None else BY_KITTI_NUMBER.get(semantic)
    dynamic = bool(_integer(element, "dynamic", file) or 0)
    if label is None and not dynamic:
        return window
    rotation, centre_m, size_m = _placed(element, file)
    frame = _integer(element, "timestamp", file)
    if frame is None or frame < STATIONARY:
        raise DataError(file, field=f"{field}.timestamp", expected="a frame number, or -1", got=str(frame))
    return WorldBox(
        key=_key(element, label, semantic, file),
        label=label,
        dynamic=dynamic,
        frame=frame,
        window=window,
        rotation=rotation,
        centre_m=centre_m,
        size_m=size_m,
    )


def _key(element: Element, label: Label | None, semantic: int | None, file: Path) -> str:
    instance = _integer(element, "instanceId", file)
    if semantic is not None and instance:
        return str((label.number if label else 10_000 + semantic) * GLOBAL_ID_STEP + instance)
    sequence = _integer(element, "dynamicSeq", file)
    if sequence is not None and sequence >= 0 and _integer(element, "dynamic", file):
        return f"dynamic-{sequence}"
    return f"index-{_integer(element, 'index', file)}-{element.tag}"


def _window(element: Element, file: Path) -> tuple[int, int] | None:
    first, last = _integer(element, "start_frame", file), _integer(element, "end_frame", file)
    if first is None or last is None or first < 0 or last < 0:
        return None
    if last < first:
        raise DataError(file, field=f"{element.tag}.end_frame", expected=f"{first} or later", got=str(last))
    return first, last


def _integer(element: Element, name: str, file: Path) -> int | None:
    text = (element.findtext(name) or "").strip()
    if not text:
        return None
    try:
        value = int(text)
    except ValueError:
        value = 1 << 40
    if abs(value) >= 1 << 31:
        raise DataError(file, field=f"{element.tag}.{name}", expected="a whole number", got=repr(text[:40]))
    return value


def _placed(element: Element, file: Path) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Rotation, centre and size of the box around the vertices, along the axes of the transform."""
    transform = _matrix(element, "transform", file)
    vertices = _matrix(element, "vertices", file)
    if transform.shape != (4, 4) or vertices.shape[1] != 3:
        got = f"{transform.shape} and {vertices.shape}"
        raise DataError(file, field=element.tag, expected="a transform (4, 4) and vertices (N, 3)", got=got)
    mirror = np.array([-1.0 if np.linalg.det(transform[:3, :3]) < 0 else 1.0, 1.0, 1.0])
    rotation, stretch = polar(transform[:3, :3] * mirror)
    corners = (vertices * mirror) @ stretch.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    if not (np.linalg.det(rotation) > 0.5 and (high - low > 1e-3).all()):
        got = f"one of {np.array2string((high - low), precision=3)} m"
        raise DataError(file, field=f"{element.tag}.transform", expected="a box with length, width and height", got=got)
    return np.asarray(rotation), rotation @ ((low + high) / 2) + transform[:3, 3], high - low


def _matrix(element: Element, name: str, file: Path) -> NDArray[np.float64]:
    field = f"{element.tag}.{name}"
    node = element.find(name)
    if node is None:
        raise DataError(file, field=field, expected="a matrix", got="none")
    rows, columns = _integer(node, "rows", file) or 0, _integer(node, "cols", file) or 0
    if rows < 1 or columns < 1 or rows * columns > LARGEST_MATRIX:
        raise DataError(file, field=field, expected="rows and cols", got=f"{rows} and {columns}")
    words = (node.findtext("data") or "").split()
    return np.array(numbers(words, rows * columns, file=file, field=f"{field}.data")).reshape(rows, columns)
