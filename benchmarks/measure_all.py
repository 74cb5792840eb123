"""All figures of speed and memory in one go: `python -m benchmarks.measure_all --out reports/perf.md`.

Times of single functions are those of the processor, in turns; times of whole runs are on the clock.
"""

from __future__ import annotations

import argparse
import platform
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
import yaml

from bench.atomic import write_text
from bench.evaluation import load_protocol
from bench.execution import usable_cores
from bench.flow import DenseFlow, DisFlow, FarnebackFlow
from bench.harness.digests import library_versions
from bench.harness.frames import FramePipeline
from bench.methods import build_method
from bench.recordings import load_card, open_dataset
from benchmarks import large_run, masks, parallel, projections, references, simulation
from benchmarks.enlarged import enlarge
from benchmarks.stages import PerfReport
from benchmarks.stages import measure as measure_stages

Row = Sequence[object]
LARGE = (1280, 966)
PART = "part"
REPORT_STEPS = ("summary", "tables", "page")


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """Settings of the measurement.

    Attributes:
        card: a rendered native data set.
        images: of the parallel runs, about.
        rounds: of each comparison of whole runs.
        stage_images: of the stages.
    """

    card: Path
    images: int
    rounds: int
    stage_images: int


def table(heading: Row, rows: Iterable[Row]) -> str:
    """A Markdown table."""
    lines = [heading, ["---"] + ["---:"] * (len(heading) - 1), *rows]
    return "\n".join("| " + " | ".join(map(_shown, line)) + " |" for line in lines)


def _shown(value: object) -> str:
    if isinstance(value, float):
        return "" if np.isnan(value) else f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"
    return str(value)


def stages(asked: Asked) -> str:
    """Each stage of an image, and the whole against the flow alone."""
    found: dict[str, PerfReport] = {}
    flows: dict[str, tuple[dict[str, object], DenseFlow]] = {
        "Farnebäck": ({}, FarnebackFlow()),
        "DIS fast": ({"flow": "dis", "flow_parameters": {"preset": "fast"}}, DisFlow(preset="fast")),
    }
    for name, (settings, flow) in flows.items():
        found[name] = measure_stages(
            (handle.open() for handle in open_dataset(load_card(str(asked.card)))),
            method=build_method("spherical", settings),
            protocol=load_protocol("paper-v1"),
            images=asked.stage_images,
            progress=lambda *_: None,
            flow=flow,
        )
    names = sorted({name for report in found.values() for name in report.stage_ms})
    rows = [[f"{name}, ms", *(report.stage_ms.get(name, 0.0) for report in found.values())] for name in names]
    rows += [
        ["whole, ms", *(report.total_ms for report in found.values())],
        ["flow alone, ms", *(report.flow_ms for report in found.values())],
        ["**whole / flow alone**", *(f"**{report.ratio:.3f}**" for report in found.values())],
        ["aim", "1.15", "2.0"],
    ]
    return table([f"{found['Farnebäck'].images} images of 640 x 480", *found], rows)


def reference(asked: Asked) -> str:
    """Reference by each protocol."""
    opened = (handle.open() for handle in open_dataset(load_card(str(asked.card))))
    found = references.milliseconds(opened, ("paper-v1", "surface-v1"))
    ratio = found["surface-v1"] / found["paper-v1"]
    rows: list[Row] = [[name, ms] for name, ms in found.items()]
    rows.append(["**surface-v1 / paper-v1** (aim: 2)", f"**{ratio:.2f}**"])
    return table(["reference", "ms per image"], rows)


def projection(_: Asked) -> str:
    """Lenses."""
    rows = projections.microseconds_per_point()
    of_cv2 = rows["cv2.fisheye"]
    return table(
        ["µs per point", "project", "unproject", "project / cv2", "unproject / cv2"],
        ([name, *both, *(one / other for one, other in zip(both, of_cv2, strict=True))] for name, both in rows.items()),
    )


def overlaps(asked: Asked) -> str:
    """Masks."""
    method, protocol, scored = build_method("spherical", {}), load_protocol("paper-v1"), []
    for handle in islice(open_dataset(load_card(str(asked.card))), 8):
        recording = handle.open()
        pipeline = FramePipeline(recording, sorted(recording.cameras)[0], method=method, protocol=protocol)
        for index in (5, 15, 25):
            done = pipeline.process(index)
            scored.append((done.reference, done.segmentation.mask_at(*_size(done.reference.valid))))
    return table([f"ms per image, over {len(scored)}", "time"], masks.milliseconds(scored).items())


def _size(valid: np.ndarray) -> tuple[int, int]:
    return valid.shape[1], valid.shape[0]


