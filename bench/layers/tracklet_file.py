"""The XML of KITTI's raw tracklets, item by item.

An item is one object: type, height, width and length, the number of its first frame, and a pose for each frame from
there on. `state` is 0 unset, 1 interpolated, 2 labelled; `occlusion` -1 unset, 0 visible, 1 partly, 2 fully;
`truncation` -1 unset, 0 in the image, 1 cut off, 2 outside, 99 behind.

Source:
    The raw data's development kit (`tracklets.h`, `readTracklets.m`); its files carry a document type without any
    declaration, and some say `standalone="true"`, which XML does not know.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, SubElement, indent, tostring

from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import iterparse

from bench.errors import DataError
from bench.recordings import write_text
from bench.recordings.metered import READ_BYTES, MeteredFile
from bench.recordings.text_files import numbers

LARGEST_ITEM_BYTES = 8_000_000  # ten thousand poses, a quarter of an hour
DEEPEST = 12  # levels of nested elements; the format has six, attributes that tools add two more
LARGEST_NUMBER = 10**9
DECLARATION_BYTES = 200
OUTER = ("boost_serialization", "tracklets")
UNSET, INTERPOLATED, LABELLED = 0, 1, 2
HEADER = '<?xml version="1.0" encoding="UTF-8" standalone="yes" ?>\n<!DOCTYPE boost_serialization>\n'
PLACES, TURNS = ("tx", "ty", "tz"), ("rx", "ry", "rz")


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackletPose:
    """An object in one frame.

    Attributes:
        place_m: tx, ty, tz in the frame of the lidar.
        angles_rad: rx, ry, rz.
        state: 0 unset, 1 interpolated, 2 labelled.
        occlusion: -1 unset, 0 visible, 1 partly, 2 fully.
        truncation: -1 unset, 0 in the image, 1 cut off, 2 outside, 99 behind.
    """

    place_m: tuple[float, float, float]
    angles_rad: tuple[float, float, float]
    state: int = LABELLED
    occlusion: int = -1
    truncation: int = -1


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracklet:
    """An object.

    Attributes:
        object_type: class, as the tool calls it.
        height_m: what the file calls h.
        width_m: w.
        length_m: l.
        first_frame: number of the frame of the first pose.
        poses: one for each frame from there on.
        finished: the annotator was done with it.
        attributes: how many extra attributes it and its poses carry.
    """

    object_type: str
    height_m: float
    width_m: float
    length_m: float
    first_frame: int
    poses: tuple[TrackletPose, ...]
    finished: bool = True
    attributes: int = 0


def read_tracklets(file: Path) -> tuple[Tracklet, ...]:
    """Read a file of tracklets.

    Raises:
        DataError: missing, cut short, not XML, with entities, nested too deeply, a count that is not kept, a number
            that is missing or none.
    """
    tracklets: list[Tracklet] = []
    told: list[int] = []
    try:
        with file.open("rb") as raw:
            metered = MeteredFile(raw, file, part="tracklets", largest_bytes=LARGEST_ITEM_BYTES)
            open_elements: list[Element] = []
            for event, element in iterparse(_Declared(metered), events=("start", "end")):
                if event == "start":
                    open_elements.append(element)
                    _refuse_place(open_elements, file)
                    continue
                open_elements.pop()
                if len(open_elements) == 2:
                    if element.tag == "count":
                        told.append(_whole(element, "count", file, "tracklets.count"))
                    elif element.tag == "item":
                        tracklets.append(_tracklet(element, file, f"tracklets.item {len(tracklets)}"))
                    open_elements[-1].clear()
                    metered.restart()
    except OSError as error:
        raise DataError(file, expected="a file of tracklets", got=error.strerror or str(error)) from error
    except DefusedXmlException as error:
        raise DataError(file, expected="XML without entities", got=str(error)) from None
    except (ParseError, ValueError) as error:
        raise DataError(file, expected="well-formed XML", got=f"{error}; the file may be cut short") from None
    if told != [len(tracklets)]:
        got = f"{told[0]} for {len(tracklets)} items" if len(told) == 1 else f"{len(told)} counts"
        raise DataError(file, field="tracklets.count", expected="the number of tracklets", got=got)
    return tuple(tracklets)


def write_tracklets(file: Path, tracklets: Sequence[Tracklet]) -> None:
    """Write a file of tracklets as the development kit's reader wants it."""
    root = Element("boost_serialization", signature="serialization::archive", version="9")
    listed = SubElement(root, "tracklets", class_id="0", tracking_level="0", version="0")
    _put(listed, count=len(tracklets), item_version=1)
    for i, tracklet in enumerate(tracklets):
        item = SubElement(listed, "item", _class(1, 1) if i == 0 else {})
        _put(item, objectType=tracklet.object_type, h=tracklet.height_m, w=tracklet.width_m, l=tracklet.length_m)
        _put(item, first_frame=tracklet.first_frame)
        poses = SubElement(item, "poses", _class(2, 0) if i == 0 else {})
        _put(poses, count=len(tracklet.poses), item_version=2)
        for j, pose in enumerate(tracklet.poses):
            entry = SubElement(poses, "item", _class(3, 2) if i == j == 0 else {})
            _put(entry, **dict(zip(PLACES, pose.place_m, strict=True)))
            _put(entry, **dict(zip(TURNS, pose.angles_rad, strict=True)))
            _put(entry, state=pose.state, occlusion=pose.occlusion, occlusion_kf=0, truncation=pose.truncation)
            _put(entry, amt_occlusion=-1, amt_occlusion_kf=-1, amt_border_l=-1, amt_border_r=-1, amt_border_kf=-1)
        _put(item, finished=int(tracklet.finished))
    indent(root, "\t")
    write_text(file, HEADER + tostring(root, encoding="unicode") + "\n")


