"""KITTI's raw tracklets as a label set, and what CVAT writes under the same name.

KITTI: length along x, width along y, height along z; the place is the middle of the box's bottom; rz is the yaw, and
rx and ry are 0. A tracklet's frame is its first frame plus the number of the pose.

CVAT's "KITTI Raw Format" keeps the tags and changes their meaning: the place is the middle of the box, w lies along x,
h along y and l along z, and the three angles turn about the box's own x, y and z in turn. Gaps of a track are filled
with copies that are outside of the image with unset occlusion. Newer versions of the library behind it may have
corrected the order of the sizes: look at the sizes that an import prints.

Tracklets of CVAT's tasks carry the object's id in an attribute `id`, where the task's labels have one.

CVAT also writes `frame_list.txt`: number and name of each frame of the task. Where it is beside the tracklets, frames
pair with sweeps by these names and never by their number, and the sweeps that it does not name were not looked at.

The XML of KITTI's raw tracklets, item by item.

An item is one object: type, height, width and length, the number of its first frame, and a pose for each frame from
there on. `state` is 0 unset, 1 interpolated, 2 labelled; `occlusion` -1 unset, 0 visible, 1 partly, 2 fully;
`truncation` -1 unset, 0 in the image, 1 cut off, 2 outside, 99 behind; some tools write the share that is cut off.
Counts that are missing or wrong are reported and not used.

Source:
    The raw data's development kit (`tracklets.h`, `readTracklets.m`); its files carry a document type without any
    declaration, and some say `standalone="true"`, which XML does not know.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import ClassVar
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.atomic import write_text
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.labels.formats import LabelOptions, LabelSet, is_ignored, left_out, map_classes, tool_class
from bench.labels.frames import SHOWN, frame_names, frame_numbers, pair_with_sweeps
from bench.labels.motion import box_state, floating, lidar_from_object, motion_lost, states_at_sweeps, with_motion
from bench.recordings import Cuboid, ObjectState, Recording, SweepRef, Track
from bench.recordings.files import READ_BYTES, MeteredFile, numbers, read_text, xml_parts

LARGEST_ITEM_BYTES = 8_000_000  # ten thousand poses, a quarter of an hour
DEEPEST = 12  # levels of nested elements; the format has six, attributes that tools add two more
LARGEST_NUMBER = 10**9
DECLARATION_BYTES = 200
OUTER = ("boost_serialization", "tracklets")
UNSET, INTERPOLATED, LABELLED = 0, 1, 2
CUT_OFF, OUTSIDE = 1, (2, 99)  # truncation
HEADER = '<?xml version="1.0" encoding="UTF-8" standalone="yes" ?>\n<!DOCTYPE boost_serialization>\n'
ID_ATTRIBUTE = "id"
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
        name: the object's id, in the attribute that CVAT's tasks carry it in; empty where it has none.
        attributes: how many other attributes it and its poses carry.
    """

    object_type: str
    height_m: float
    width_m: float
    length_m: float
    first_frame: int
    poses: tuple[TrackletPose, ...]
    finished: bool = True
    name: str = ""
    attributes: int = 0


def read_tracklets(file: Path) -> tuple[tuple[Tracklet, ...], tuple[str, ...]]:
    """Read a file of tracklets.

    Returns:
        tracklets: in the order of the file.
        wrong_counts: one line for each count that is missing or wrong.

    Raises:
        DataError: missing, cut short, not XML, with entities, nested too deeply, a number that is missing or none,
            nothing in it but a count of 0.
    """
    tracklets: list[Tracklet] = []
    counts: list[int] = []
    wrong: list[str] = []
    elements = xml_parts(
        file,
        level=2,
        parts="tracklets",
        largest_bytes=LARGEST_ITEM_BYTES,
        deepest=DEEPEST,
        outer=OUTER,
        forbid_dtd=False,
        prepare=_Declared,
    )
    for element in elements:
        if element.tag == "count":
            counts.append(_whole(element, "count", file, "tracklets.count"))
        elif element.tag == "item":
            field = f"tracklets.item {len(tracklets)}"
            tracklets.append(_tracklet(element, file, field))
            held, count = len(tracklets[-1].poses), element.find("poses/count")
            stated = [] if count is None else [_whole(count, "count", file, f"{field}.poses.count")]
            wrong += _wrong_count(f"{field}.poses", stated, held)
    if not tracklets and counts != [0]:
        raise DataError(file, field="tracklets", expected="tracklets, or a count of 0", got="neither")
    return tuple(tracklets), (*_wrong_count("tracklets", counts, len(tracklets)), *wrong)


