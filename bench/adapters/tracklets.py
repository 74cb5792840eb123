"""KITTI's raw tracklets (`tracklet_labels.xml`): length along x, width along y, height along z, yaw about z.

The place of a box is the middle of its bottom; rx and ry are 0. A tracklet's frame is its first frame plus the number
of the pose. Other tools write files of the same tags with other meanings (`bench.annotation.formats.tracklets`).

`state` of a pose is 0 unset, 1 interpolated, 2 labelled; `occlusion` -1 unset, 0 visible, 1 partly, 2 fully;
`truncation` -1 unset, 0 in the image, 1 cut off (some tools write the share), 2 outside, 99 behind.

Source:
    The raw data's development kit (`tracklets.h`, `readTracklets.m`); its files carry a document type without any
    declaration, and some say `standalone="true"`, which XML does not know.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings.files import READ_BYTES, MeteredFile, numbers, xml_parts

LARGEST_ITEM_BYTES = 8_000_000  # ten thousand poses, a quarter of an hour
DEEPEST = 12  # levels of nested elements; the format has six, attributes that tools add two more
DECLARED = re.compile(rb"""\A(\s{0,9}<\?xml[^>]{0,200}standalone\s*=\s*)(["'])true\2""")
UNSET, LABELLED = 0, 2
CUT_OFF, OUTSIDE = 1, (2, 99)  # truncation
ID_ATTRIBUTE = "id"
POSE = ("tx", "ty", "tz", "rx", "ry", "rz")
UPRIGHT_RAD = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackletPose:
    """An object in one frame; numbers as the file has them.

    Attributes:
        number: of the frame.
        place_m: tx, ty, tz in the frame of the lidar.
        angles_rad: rx, ry, rz.
        state: see the module.
        occlusion: see the module.
        truncation: see the module.
    """

    number: int
    place_m: tuple[float, ...]
    angles_rad: tuple[float, ...]
    state: int
    occlusion: int
    truncation: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracklet:
    """An object.

    Attributes:
        label: class, as the tool calls it.
        hwl_m: what the file calls h, w and l.
        poses: by frame.
        name: the object's id; empty where it has none.
        not_read: how many other attributes it and its poses carry.
    """

    label: str
    hwl_m: tuple[float, ...]
    poses: tuple[TrackletPose, ...]
    name: str
    not_read: int


def read_tracklets(file: Path) -> tuple[Tracklet, ...]:
    """Read a file of tracklets; what it states as counts is not used.

    Raises:
        DataError: missing, cut short, not XML, with entities, nested too deeply, a number that is missing or none,
            nothing in it but a count of 0.
    """
    tracklets: list[Tracklet] = []
    counts: list[str] = []
    for element in xml_parts(
        file,
        level=2,
        parts="tracklets",
        largest_bytes=LARGEST_ITEM_BYTES,
        deepest=DEEPEST,
        outer=("boost_serialization", "tracklets"),
        forbid_dtd=False,
        prepare=_Declared,
    ):
        if element.tag == "count":
            counts.append((element.text or "").strip())
        elif element.tag == "item":
            tracklets.append(_tracklet(element, file, f"tracklets.item {len(tracklets)}"))
    if not tracklets and counts != ["0"]:
        raise DataError(file, field="tracklets", expected="tracklets, or a count of 0", got="neither")
    return tuple(tracklets)


class _Declared:
    """Says `standalone="yes"` where a file says "true"."""

    def __init__(self, source: MeteredFile) -> None:
        self._source, self._begun = source, False

    def read(self, size: int = READ_BYTES) -> bytes:
        content, first = self._source.read(size), not self._begun
        self._begun = True
        return DECLARED.sub(rb"\1\2yes\2", content) if first else content


def _tracklet(item: Element, file: Path, field: str) -> Tracklet:
    label = (item.findtext("objectType") or "").strip()
    if not label:
        raise DataError(file, field=f"{field}.objectType", expected="a class", got="nothing")
    hwl_m = tuple(_number(item, name, file, field) for name in "hwl")
    if min(hwl_m) <= 0:
        raise DataError(file, field=f"{field}.h, w, l", expected="sizes above 0", got=str(hwl_m))
    attributes = [(entry.findtext("name"), (entry.findtext("value") or "").strip()) for entry in item.iter("attribute")]
    names = [value for name, value in attributes if name == ID_ATTRIBUTE]
    first = _whole(item, "first_frame", file, field)
    entries = item.findall("poses/item")
    poses = tuple(_pose(entry, first + j, file, f"{field}.poses.item {j}") for j, entry in enumerate(entries))
    name = next(filter(None, names), "")
    return Tracklet(label=label, hwl_m=hwl_m, poses=poses, name=name, not_read=len(attributes) - len(names))


def _pose(entry: Element, number: int, file: Path, field: str) -> TrackletPose:
    tx, ty, tz, rx, ry, rz = (_number(entry, name, file, field) for name in POSE)
    share = re.fullmatch(r"0?\.[0-9]{1,20}", (entry.findtext("truncation") or "").strip())
    return TrackletPose(
        number=number,
        place_m=(tx, ty, tz),
        angles_rad=(rx, ry, rz),
        state=_whole(entry, "state", file, field, default=LABELLED),
        occlusion=_whole(entry, "occlusion", file, field, default=-1),
        truncation=CUT_OFF if share else _whole(entry, "truncation", file, field, default=-1),
    )


def _number(element: Element, name: str, file: Path, field: str) -> float:
    return numbers((element.findtext(name) or "").split(), 1, file=file, field=f"{field}.{name}")[0]


def _whole(element: Element, name: str, file: Path, field: str, default: int | None = None) -> int:
    text = element.findtext(name)
    if text is None and default is not None:
        return default
    text = (text or "").strip()
    if not re.fullmatch(r"-?[0-9]{1,9}", text):
        got = repr(text[:40]) if text else "nothing"
        raise DataError(file, field=f"{field}.{name}", expected="a whole number", got=got)
    return int(text)


def upright_box(pose: TrackletPose, height_m: float, file: Path, field: str) -> RigidTransform:
    """Pose of the box's centre in the frame of the lidar.

    Raises:
        DataError: a box that is tilted.
    """
    rx, ry, rz = pose.angles_rad
    if max(abs(rx), abs(ry)) > UPRIGHT_RAD:
        hint = "files of CVAT, which turns boxes about all axes, are read as cvat"
        raise DataError(file, field=f"{field}.rx, ry", expected="0", got=f"{rx:.4g} and {ry:.4g}", hint=hint)
    return RigidTransform.from_yaw(rz, np.add(pose.place_m, (0.0, 0.0, height_m / 2.0)))
