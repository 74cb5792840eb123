"""What CVAT writes as "KITTI Raw Format": `tracklet_labels.xml` and `frame_list.txt`.

CVAT keeps the tags of KITTI's raw tracklets (`bench.adapters.kitti_raw`) and changes their meaning: the place
is the middle of the box, w lies along x, h along y and l along z, and the three angles turn about the box's own x, y
and z in turn. Gaps of a track are filled with copies that are outside of the image with unset occlusion. CVAT carries
an object's id in an attribute `id`, where the task's labels have one, and names its frames in `frame_list.txt` beside
the tracklets: number and name of each. Sweeps that the list does not name were not looked at.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import numpy as np
from scipy.spatial.transform import Rotation

from bench.adapters.kitti_raw import (
    CUT_OFF,
    OUTSIDE,
    UNSET,
    Tracklet,
    TrackletPose,
    read_tracklets,
)
from bench.annotation.formats.conversion import (
    SHOWN,
    LabelFormat,
    LabelOptions,
    Observation,
    ToolLabels,
    lost_lines,
    pair_with_sweeps,
)
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.plain_text import listed
from bench.recordings import Recording, SweepRef
from bench.recordings.annotations import box_state
from bench.recordings.files import read_text

FILE, FRAME_LIST = "tracklet_labels.xml", "frame_list.txt"


class CvatTracklets(LabelFormat):
    """Conventions of CVAT's export."""

    name = "cvat"
    description = "tracklet_labels.xml and frame_list.txt as CVAT writes them (KITTI Raw Format); read only"

    def read(self, source: Path, recording: Recording, options: LabelOptions) -> ToolLabels:
        """Read tracklets; arguments and errors as in `LabelFormat`."""
        file = source / FILE if source.is_dir() else source
        tracklets = read_tracklets(file)
        posed = [[pose for pose in tracklet.poses if _is_set(pose)] for tracklet in tracklets]
        used = sorted({pose.number for poses in posed for pose in poses})
        lost = _not_read(tracklets, set_poses=sum(map(len, posed)))
        looked_at: Sequence[SweepRef] = recording.sweeps
        if (frame_list := file.with_name(FRAME_LIST)).is_file():
            sweeps = _listed_sweeps(frame_list, used, recording, options)
            looked_at = list(sweeps.values())
        else:
            paired = pair_with_sweeps([str(n) for n in used], recording, options, source=file) if used else {}
            sweeps = {number: paired[str(number)] for number in used}
            lost.append(f"frames without objects: without {FRAME_LIST} all {len(looked_at)} sweeps count as annotated")
        observations = []
        labels: dict[str, str] = {}
        taken: dict[str, set[int]] = defaultdict(set)
        for i, (tracklet, poses) in enumerate(zip(tracklets, posed, strict=True)):
            frames, name = {pose.number for pose in poses}, tracklet.name or f"tracklet-{i}"
            if labels.get(name, tracklet.label) != tracklet.label or taken[name] & frames:
                name = f"{name}-{i}"  # a copy of an object keeps its id
            labels[name] = tracklet.label
            taken[name] |= frames
            height, width, length = tracklet.hwl_m
            for pose in poses:
                turned = Rotation.from_euler("XYZ", pose.angles_rad).as_matrix()
                vehicle_from_box = recording.vehicle_from_lidar @ RigidTransform(turned, np.array(pose.place_m))
                state = box_state(sweeps[pose.number].timestamp_ns, vehicle_from_box, (width, height, length))
                observations.append(Observation(track=name, label=tracklet.label, state=state))
        times_ns = [sweep.timestamp_ns for sweep in looked_at]
        return ToolLabels(observations=observations, timestamps_ns=times_ns, lost=lost)


def _is_set(pose: TrackletPose) -> bool:
    return pose.state != UNSET and not (pose.occlusion == -1 and pose.truncation in OUTSIDE)


def _not_read(tracklets: Sequence[Tracklet], *, set_poses: int) -> list[str]:
    poses = [pose for tracklet in tracklets for pose in tracklet.poses]
    counts = {
        "tracklets without poses, left out": sum(not tracklet.poses for tracklet in tracklets),
        "poses that are unset or outside, left out": len(poses) - set_poses,
        "marks of occlusion: no field for them": sum(pose.occlusion in (1, 2) for pose in poses),
        "marks of truncation: no field for them": sum(pose.truncation in (CUT_OFF, *OUTSIDE) for pose in poses),
        "further attributes: no field for them": sum(tracklet.not_read for tracklet in tracklets),
    }
    return lost_lines(counts)


def _listed_sweeps(file: Path, used: Sequence[int], recording: Recording, options: LabelOptions) -> dict[int, SweepRef]:
    """Number of each frame of a `frame_list.txt` -> its sweep, by the name there.

    Raises:
        DataError: a line that is no number and name, a number or name twice, a frame of tracklets that is not listed,
            a name that no sweep is called as, or another count of frames asked for as well.
    """
    if options.first_frame is not None:
        got, hint = f"--first-frame {options.first_frame} as well", "leave that out, or take the file away"
        raise DataError(file, expected="frames by name or by number", got=got, hint=hint)
    names: dict[int, str] = {}
    for row, line in enumerate(filter(str.strip, read_text(file).splitlines()), start=1):
        match = re.fullmatch(r"\s*([0-9]{1,10})\s+(\S.*?)\s*", line)
        name = "" if match is None else PurePosixPath(match[2].replace("\\", "/")).name
        stem = re.sub(r"(?i)\.(bin|pcd|ply|npz|laz|las)$", "", name)
        if match is None or int(match[1]) in names or stem in names.values():
            expected, got = "number and name of a frame, each once", repr(line.strip()[:40])
            raise DataError(file, field=f"line {row}", expected=expected, got=got)
        names[int(match[1])] = stem
    if missing := [number for number in used if number not in names]:
        got = f"none for {listed([str(number) for number in missing], SHOWN)}"
        raise DataError(file, expected="a line for each frame that tracklets have", got=got)
    sweeps = pair_with_sweeps(list(names.values()), recording, options, source=file)
    return {number: sweeps[name] for number, name in names.items()}