class _Declared:
    """Says `standalone="yes"` where a file says "true"."""

    def __init__(self, source: MeteredFile) -> None:
        self._source, self._begun = source, False

    def read(self, size: int = READ_BYTES) -> bytes:
        content = self._source.read(size)
        if not self._begun:
            self._begun = True
            head, rest = content[:DECLARATION_BYTES], content[DECLARATION_BYTES:]
            head = re.sub(rb"""^(\s*<\?xml[^>]*standalone\s*=\s*)(["'])true\2""", rb"\1\2yes\2", head)
            content = head + rest
        return content


def _refuse_place(opened: list[Element], file: Path) -> None:
    if len(opened) <= len(OUTER) and opened[-1].tag != OUTER[len(opened) - 1]:
        got = " with ".join(element.tag for element in opened)[:80]
        raise DataError(file, expected=" with ".join(OUTER), got=got)
    if len(opened) > DEEPEST:
        raise DataError(file, expected=f"at most {DEEPEST} levels of elements", got="more")


def _tracklet(item: Element, file: Path, field: str) -> Tracklet:
    poses = item.find("poses")
    if poses is None:
        raise DataError(file, field=f"{field}.poses", expected="poses", got="nothing")
    entries = poses.findall("item")
    count = _whole(poses.find("count"), "count", file, f"{field}.poses.count")
    if count != len(entries):
        raise DataError(
            file, field=f"{field}.poses.count", expected=f"{len(entries)}, as there are poses", got=str(count)
        )
    object_type = (item.findtext("objectType") or "").strip()
    if not object_type:
        raise DataError(file, field=f"{field}.objectType", expected="a class", got="nothing")
    height_m, width_m, length_m = (_size(item, name, file, field) for name in "hwl")
    return Tracklet(
        object_type=object_type,
        height_m=height_m,
        width_m=width_m,
        length_m=length_m,
        first_frame=_whole(item.find("first_frame"), "first_frame", file, f"{field}.first_frame"),
        poses=tuple(_pose(entry, file, f"{field}.poses.item {j}") for j, entry in enumerate(entries)),
        finished=(item.findtext("finished") or "1").strip() != "0",
        attributes=sum(1 for _ in item.iter("attribute")),
    )


def _pose(entry: Element, file: Path, field: str) -> TrackletPose:
    tx, ty, tz, rx, ry, rz = (_number(entry, name, file, field) for name in PLACES + TURNS)
    state, occlusion, truncation = (
        _whole(entry.find(name), name, file, f"{field}.{name}", default=default)
        for name, default in (("state", LABELLED), ("occlusion", -1), ("truncation", -1))
    )
    return TrackletPose(
        place_m=(tx, ty, tz), angles_rad=(rx, ry, rz), state=state, occlusion=occlusion, truncation=truncation
    )


def _size(item: Element, name: str, file: Path, field: str) -> float:
    value = _number(item, name, file, field)
    if value <= 0:
        raise DataError(file, field=f"{field}.{name}", expected="a size above 0", got=str(value))
    return value


def _number(element: Element, name: str, file: Path, field: str) -> float:
    return numbers((element.findtext(name) or "").split(), 1, file=file, field=f"{field}.{name}")[0]


def _whole(element: Element | None, name: str, file: Path, field: str, *, default: int | None = None) -> int:
    if element is None and default is not None:
        return default
    text = "" if element is None else (element.text or "").strip()
    if not re.fullmatch(r"-?[0-9]{1,10}", text) or abs(int(text)) > LARGEST_NUMBER:
        raise DataError(
            file, field=field, expected=f"a whole number {name}", got=repr(text[:40]) if text else "nothing"
        )
    return int(text)


def _class(number: int, version: int) -> dict[str, str]:
    return {"class_id": str(number), "tracking_level": "0", "version": str(version)}


def _put(parent: Element, **values: float | str) -> None:
    for name, value in values.items():
        SubElement(parent, name).text = value if isinstance(value, str) else repr(value)