def _wrong_count(field: str, stated: Sequence[int], held: int) -> list[str]:
    if list(stated) == [held] or (not stated and not held):
        return []
    return [f"{field}: the file states {' and '.join(map(str, stated)) or 'no count'} and holds {held}, which are read"]


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
        if tracklet.name:
            _put(SubElement(SubElement(item, "attributes"), "attribute"), name=ID_ATTRIBUTE, value=tracklet.name)
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


def _tracklet(item: Element, file: Path, field: str) -> Tracklet:
    entries = item.findall("poses/item")
    object_type = (item.findtext("objectType") or "").strip()
    if not object_type:
        raise DataError(file, field=f"{field}.objectType", expected="a class", got="nothing")
    height_m, width_m, length_m = (_size(item, name, file, field) for name in "hwl")
    attributes = [(found.findtext("name"), (found.findtext("value") or "").strip()) for found in item.iter("attribute")]
    names = [value for name, value in attributes if name == ID_ATTRIBUTE]
    return Tracklet(
        object_type=object_type,
        height_m=height_m,
        width_m=width_m,
        length_m=length_m,
        first_frame=_whole(item.find("first_frame"), "first_frame", file, f"{field}.first_frame"),
        poses=tuple(_pose(entry, file, f"{field}.poses.item {j}") for j, entry in enumerate(entries)),
        finished=(item.findtext("finished") or "1").strip() != "0",
        name=next(filter(None, names), ""),
        attributes=len(attributes) - len(names),
    )


