"""Mistakes that people make with a drive of their own, planted into rendered drives: what `validate` says of each.

python -m benchmarks.planted_mistakes writes the table into docs/your-data.md. Each mistake goes into a copy of each
drive of planted.scenario.yaml that it can be told in, and the copy is validated. A mistake is found with the right lead
where a finding that the clean drive does not have names the cause (`Mistake.lead`), weakly where findings name
something else, and it is silent where there is none.
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from bench.recordings.native import native_recordings
from bench.synthesis import synthesize
from bench.validation import Finding, validate_recording
from tests.support import planting

HERE = Path(__file__).parent
SCENARIO = HERE / "planted.scenario.yaml"
DOCS = HERE.parent / "docs" / "your-data.md"
MARKERS = "<!-- written by python -m benchmarks.planted_mistakes -->", "<!-- end -->"


@dataclass(frozen=True, slots=True, kw_only=True)
class Mistake:
    """A mistake.

    Attributes:
        name: as the table says it.
        part: the part of the data it is in: lidar, camera, clocks, ego-motion, boxes or units.
        plant: makes it in a recording's folder.
        lead: regular expression for the right finding's text, check to hint, without case.
        drives: the names of the drives in which the data can tell; all drives if empty.
    """

    name: str
    part: str
    plant: Callable[[Path], object]
    lead: str
    drives: tuple[str, ...] = ()


TURNING = ("turning-by-day", "turning-by-night", "car-park")
BY_DAY = ("turning-by-day", "straight-by-day", "car-park")


def _axes(matrix: Sequence[Sequence[float]], root: Path) -> None:
    """Multiply every point by a matrix."""
    turned = np.asarray(matrix, dtype=np.float32)
    planting.change_sweeps(root, lambda sweep: replace(sweep, points_lidar=sweep.points_lidar @ turned.T))


def _turned_mounting(axis: str, degrees: float, root: Path, camera: str = "front") -> None:
    """Turn a camera about an axis of the vehicle."""

    def turn(head: planting.Json) -> None:
        mounting = head["cameras"][camera]["vehicle_from_camera"]
        w, x, y, z = mounting["quaternion_wxyz"]
        turned = Rotation.from_euler(axis, degrees, degrees=True) * Rotation.from_quat([x, y, z, w])
        x, y, z, w = turned.as_quat()
        mounting["quaternion_wxyz"] = [w, x, y, z]

    planting.change_head(root, turn)


def _shift_sweeps(milliseconds: float, root: Path) -> None:
    planting.shift_times(root / "lidar", round(milliseconds * 1e6))


def _shift_images(milliseconds: float, root: Path) -> None:
    for folder in (root / "images").iterdir():
        planting.shift_times(folder, round(milliseconds * 1e6))


def _shift_bus(milliseconds: float, root: Path) -> None:
    offset_ns = round(milliseconds * 1e6)
    planting.change_bus(root, lambda row: row.update(timestamp_ns=str(int(row["timestamp_ns"]) + offset_ns)))


def _scaled_bus(column: str, factor: float, root: Path) -> None:
    planting.change_bus(root, lambda row: row.update({column: str(float(row[column]) * factor)}))


# ---- cameras: mounting, lens, images, and their clock
def _mounting(
    change: Callable[[list[float], list[float]], tuple[Sequence[float], Sequence[float]]], root: Path
) -> None:
    """Change quaternion (w, x, y, z) and translation of the front camera."""

    def each(head: planting.Json) -> None:
        mounting = head["cameras"]["front"]["vehicle_from_camera"]
        quaternion, translation_m = change(mounting["quaternion_wxyz"], mounting["translation_m"])
        mounting.update(quaternion_wxyz=list(quaternion), translation_m=list(translation_m))

    planting.change_head(root, each)


def _inverse(quaternion: list[float], translation_m: list[float]) -> tuple[Sequence[float], Sequence[float]]:
    w, x, y, z = quaternion
    inverse = Rotation.from_quat([x, y, z, w]).inv()
    return (w, -x, -y, -z), (-inverse.apply(translation_m)).tolist()


def _lens(change: Callable[[planting.Json], object], root: Path) -> None:
    """Change the front camera's lens."""
    planting.change_head(root, lambda head: change(head["cameras"]["front"]["model"]))


def _zoom(factor: float, lens: planting.Json) -> None:
    lens["coefficients"] = [factor * number for number in lens["coefficients"]]


def _as_pinhole(lens: planting.Json) -> None:
    focal, centre = lens["coefficients"][0], lens["principal_point"]
    lens.clear()
    lens.update(model="pinhole", focal=[focal, focal], principal_point=centre)


def _shift_centre(lens: planting.Json) -> None:
    lens["principal_point"] = [lens["principal_point"][0] + 20.0, lens["principal_point"][1]]


def _swap_cameras(root: Path) -> None:
    front, right, aside = (root / "images" / name for name in ("front", "right", "aside"))
    front.rename(aside)
    right.rename(front)
    aside.rename(right)


def _flip_images(way: int, root: Path) -> None:
    for path in (root / "images" / "front").iterdir():
        cv2.imwrite(str(path), cv2.flip(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), way))


def _camera(name: str, plant: Callable[[Path], object], lead: str, drives: tuple[str, ...] = BY_DAY) -> Mistake:
    return Mistake(name=name, part="camera", plant=plant, lead=lead, drives=drives)


