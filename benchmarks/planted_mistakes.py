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

import numpy as np
from scipy.spatial.transform import Rotation

from bench.geometry import RigidTransform
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


def _turned_lidar(degrees: float, root: Path) -> None:
    """Turn the lidar about the vehicle's z."""

    def turn(head: planting.Json) -> None:
        mounting = head["lidar"]["vehicle_from_lidar"]
        w, x, y, z = mounting["quaternion_wxyz"]
        x, y, z, w = (Rotation.from_euler("z", degrees, degrees=True) * Rotation.from_quat([x, y, z, w])).as_quat()
        mounting["quaternion_wxyz"] = [w, x, y, z]

    planting.change_head(root, turn)


def _raised_lidar(metres: float, root: Path) -> None:
    def raise_it(head: planting.Json) -> None:
        head["lidar"]["vehicle_from_lidar"]["translation_m"][2] += metres

    planting.change_head(root, raise_it)


def _inverse_lidar(root: Path) -> None:
    def invert(head: planting.Json) -> None:
        mounting = head["lidar"]["vehicle_from_lidar"]
        inverse = RigidTransform.from_quaternion(mounting["quaternion_wxyz"], mounting["translation_m"]).inverse()
        mounting["quaternion_wxyz"] = inverse.quaternion_wxyz.tolist()
        mounting["translation_m"] = inverse.translation_m.tolist()

    planting.change_head(root, invert)


def _biased_bus(degps: float, root: Path) -> None:
    bias = float(np.radians(degps))
    planting.change_bus(root, lambda row: row.update(yaw_rate_radps=str(float(row["yaw_rate_radps"]) + bias)))


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


MIRROR_X, MIRROR_Y, MIRROR_Z = (np.diag(signs).tolist() for signs in ([-1, 1, 1], [1, -1, 1], [1, 1, -1]))
SWAPPED, ROTATED = [[0, 1, 0], [1, 0, 0], [0, 0, 1]], [[0, 1, 0], [0, 0, 1], [1, 0, 0]]
SWEEP_CLOCK, EGO_CLOCK = "clock.*sweeps? (is|are) .*(late|early)", "clock.*ego-motion is .*(late|early)"

# Lidar, odometry, and the clock between them.
OF_LIDAR: tuple[Mistake, ...] = (
    Mistake(name="lidar mirrored in y", part="lidar", plant=partial(_axes, MIRROR_Y), lead="lidar.*y reversed.*mirror"),
    Mistake(name="lidar mirrored in z", part="lidar", plant=partial(_axes, MIRROR_Z), lead="lidar.*z reversed.*mirror"),
    Mistake(name="lidar x and y swapped", part="lidar", plant=partial(_axes, SWAPPED), lead="lidar.*x and y swapped"),
    Mistake(name="lidar axes rotated", part="lidar", plant=partial(_axes, ROTATED), lead="lidar.*axes permuted"),
    Mistake(
        name="lidar mounting inverse", part="lidar", plant=_inverse_lidar, lead="lidar.*(inverse|direction of the)"
    ),
    *(
        Mistake(
            name=f"lidar turned by {degrees} degrees",
            part="lidar",
            plant=partial(_turned_lidar, degrees),
            lead="lidar.*(yaw|turned by)",
        )
        for degrees in (2, 5, 180)
    ),
    *(
        Mistake(
            name=f"lidar {centimetres} cm too high",
            part="lidar",
            plant=partial(_raised_lidar, centimetres / 100),
            lead="road.*height",
        )
        for centimetres in (10, 30)
    ),
    *(
        Mistake(
            name=f"sweeps {abs(late)} ms {'late' if late > 0 else 'early'}",
            part="clocks",
            plant=partial(_shift_sweeps, late),
            lead=SWEEP_CLOCK,
            drives=TURNING,
        )
        for late in (10, -10, -50, 100, -100)
    ),
    *(
        Mistake(
            name=f"odometry {abs(late)} ms {'late' if late > 0 else 'early'}",
            part="clocks",
            plant=partial(_shift_bus, late),
            lead=EGO_CLOCK,
            drives=TURNING,
        )
        for late in (10, -10, 50, -50, -100)
    ),
    *(
        Mistake(
            name=f"speed {percent} % too high",
            part="ego-motion",
            plant=partial(_scaled_bus, "speed_mps", 1 + percent / 100),
            lead="scale of the speed",
        )
        for percent in (2, 5)
    ),
    Mistake(
        name="yaw rate positive to the right",
        part="ego-motion",
        plant=partial(_scaled_bus, "yaw_rate_radps", -1.0),
        lead="sign of the yaw rate",
        drives=TURNING,
    ),
    Mistake(
        name="yaw rate off by 1 degree per second",
        part="ego-motion",
        plant=partial(_biased_bus, 1.0),
        lead="bias of the yaw rate",
    ),
)

MISTAKES: tuple[Mistake, ...] = (
    *OF_LIDAR,
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