def _pose(entry: Element, file: Path, field: str) -> TrackletPose:
    tx, ty, tz, rx, ry, rz = (_number(entry, name, file, field) for name in PLACES + TURNS)
    state, occlusion = (
        _whole(entry.find(name), name, file, f"{field}.{name}", default=default)
        for name, default in (("state", LABELLED), ("occlusion", -1))
    )
    share = re.fullmatch(r"0?\.[0-9]{1,20}", (entry.findtext("truncation") or "").strip())
    truncation = (
        CUT_OFF if share else _whole(entry.find("truncation"), "truncation", file, f"{field}.truncation", default=-1)
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


FILE, FRAME_LIST = "tracklet_labels.xml", "frame_list.txt"
WRITTEN = {"pedestrian": "Pedestrian", "cyclist": "Cyclist", "vehicle": "Car", "animal": "Misc"}
UPRIGHT_RAD = 1e-6
SAME_SIZE_M = 1e-6
FLOATING_REASON = "the file may be of the other kind (kitti-tracklets, cvat-tracklets)"
CLOUD_SUFFIXES = (".bin", ".pcd", ".ply", ".npz", ".laz")


class KittiTracklets:
    """Conventions of KITTI's development kit."""

    name = "kitti-tracklets"
    description = "tracklet_labels.xml of KITTI's raw data: upright boxes, one size for each object"
    centred = False
    sizes = ("length_m", "width_m", "height_m")  # what the file calls the sizes along x, y and z
    classes: ClassVar[Mapping[str, str]] = WRITTEN  # ours -> the tool's

    def read(self, source: Path, recording: Recording, options: LabelOptions) -> LabelSet:
        """Read a label set; arguments and errors as in `LabelFormat`."""
        file = source / FILE if source.is_dir() else source
        tracklets, wrong_counts = read_tracklets(file)
        listed = _listed_frames(file.with_name(FRAME_LIST), options)
        classes = map_classes((tracklet.object_type for tracklet in tracklets), options, source=file)
        kept = [(i, tracklet) for i, tracklet in enumerate(tracklets) if classes[tracklet.object_type] is not None]
        numbers = {number for _, tracklet in kept for number, _ in self._posed(tracklet)}
        if listed is None:
            found = pair_with_sweeps({str(n) for n in numbers}, recording, options, source=file) if numbers else {}
            sweeps = {number: found[str(number)] for number in numbers}
        else:
            sweeps = _named_sweeps(listed, numbers, recording, file.with_name(FRAME_LIST))
        found_tracks = [
            Track(
                track_id=tracklet.name or f"tracklet-{i}",
                object_class=str(classes[tracklet.object_type]),
                states=self._states(tracklet, sweeps, recording, file, f"tracklets.item {i}"),
            )
            for i, tracklet in kept
            if tracklet.poses
        ]
        tracks = tuple(with_motion(track, recording.trajectory) for track in _joined(found_tracks))
        counts = Counter(tracklet.object_type for tracklet in tracklets)
        lost = [*wrong_counts[:SHOWN], *left_out(classes, counts)]
        if len(wrong_counts) > SHOWN:
            lost.insert(SHOWN, f"{len(wrong_counts) - SHOWN} more counts that are missing or wrong")
        lost += [*self._unread([tracklet for _, tracklet in kept]), *floating(tracks, FLOATING_REASON)]
        if listed is None:
            lost.append(
                f"frames without objects: the format does not say whether they were annotated, so that all "
                f"{len(recording.sweeps)} sweeps count as annotated"
            )
        looked_at = recording.sweeps if listed is None else sweeps.values()
        times_ns = tuple(sorted(sweep.timestamp_ns for sweep in looked_at))
        return LabelSet(tracks=tracks, timestamps_ns=times_ns, lost=tuple(lost))

    def write(self, label_set: LabelSet, recording: Recording, out: Path, options: LabelOptions) -> tuple[str, ...]:
        """Write `tracklet_labels.xml`; arguments as in `LabelFormat`."""
        states, lost = states_at_sweeps(label_set, recording, (Cuboid,))
        numbers = frame_numbers(recording, options)
        if self.centred and max(numbers.values()) - min(numbers.values()) >= len(numbers):
            numbers = {time_ns: i for i, time_ns in enumerate(numbers)}  # a task counts frames, FRAME_LIST names them
        by_track: dict[str, list[tuple[int, Cuboid]]] = {track.track_id: [] for track in label_set.tracks}
        for time_ns, found in states.items():
            for track, state in found:
                assert isinstance(state.shape, Cuboid)
                by_track[track.track_id].append((numbers[time_ns], state.shape))
        tracklets: list[Tracklet] = []
        split = resized = 0
        lean_rad = 0.0
        for track in label_set.tracks:
            runs = _runs(by_track[track.track_id])
            split += len(runs) > 1
            for run in runs:
                sizes = np.stack([cuboid.size_m for _, cuboid in run])
                size_m = np.median(sizes, axis=0)
                resized += bool(np.abs(sizes - size_m).max() > SAME_SIZE_M)
                object_type = tool_class(track.object_class, options, self.classes)
                poses = [lidar_from_object(cuboid, recording) for _, cuboid in run]
                lean_rad = max(lean_rad, *(_lean_rad(pose) for pose in poses))
                tracklets.append(
                    Tracklet(
                        object_type=object_type,
                        **dict(zip(self.sizes, size_m.tolist(), strict=True)),
                        first_frame=run[0][0],
                        poses=tuple(self._tracklet_pose(pose, size_m[2]) for pose in poses),
                        name=track.track_id if self.centred else "",
                    )
                )
        write_tracklets(out / FILE, tracklets)
        if self.centred:
            names = frame_names(recording, options)
            write_text(out / FRAME_LIST, "".join(f"{number} {names[t]}\n" for t, number in numbers.items()))
        if tracklets and not self.centred:
            lost.append(f"{len(by_track)} names of objects: the format has none")
        if split and not self.centred:
            lost.append(f"{split} objects are out of sight for a while and become several tracklets")
        if resized:
            lost.append(f"{resized} objects change their size: each has its median one")
        if lean_rad > UPRIGHT_RAD and not self.centred:
            lost.append(
                f"boxes that lean by up to {np.degrees(lean_rad):.3g} deg against the lidar are written upright"
            )
        return (*lost, *motion_lost(label_set.tracks))

    def _posed(self, tracklet: Tracklet) -> list[tuple[int, TrackletPose]]:
        """Number of the frame and pose, without poses that are unset."""
        return [
            (tracklet.first_frame + j, pose)
            for j, pose in enumerate(tracklet.poses)
            if pose.state != UNSET and not (self.centred and pose.occlusion == -1 and pose.truncation in OUTSIDE)
        ]

    def _states(
        self, tracklet: Tracklet, sweeps: dict[int, SweepRef], recording: Recording, file: Path, field: str
    ) -> tuple[ObjectState, ...]:
        states = []
        for number, pose in self._posed(tracklet):
            if not self.centred:
                _refuse_lean(pose, file, f"{field}, frame {number}")
            lidar_from_box, size_m = self._placed(tracklet, pose)
            ignored = is_ignored(tracklet.object_type)
            states.append(box_state(recording, sweeps[number].timestamp_ns, lidar_from_box, size_m, unclear=ignored))
        return tuple(sorted(states, key=lambda state: state.timestamp_ns))

    def _placed(self, tracklet: Tracklet, pose: TrackletPose) -> tuple[RigidTransform, NDArray[np.float64]]:
        """Pose of the box's centre in the frame of the lidar, and its size."""
        size_m = np.array([getattr(tracklet, name) for name in self.sizes])
        if self.centred:
            rotation = Rotation.from_euler("XYZ", pose.angles_rad).as_matrix()
            return RigidTransform(rotation, np.array(pose.place_m)), size_m
        place_m = np.add(pose.place_m, (0.0, 0.0, tracklet.height_m / 2.0))
        return RigidTransform.from_yaw(pose.angles_rad[2], place_m), size_m

    def _tracklet_pose(self, pose: RigidTransform, height_m: float) -> TrackletPose:
        """Pose of a box in the frame of the lidar, as the file states it."""
        if self.centred:
            angles_rad = _triple(Rotation.from_matrix(pose.rotation).as_euler("XYZ"))
            return TrackletPose(place_m=_triple(pose.translation_m), angles_rad=angles_rad, occlusion=0, truncation=0)
        return TrackletPose(
            place_m=_triple(pose.translation_m - (0.0, 0.0, height_m / 2.0)),
            angles_rad=(0.0, 0.0, float(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0]))),
        )

    def _unread(self, tracklets: Sequence[Tracklet]) -> list[str]:
        poses = [pose for tracklet in tracklets for pose in tracklet.poses]
        posed = sum(len(self._posed(tracklet)) for tracklet in tracklets)
        counts = {
            "tracklets without poses, left out": sum(not tracklet.poses for tracklet in tracklets),
            "poses that are unset or outside, left out": len(poses) - posed,
            "poses that are interpolated, read as the others": sum(pose.state == INTERPOLATED for pose in poses),
            "marks of occlusion: no field for them": sum(pose.occlusion in (1, 2) for pose in poses),
            "marks of truncation: no field for them": sum(pose.truncation in (CUT_OFF, *OUTSIDE) for pose in poses),
            "tracklets that are not finished, read as the others": sum(not item.finished for item in tracklets),
            "further attributes: no field for them": sum(item.attributes for item in tracklets),
        }
        return [f"{count} {what}" for what, count in counts.items() if count]