CAMERA_MISTAKES: tuple[Mistake, ...] = (
    *(
        _camera(f"front camera turned {degrees:g} deg about the vehicle's {axis}", plant, "camera.*turned against")
        for axis in "xyz"
        for degrees in (1.0, 2.0, -5.0)
        for plant in (partial(_turned_mounting, axis, degrees),)
    ),
    _camera("inverse mounting", partial(_mounting, _inverse), "inverse"),
    _camera(
        "quaternion as x, y, z, w", partial(_mounting, lambda q, t: ((*q[1:], q[0]), t)), "quaternion|mounting.*order"
    ),
    _camera("30 cm to the left", partial(_mounting, lambda q, t: (q, (t[0], t[1] + 0.3, t[2]))), "translation_m.*left"),
    _camera("30 cm up", partial(_mounting, lambda q, t: (q, (t[0], t[1], t[2] + 0.3))), "translation_m.*up"),
    *(
        _camera(f"focal length times {factor:g}", partial(_lens, partial(_zoom, factor)), "focal length")
        for factor in (0.5, 0.95, 0.98, 1.02, 1.05, 2.0)
    ),
    _camera("pinhole for fisheye", partial(_lens, _as_pinhole), "fisheye"),
    _camera("principal point 20 px off", partial(_lens, _shift_centre), "principal.point"),
    _camera("images of the cameras swapped", _swap_cameras, "images of (front|right)"),
    _camera("images mirrored", partial(_flip_images, 1), "mirrored"),
    _camera("images upside down", partial(_flip_images, -1), "upside down|turn the images"),
    *(
        replace(_camera(f"images {ms:+g} ms", partial(_shift_images, ms), "image-clock", TURNING), part="clocks")
        for ms in (-100.0, -50.0, -10.0, 10.0, 50.0)
    ),
)
# ---- end of cameras

MISTAKES: tuple[Mistake, ...] = (
    *CAMERA_MISTAKES,
    Mistake(
        name="lidar mirrored in x",
        part="lidar",
        plant=partial(_axes, [[-1, 0, 0], [0, 1, 0], [0, 0, 1]]),
        lead="lidar.*(mirror|x reversed)",
    ),
    Mistake(
        name="front camera turned by 2 degrees to the left",
        part="camera",
        plant=partial(_turned_mounting, "z", 2.0),
        lead="camera.*(turn|yaw|mount)",
        drives=BY_DAY,
    ),
    Mistake(
        name="sweeps 50 ms late",
        part="clocks",
        plant=partial(_shift_sweeps, 50.0),
        lead="clock.*sweep|sweep.*late",
        drives=TURNING,
    ),
    Mistake(
        name="images 100 ms late",
        part="clocks",
        plant=partial(_shift_images, 100.0),
        lead="clock.*image|image.*late",
        drives=TURNING,
    ),
    Mistake(
        name="odometry 100 ms late",
        part="clocks",
        plant=partial(_shift_bus, 100.0),
        lead="clock.*ego|ego.*late",
        drives=TURNING,
    ),
    Mistake(name="speed in km/h", part="units", plant=partial(_scaled_bus, "speed_mps", 3.6), lead="speed.*km/h"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What validation said of a mistake in a drive.

    Attributes:
        mistake: its name.
        part: its part.
        drive: the drive's name.
        verdict: "right lead", "weak" or "silent".
        findings: texts of the findings that the clean drive does not have.
    """

    mistake: str
    part: str
    drive: str
    verdict: str
    findings: tuple[str, ...]


def findings_of(root: Path) -> tuple[Finding, ...]:
    """Validate one recording in the native format."""
    (handle,) = native_recordings(root, options={}, card=root / "card.yaml", annotations=None)
    return validate_recording(handle).findings


def _text(finding: Finding) -> str:
    return " | ".join(
        str(part) for part in (finding.check, finding.field, finding.expected, finding.got, finding.hint) if part
    )


def judged(mistake: Mistake, drive: Path) -> Outcome:
    """Plant a mistake into a copy of a drive, and validate it."""
    with tempfile.TemporaryDirectory() as folder:
        root = shutil.copytree(drive, Path(folder) / drive.name)
        mistake.plant(root)
        found = {_text(finding) for finding in findings_of(root)}
    new = sorted(found - {_text(finding) for finding in findings_of(drive)})
    right = any(re.search(mistake.lead, text, re.IGNORECASE) for text in new)
    verdict = "right lead" if right else "weak" if new else "silent"
    return Outcome(mistake=mistake.name, part=mistake.part, drive=drive.name, verdict=verdict, findings=tuple(new))


def main() -> None:
    """Render the drives, plant the mistakes, write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=HERE.parent / "datasets" / "data" / "planted")
    parser.add_argument("--only", default="", help="regular expression of mistakes' names or parts; writes no docs")
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    synthesize(SCENARIO, asked.data, workers=asked.workers)
    drives = {folder.name: folder for folder in sorted(asked.data.iterdir()) if (folder / "recording.json").is_file()}
    chosen = [one for one in MISTAKES if re.search(asked.only, f"{one.part} {one.name}")]
    tasks = [(mistake, drives[name]) for mistake in chosen for name in mistake.drives or sorted(drives)]
    with ProcessPoolExecutor(asked.workers) as pool:
        outcomes = list(pool.map(judged, *zip(*tasks, strict=True)))
    for outcome in outcomes:
        sys.stdout.write(f"{outcome.mistake} in {outcome.drive}: {outcome.verdict}\n")
        for text in outcome.findings:
            sys.stdout.write(f"    {text}\n")


if __name__ == "__main__":
    main()