def reports(_: Asked) -> str:
    """Summary, tables and page of 10,000 object-frames."""
    with tempfile.TemporaryDirectory() as folder:
        runs = large_run.write_runs(Path(folder), object_frames=10_000)
        spent = {step: large_run.measure(step, runs) for step in REPORT_STEPS}
    rows = [[step, one.seconds, one.cpu_seconds, one.peak_mb] for step, one in spent.items()]
    whole = [sum(one.seconds for one in spent.values()), sum(one.cpu_seconds for one in spent.values())]
    rows += [["**together** (aim: below 15 s)", *whole, max(one.peak_mb for one in spent.values())]]
    return table(["10,000 object-frames", "s", "processor s", "peak MB"], rows)


def rendering(_: Asked) -> str:
    """One image and one revolution of the lidar."""
    seconds = simulation.seconds()
    flow_s = seconds["Farnebäck"]
    return table(["640 x 480", "ms", "/ Farnebäck"], ([n, 1e3 * s, s / flow_s] for n, s in seconds.items()))


def efficiency(asked: Asked) -> str:
    """One process against one per core."""
    workers = usable_cores()
    with tempfile.TemporaryDirectory() as folder:
        card = _part_of(asked.card, Path(folder), images=asked.images)
        one, several = parallel.best_costs(card, "--split", PART, workers=workers, rounds=asked.rounds)
        machine = parallel.two_at_once(card, "--split", PART)
        stop_s = parallel.seconds_to_stop(card, "--split", PART)
    reached = one.seconds / several.seconds / workers
    rows = [
        ["1 process, s", one.seconds],
        [f"{workers} processes, s", several.seconds],
        ["images per second", several.images / several.seconds],
        ["**efficiency** (aim: 0.9)", f"**{reached:.3f}**"],
        [
            "the same from processor seconds, as on a machine that does nothing else",
            parallel.efficiency_of_processor_time(one, several, workers=workers),
        ],
        ["two runs of 1 process side by side, against one alone (what the machine gives)", machine],
        ["from Ctrl-C to the end of the last process, s (bound: 2)", stop_s],
    ]
    return table([f"whole commands, {several.images} images, best of {asked.rounds} in turns", ""], rows)


def memory(asked: Asked) -> str:
    """Largest process, by size and number of images."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for size in ((640, 480), LARGE):
            for images in (100, 400):
                place = Path(folder) / f"{size[0]}-{images}"
                card = _part_of(asked.card, place, images=images, size=None if size == (640, 480) else size)
                cost = parallel.run_cost(card, "--split", PART, "--workers", 2)
                rows.append([f"{size[0]} x {size[1]}", cost.images, cost.peak_mb])
    return table(["size", "images", "peak MB of a process"], rows)


def _part_of(card: Path, place: Path, *, images: int, size: tuple[int, int] | None = None) -> Path:
    """The card of so many recordings as hold the images."""
    content = load_card(str(card))
    chosen: list[str] = []
    for handle in open_dataset(content):
        if images <= 0:
            break
        chosen.append(handle.name)
        images -= sum(len(found) for found in handle.open().images.values()) - 1
    place.mkdir(parents=True, exist_ok=True)
    if size is not None:
        return enlarge([content.root / name for name in chosen], place, width=size[0], height=size[1])
    described = {
        "name": "part", "title": "a part", "adapter": "native", "licence": content.content.licence,
        "root": str(content.root.resolve()), "splits": {PART: chosen},
    }  # fmt: skip
    (place / "part.yaml").write_text(yaml.safe_dump(described))
    return place / "part.yaml"


SECTIONS: dict[str, tuple[str, Callable[[Asked], str]]] = {
    "stages": ("From file to counts, against the flow alone", stages),
    "reference": ("Reference by protocol", reference),
    "projection": ("Lenses against `cv2.fisheye` and a loop", projection),
    "masks": ("Masks against `pycocotools`", overlaps),
    "reports": ("Reports", reports),
    "rendering": ("Rendering", rendering),
    "parallel": ("Side by side", efficiency),
    "memory": ("Memory", memory),
}


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--card", type=Path, default=Path("datasets/demo.yaml"))
    parser.add_argument("--out", type=Path, default=Path("reports/perf.md"))
    parser.add_argument("--images", type=int, default=400)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--stage-images", type=int, default=100)
    parser.add_argument("--only", nargs="*", choices=SECTIONS, default=list(SECTIONS))
    given = parser.parse_args()
    asked = Asked(card=given.card, images=given.images, rounds=given.rounds, stage_images=given.stage_images)
    libraries = ", ".join(f"{name} {version}" for name, version in library_versions().items())
    parts = [
        "# Speed and memory",
        f"{usable_cores()} cores, {platform.machine()}, {platform.system()}, Python {platform.python_version()}, "
        f"{libraries}. Times of single functions are those of the processor, of pieces of work that took turns; times "
        "of whole commands are on the clock.",
    ]
    for name in given.only:
        title, measured = SECTIONS[name]
        parts += [f"## {title}", measured(asked)]
        sys.stdout.write(f"{parts[-2]}\n\n{parts[-1]}\n\n")
        sys.stdout.flush()
    write_text(given.out, "\n\n".join(parts) + "\n")


if __name__ == "__main__":
    main()