class CvatTracklets(KittiTracklets):
    """Conventions of CVAT's export and import."""

    name = "cvat-tracklets"
    description = "tracklet_labels.xml as CVAT writes it (KITTI Raw Format): other places, sizes and angles"
    centred = True
    sizes = ("width_m", "height_m", "length_m")
    classes = WRITTEN | {"animal": "Animal"}  # tasks have any class


def _listed_frames(file: Path, options: LabelOptions) -> dict[int, str] | None:
    """Number -> name of each frame of a `frame_list.txt`, without folder and suffix; None where there is no such file.

    Raises:
        DataError: a line that is no number and name, a number twice, or another count of frames asked for as well.
    """
    if not file.is_file():
        return None
    if options.first_frame:
        got, hint = f"--first-frame {options.first_frame} as well", "leave that out, or take the file away"
        raise DataError(file, expected="frames by name or by number", got=got, hint=hint)
    listed: dict[int, str] = {}
    for row, line in enumerate(read_text(file).splitlines(), start=1):
        if not line.strip():
            continue
        found = re.fullmatch(r"\s*([0-9]{1,10})\s+(\S.*?)\s*", line)
        if found is None:
            got = repr(line.strip()[:40])
            raise DataError(file, field=f"line {row}", expected="number and name of a frame", got=got)
        if int(found[1]) in listed:
            raise DataError(file, field=f"line {row}", expected="each number once", got=f"{found[1]} twice")
        name = PurePosixPath(found[2].replace("\\", "/")).name
        listed[int(found[1])] = name.removesuffix(next((s for s in CLOUD_SUFFIXES if name.lower().endswith(s)), ""))
    return listed


