"""ASAM OpenLABEL as other tools write and read it, with coordinate systems, streams and names of every kind.

What travels under the names that `annotations/` uses (`velocity_mps`, `category`, `unclear`, `ground_outline`, ...) is
read from any file; cuboids are read under any name, in any system that a chain of poses leads from.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.atomic import write_text
from bench.labels.formats import LabelOptions, LabelSet, left_out, map_classes, tool_class
from bench.labels.motion import floating, with_motion
from bench.labels.openlabel_calibration import Systems, lens_properties
from bench.labels.openlabel_file import ELEMENTS, Root, read_label_file
from bench.labels.openlabel_states import StateReader, frame_times
from bench.recordings import Recording, Track, openlabel
from bench.recordings.annotations import annotation_document


def label_document(label_set: LabelSet, recording: Recording, options: LabelOptions) -> dict[str, Any]:
    """The content of the file, as JSON values.

    Args:
        label_set: the annotations.
        recording: for mountings, lenses and sweeps.
        options: for other names of classes.
    """
    document = annotation_document(label_set.tracks, label_set.timestamps_ns)
    root = document["openlabel"]
    lidar = _free_name("lidar", recording)
    root["coordinate_systems"] = _systems(recording, lidar)
    root["streams"] = _streams(recording, lidar)
    _number_objects(root, label_set, options)
    _add_streams(root["frames"], recording, lidar)
    if root["frames"]:
        root["frame_intervals"] = [{"frame_start": 0, "frame_end": len(root["frames"]) - 1}]
    return document


def _free_name(expected: str, recording: Recording) -> str:
    taken = {*recording.cameras, openlabel.COORDINATE_SYSTEM}
    while expected in taken:
        expected = f"{expected}_sensor"
    return expected


def _systems(recording: Recording, lidar: str) -> dict[str, Any]:
    mountings = {lidar: recording.vehicle_from_lidar}
    mountings |= {name: camera.vehicle_from_camera for name, camera in recording.cameras.items()}
    systems: dict[str, Any] = {
        openlabel.COORDINATE_SYSTEM: {"type": "local_cs", "parent": "", "children": list(mountings)}
    }
    for name, vehicle_from_sensor in mountings.items():
        w, *xyz = vehicle_from_sensor.quaternion_wxyz.tolist()
        systems[name] = {
            "type": "sensor_cs",
            "parent": openlabel.COORDINATE_SYSTEM,
            "children": [],
            "pose_wrt_parent": {"quaternion": [*xyz, w], "translation": vehicle_from_sensor.translation_m.tolist()},
        }
    return systems


def _streams(recording: Recording, lidar: str) -> dict[str, Any]:
    streams: dict[str, Any] = {lidar: {"type": "lidar", "description": "lidar sweeps"}}
    for name, camera in recording.cameras.items():
        streams[name] = {"type": "camera", "description": "camera", "stream_properties": lens_properties(camera.model)}
    return streams


def _number_objects(root: dict[str, Any], label_set: LabelSet, options: LabelOptions) -> None:
    """Keys as the standard wants them, numbers; what they were is each object's name."""
    uids = {track.track_id: str(i) for i, track in enumerate(label_set.tracks)}
    for frame in root["frames"].values():
        frame["objects"] = {uids[track_id]: entry for track_id, entry in frame["objects"].items()}
    places: dict[str, list[int]] = {uid: [] for uid in uids.values()}
    for number, frame in root["frames"].items():
        for uid in frame["objects"]:
            places[uid].append(int(number))
    root["objects"] = {
        uids[track.track_id]: {
            **root["objects"][track.track_id],
            "type": tool_class(track.object_class, options),
            "frame_intervals": _intervals(places[uids[track.track_id]]),
        }
        for track in label_set.tracks
    }


def _intervals(numbers: Sequence[int]) -> list[dict[str, int]]:
    intervals: list[dict[str, int]] = []
    for number in numbers:
        if intervals and intervals[-1]["frame_end"] == number - 1:
            intervals[-1]["frame_end"] = number
        else:
            intervals.append({"frame_start": number, "frame_end": number})
    return intervals


def _add_streams(frames: dict[str, Any], recording: Recording, lidar: str) -> None:
    """The sweep's file and time in each frame that has one."""
    sweeps = {sweep.timestamp_ns: sweep for sweep in recording.sweeps}
    for frame in frames.values():
        sweep = sweeps.get(frame["frame_properties"]["timestamp"])
        if sweep is not None:
            sync = {"timestamp": sweep.timestamp_ns}
            stream = {"uri": sweep.path.name, "stream_properties": {"sync": sync}}
            frame["frame_properties"]["streams"] = {lidar: stream}


FILE = "openlabel.json"


class OpenLabelFormat:
    """The standard's files."""

    name = "openlabel"
    description = "ASAM OpenLABEL 1.0 of any tool: cuboids in any coordinate system, times in any unit"

    def read(self, source: Path, recording: Recording, options: LabelOptions) -> LabelSet:
        """Read a label set; arguments and errors as in `LabelFormat`."""
        file = source / FILE if source.is_dir() else source
        content = read_label_file(file)
        counts = Counter(item.type for item in content.objects.values())
        classes = map_classes(counts, options, source=file)
        systems = Systems(content, recording, file)
        reader = StateReader(content, systems, file)
        times_ns = frame_times(content, recording, options, file, reader.lost)
        ids = _track_ids(content)
        tracks = []
        for uid, item in content.objects.items():
            object_class = classes[item.type]
            if object_class is None:
                continue
            states = reader.states(uid, item, times_ns)
            if not states:
                reader.lost["objects without any cuboid or outline, left out"] += 1
                continue
            track = Track(
                track_id=ids[uid], object_class=object_class, states=states, instance_id=reader.instance_id(uid, item)
            )
            tracks.append(with_motion(track, recording.trajectory))
        lost = [*left_out(classes, counts), *(f"{count} {what}" for what, count in reader.lost.items())]
        lost += [
            f"{len(getattr(content, kind))} {kind}: no field for them" for kind in ELEMENTS if getattr(content, kind)
        ]
        if tracks and systems.guesses:
            lost += [*systems.guesses, *floating(tracks, "the file's frame may have its origin elsewhere")]
        return LabelSet(tracks=tuple(tracks), timestamps_ns=tuple(sorted(times_ns.values())), lost=tuple(lost))

    def write(self, label_set: LabelSet, recording: Recording, out: Path, options: LabelOptions) -> tuple[str, ...]:
        """Write `openlabel.json`; arguments as in `LabelFormat`."""
        document = label_document(label_set, recording, options)
        write_text(out / FILE, json.dumps(document, indent=1, allow_nan=False) + "\n")
        return ()


def _track_ids(content: Root) -> dict[str, str]:
    """The objects' own names where they are distinct, else the keys."""
    names = [item.name for item in content.objects.values()]
    distinct = all(names) and len(set(names)) == len(names)
    return {uid: item.name if distinct else uid for uid, item in content.objects.items()}
