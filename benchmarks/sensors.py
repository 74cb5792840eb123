"""`python -m benchmarks.sensors CARD`: the reference of a rendered data set by other lidars than the one it has.

python -m benchmarks.sensors datasets/paper.yaml --split zebra-04,queue-06 --out reports/paper/sensors.md

Each drive is scanned again by every sensor of `SENSORS`; images, exact masks and annotations stay. What the exact
masks lack to a perfect score by `surface-v1` is what the reference itself costs.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pandas as pd

from bench.atomic import write_text
from bench.audit.sources import OpenedSource, audit_each
from bench.commands.console import print_failures, say, take_verbosity
from bench.commands.options import rendered_card
from bench.errors import DataError
from bench.evaluation import count_frame, load_protocol
from bench.execution import local_executor, usable_cores
from bench.harness.exact import exact_mask
from bench.recordings import Recording, read_truth
from bench.reference import ReferenceBuilder, Status
from bench.synthesis import Scenario
from bench.synthesis.ego import mounted_rig
from bench.synthesis.scanner import scans
from bench.synthesis.scenario import LidarSpec, RecordingSpec
from bench.synthesis.scene import Scene, build_scene

PROTOCOL = "surface-v1"
# What differs from the scenario's lidar.
SENSORS: dict[str, dict[str, object]] = {
    "one origin": {"beams": "one_origin", "weakest_reflectance": 0.0},
    "two blocks": {"beams": "two_blocks", "weakest_reflectance": 0.0},
    "one origin, dark surfaces lost": {"beams": "one_origin", "weakest_reflectance": 0.03},
    "two blocks, dark surfaces lost": {"beams": "two_blocks", "weakest_reflectance": 0.03},
}
EVERY = 4  # so many images apart


def scanned_by(
    recording: Recording, scene: Scene, scenario: Scenario, spec: RecordingSpec, lidar: LidarSpec
) -> Recording:
    """The recording with the sweeps of another lidar in the same place.

    Raises:
        DataError: the recording has sweeps at other times than its scenario says.
    """
    other = scenario.model_copy(update={"lidar": lidar})
    mounting = mounted_rig(other, spec).vehicle_from_lidar
    sweeps = {sweep.timestamp_ns: sweep for sweep in scans(other, spec, scene, vehicle_from_lidar=mounting)}
    stated = {ref.timestamp_ns for ref in recording.sweeps}
    if stated != set(sweeps):
        expected, got = "sweeps at the times of its scenario", f"{len(stated ^ set(sweeps))} at others"
        raise DataError(recording.root, expected=expected, got=got, hint="render it again")
    return replace(
        recording,
        sweeps=tuple(replace(ref, reader=lambda _, time_ns: sweeps[time_ns]) for ref in recording.sweeps),
    )


def score_recording(opened: OpenedSource) -> pd.DataFrame:
    """Score the exact masks by every sensor: a row for each image, and each evaluated object-frame.

    Raises:
        DataError: the recording is not of its scenario.
    """
    if opened.source.scene is None:
        raise DataError(opened.recording.root, expected="a recording of the card's scenario", got="another")
    scenario, spec = opened.source.scene
    scene = build_scene(scenario, spec)
    rows: list[dict[str, object]] = []
    for name, changes in SENSORS.items():
        lidar = LidarSpec.model_validate(scenario.lidar.model_dump() | changes)
        recording = scanned_by(opened.recording, scene, scenario, spec, lidar)
        rows += [{"sensor": name} | row for row in _rows(recording, opened)]
    return pd.DataFrame(rows)


def _rows(recording: Recording, opened: OpenedSource) -> Iterator[dict[str, object]]:
    protocol = load_protocol(PROTOCOL)
    large_px = protocol.scoring.false_positive_component_px
    for camera, images in recording.images.items():
        builder = ReferenceBuilder(recording, camera, protocol.reference_settings())
        for image in images[2::EVERY]:
            reference, ids = builder.build(image), read_truth(image, recording.cameras[camera])
            opened.images += 1
            truth = exact_mask(ids, recording, reference)
            frame, objects = count_frame(reference, truth, component_size_px=large_px)
            yield {"what": "image", "exact_fp": frame.fp_px / (frame.width * frame.height)}
            for number, (item, counts) in enumerate(zip(reference.objects, objects, strict=True), start=1):
                if item.status is Status.EVALUATED:
                    core, mask = reference.labels == number, ids == opened.instance_of[item.track_id]
                    yield {
                        "what": item.object_class,
                        "ceiling": counts.tp / (counts.tp + counts.fn + counts.fp),
                        "unknown": item.unknown_px / (item.unknown_px + item.region_px),
                        "core_px": int(core.sum()),
                        "core_outside_px": int((core & ~mask).sum()),
                        "mask_px": int(mask.sum()),
                        "left_out_px": int((mask & ~core & ~reference.ignored).sum()),
                    }


def table(rows: pd.DataFrame) -> str:
    """Markdown: a line for each sensor and class, in percent."""
    lines = [
        "| lidar | objects | frames | ceiling, IoU | unknown share | core outside of the mask "
        "| mask in neither core nor band | false positives of the exact masks |",
        "|---|---|---:|---:|---:|---:|---:|---:|",
    ]
    for sensor in SENSORS:
        of_sensor = rows[rows["sensor"] == sensor]
        images, objects = of_sensor[of_sensor["what"] == "image"], of_sensor[of_sensor["what"] != "image"]
        false = f"{images['exact_fp'].mean():.3%}"
        for name in ("all", *sorted(objects["what"].unique())):
            shown = objects if name == "all" else objects[objects["what"] == name]
            sums = shown[["core_px", "core_outside_px", "mask_px", "left_out_px"]].sum()
            shares = sums["core_outside_px"] / sums["core_px"], sums["left_out_px"] / sums["mask_px"]
            values = [shown["ceiling"].mean(), shown["unknown"].mean(), *shares]
            cells = " | ".join(f"{value:.1%}" for value in values)
            lines.append(f"| {sensor} | {name} | {len(shown)} | {cells} | {false if name == 'all' else ''} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("card", help="a rendered data set")
    parser.add_argument("--split")
    parser.add_argument("--recordings", type=int, help="how many, spread over the split")
    parser.add_argument("--out", type=Path, default=Path("reports/audit/sensors.md"))
    parser.add_argument("--workers", type=int, default=usable_cores())
    asked = parser.parse_args()
    executor = local_executor(asked.workers)
    card = rendered_card(asked.card, asked.split, executor=executor)
    found, stored = audit_each(
        score_recording,
        card=card,
        split=asked.split,
        recordings=asked.recordings,
        executor=executor,
        progress=None,
    )
    split = "" if asked.split is None else f", {asked.split}"
    text = f"# The reference by sensor: {card.name}{split}\n\n"
    text += f"{stored.recordings} drives, every {EVERY}th image, `{PROTOCOL}`; by `python -m benchmarks.sensors`.\n\n"
    text += table(pd.concat(found, ignore_index=True))
    asked.out.parent.mkdir(parents=True, exist_ok=True)
    write_text(asked.out, text)
    take_verbosity([])
    print_failures(stored.failures, all_in=str(asked.out))
    say(text)


if __name__ == "__main__":
    main()