def _named_sweeps(
    listed: Mapping[int, str], numbers: Collection[int], recording: Recording, file: Path
) -> dict[int, SweepRef]:
    """The sweep of each frame of a list.

    Raises:
        DataError: a tracklet in a frame that is not listed, or a listed frame that no sweep is called as.
    """
    missing = sorted(set(numbers) - set(listed))
    if missing:
        got = f"none for {', '.join(map(str, missing[:SHOWN]))}"
        raise DataError(file, expected="a line for each frame that tracklets have", got=got)
    sweeps = pair_with_sweeps(listed.values(), recording, LabelOptions(), source=file, by_place=False) if listed else {}
    found: dict[int, SweepRef] = {}
    for number, name in listed.items():
        if sweeps[name] in found.values():
            raise DataError(file, field=f"frame {number}", expected="each name once", got=f"{name!r} twice")
        found[number] = sweeps[name]
    return found


def _joined(tracks: Sequence[Track]) -> list[Track]:
    """Tracks, those of one id and class as one; an id that is there twice at one time, as of a copy, gets a number."""
    joined: dict[str, Track] = {}
    for track in tracks:
        name, number, times_ns = track.track_id, 1, {state.timestamp_ns for state in track.states}
        while name in joined and (
            joined[name].object_class != track.object_class
            or any(state.timestamp_ns in times_ns for state in joined[name].states)
        ):
            number += 1
            name = f"{track.track_id}-{number}"
        states = (*(joined[name].states if name in joined else ()), *track.states)
        in_time = tuple(sorted(states, key=lambda state: state.timestamp_ns))
        joined[name] = replace(track, track_id=name, states=in_time)
    return list(joined.values())


def _runs(posed: Sequence[tuple[int, Cuboid]]) -> list[list[tuple[int, Cuboid]]]:
    """Parts without a missing frame."""
    runs: list[list[tuple[int, Cuboid]]] = []
    for number, cuboid in sorted(posed, key=lambda item: item[0]):
        if not runs or number != runs[-1][-1][0] + 1:
            runs.append([])
        runs[-1].append((number, cuboid))
    return runs


def _refuse_lean(pose: TrackletPose, file: Path, field: str) -> None:
    rx, ry, _ = pose.angles_rad
    if abs(rx) > UPRIGHT_RAD or abs(ry) > UPRIGHT_RAD:
        hint = "files of CVAT, which turns boxes about all axes, are read as cvat-tracklets"
        raise DataError(file, field=f"{field}.rx, ry", expected="0", got=f"{rx:.4g} and {ry:.4g}", hint=hint)


def _lean_rad(pose: RigidTransform) -> float:
    return float(np.hypot(pose.rotation[0, 2], pose.rotation[1, 2]))


def _triple(values: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
