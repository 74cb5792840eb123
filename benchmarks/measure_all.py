"""All figures of speed and memory in one go: `python -m benchmarks.measure_all --out reports/perf.md`.

Times of single functions are those of the processor, in turns; a run prints its own time and memory.
"""

from __future__ import annotations

import argparse
import platform
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from bench.atomic import write_text
from bench.evaluation.protocol import load_protocol
from bench.execution import usable_cores
from bench.flow.dense import DenseFlow, DisFlow, FarnebackFlow
from bench.harness.digests import library_versions
from bench.methods import build_method
from bench.recordings import Recording, load_card, open_dataset
from benchmarks import large_run
from benchmarks.stages import PerfReport, measure, reference_ms

Row = Sequence[object]
REPORT_STEPS = ("summary", "tables", "page")


def table(heading: Row, rows: Iterable[Row]) -> str:
    """A Markdown table."""
    lines = [heading, ["---"] + ["---:"] * (len(heading) - 1), *rows]
    return "\n".join("| " + " | ".join(map(_shown, line)) + " |" for line in lines)


def _shown(value: object) -> str:
    if isinstance(value, float):
        return "" if np.isnan(value) else f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"
    return str(value)


def _recordings(card: Path) -> Iterator[Recording]:
    return (handle.open() for handle in open_dataset(load_card(str(card))))


def stages(card: Path) -> str:
    """Each stage of an image, and the whole against the flow alone."""
    reports: dict[str, PerfReport] = {}
    flows: dict[str, tuple[dict[str, object], DenseFlow]] = {
        "Farnebäck": ({}, FarnebackFlow()),
        "DIS fast": ({"flow": "dis", "flow_parameters": {"preset": "fast"}}, DisFlow(preset="fast")),
    }
    for name, (settings, flow) in flows.items():
        reports[name] = measure(
            _recordings(card),
            method=build_method("spherical", settings),
            protocol=load_protocol("paper-v1"),
            images=100,
            flow=flow,
        )
    names = sorted({name for report in reports.values() for name in report.stage_ms})
    rows = [[f"{name}, ms", *(report.stage_ms.get(name, 0.0) for report in reports.values())] for name in names]
    rows += [
        ["whole, ms", *(report.total_ms for report in reports.values())],
        ["flow alone, ms", *(report.flow_ms for report in reports.values())],
        ["**whole / flow alone**", *(f"**{report.ratio:.3f}**" for report in reports.values())],
        ["aim", "1.15", "2.0"],
    ]
    return table([f"{reports['Farnebäck'].images} images of 640 x 480", *reports], rows)


def reference(card: Path) -> str:
    """Reference by each protocol."""
    spent = reference_ms(_recordings(card), ("paper-v1", "surface-v1"))
    rows: list[Row] = [*spent.items()]
    rows.append(["**surface-v1 / paper-v1** (aim: 2)", f"**{spent['surface-v1'] / spent['paper-v1']:.2f}**"])
    return table(["reference", "ms per image"], rows)


def reports(_: Path) -> str:
    """Summary, tables and page of 10,000 object-frames."""
    with tempfile.TemporaryDirectory() as folder:
        runs = large_run.write_runs(Path(folder), object_frames=10_000)
        spent = {step: large_run.measure(step, runs) for step in REPORT_STEPS}
    rows = [[step, one.seconds, one.cpu_seconds, one.peak_mb] for step, one in spent.items()]
    whole = [sum(one.seconds for one in spent.values()), sum(one.cpu_seconds for one in spent.values())]
    rows += [["**together** (aim: below 15 s)", *whole, max(one.peak_mb for one in spent.values())]]
    return table(["10,000 object-frames", "s", "processor s", "peak MB"], rows)


SECTIONS: dict[str, tuple[str, Callable[[Path], str]]] = {
    "stages": ("From file to counts, against the flow alone", stages),
    "reference": ("Reference by protocol", reference),
    "reports": ("Reports", reports),
}


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--card", type=Path, default=Path("datasets/demo.yaml"))
    parser.add_argument("--out", type=Path, default=Path("reports/perf.md"))
    parser.add_argument("--only", nargs="*", choices=SECTIONS, default=list(SECTIONS))
    asked = parser.parse_args()
    libraries = ", ".join(f"{name} {version}" for name, version in library_versions().items())
    parts = [
        "# Speed and memory",
        f"{usable_cores()} cores, {platform.machine()}, {platform.system()}, Python {platform.python_version()}, "
        f"{libraries}. Times of single functions are those of the processor, of pieces of work that took turns; times "
        "of reports are on the clock, too.",
    ]
    for name in asked.only:
        title, measured = SECTIONS[name]
        parts += [f"## {title}", measured(asked.card)]
        sys.stdout.write(f"{parts[-2]}\n\n{parts[-1]}\n\n")
        sys.stdout.flush()
    write_text(asked.out, "\n\n".join(parts) + "\n")


if __name__ == "__main__":
    main()
