"""Mistakes that people make with a drive of their own, planted into rendered drives: what `validate` says of each.

python -m benchmarks.planted_mistakes writes the table into reports/studies/planted-mistakes.md, with --only some of its
rows; with --scores it tells by how much a mistake changes scores. Each mistake goes into a copy of each drive of
planted.scenario.yaml that it can be told in, and the copy is validated. A mistake is found with the right lead where a
finding that the clean drive does not have names the cause (`Mistake.lead`), weakly where findings name something else;
without one the report may say that the drive cannot tell (`UNKNOWN`), else the mistake is silent.
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pandas as pd

import bench
from bench.execution import use_one_thread
from bench.recordings.native import native_recordings
from bench.synthesis import synthesize
from bench.validation.findings import Finding
from bench.validation.report import RecordingReport, validate_recording
from benchmarks.false_alarms import with_table
from benchmarks.mistakes import MISTAKES, Mistake

HERE = Path(__file__).parent
SCENARIO = HERE / "planted.scenario.yaml"
DOCS = HERE.parent / "reports/studies/planted-mistakes.md"
MARKERS = "<!-- written by python -m benchmarks.planted_mistakes -->", "<!-- end -->"

VERDICTS = {
    "right lead": "found with the right lead",
    "weak": "with another",
    "cannot tell": "where the report says that the drive cannot tell",
    "silent": "silent",
}
# What the report says that it cannot tell, by part of a mistake: regular expressions.
UNKNOWN = {
    "lidar": "mounting of the lidar",
    "clocks": "clock",
    "camera": "calibration.*camera (front|right)",
    "ego-motion": "ego-motion|scale|bias",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Answer of validation to a mistake in a drive.

    Attributes:
        mistake: its name.
        part: its part.
        drive: the drive's name.
        verdict: of `VERDICTS`.
        findings: texts of the findings that the clean drive does not have.
    """

    mistake: str
    part: str
    drive: str
    verdict: str
    findings: tuple[str, ...]


def report_of(root: Path) -> RecordingReport:
    """Validate one recording in the native format."""
    (handle,) = native_recordings(root, options={}, card=root / "card.yaml", annotations=None)
    return validate_recording(handle)


@cache
def _clean_texts(drive: Path) -> frozenset[str]:
    return frozenset(text_of(finding) for finding in report_of(drive).findings)


def text_of(finding: Finding) -> str:
    """Text of a finding, check to hint."""
    return " | ".join(
        str(part) for part in (finding.check, finding.field, finding.expected, finding.got, finding.hint) if part
    )


def judged(index: int, drive: Path) -> Outcome:
    """Plant the mistake of this place in `MISTAKES` into a copy of a drive, and validate it."""
    mistake = MISTAKES[index]
    with tempfile.TemporaryDirectory() as folder:
        root = shutil.copytree(drive, Path(folder) / drive.name)
        mistake.plant(root)
        report = report_of(root)
    new = sorted({text_of(finding) for finding in report.findings} - _clean_texts(drive))
    doubt = UNKNOWN.get(mistake.part)
    if any(re.search(mistake.lead, text, re.IGNORECASE) for text in new):
        verdict = "right lead"
    elif new:
        verdict = "weak"
    elif doubt is not None and any(re.search(doubt, unknown.about) for unknown in report.undecided):
        verdict = "cannot tell"
    else:
        verdict = "silent"
    return Outcome(mistake=mistake.name, part=mistake.part, drive=drive.name, verdict=verdict, findings=tuple(new))


CARD = """
name: planted
title: Drives with mistakes
source: rendered
how_to_get: rendered
licence: CC0-1.0
adapter: native
splits: {{all: "*"}}
root: {root}
"""


def scores(drive: Path, mistake: Mistake | None = None) -> pd.Series[float]:
    """Score `rigid-scene` on a copy of a drive.

    Returns:
        Evaluated object-frames; IoU and TPR over all moving, and false positives, in percent.
    """
    with tempfile.TemporaryDirectory() as folder:
        root, card = shutil.copytree(drive, Path(folder) / "data" / drive.name), Path(folder) / "card.yaml"
        if mistake is not None:
            mistake.plant(root)
        card.write_text(CARD.format(root=root.parent), "utf-8")
        run = bench.run(card, "rigid-scene", protocol="surface-v1", pictures=False, out=Path(folder) / "run")
        row = run.metrics.loc["all_moving"]
        values = [row["object_frames"], 100 * row["iou"], 100 * row["tpr_all"], 100 * run.false_positives]
        return pd.Series(values, index=["object-frames", "IoU", "TPR", "false positives"])


def effects(tasks: Sequence[tuple[int, Path]]) -> Iterator[str]:
    """A line for each mistake: by how much the scores of the drive change."""
    clean: dict[Path, pd.Series[float]] = {}
    for index, drive in tasks:
        if drive not in clean:
            clean[drive] = scores(drive)
            yield f"{drive.name}: " + ", ".join(f"{name} {value:.1f}" for name, value in clean[drive].items())
        changes = scores(drive, MISTAKES[index]) - clean[drive]
        yield f"{MISTAKES[index].name} in {drive.name}: " + ", ".join(f"{name} {x:+.1f}" for name, x in changes.items())


def counted(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """In how many drives each mistake is found, by mistake: `part`, and a column for each of `VERDICTS`."""
    table = pd.DataFrame(outcomes)
    counts = pd.crosstab(table["mistake"], table["verdict"]).reindex(columns=list(VERDICTS), fill_value=0)
    parts = table.drop_duplicates("mistake").set_index("mistake")["part"]
    return counts.reindex(parts.index).assign(part=parts)[["part", *VERDICTS]]


def written(page: str) -> pd.DataFrame:
    """Counts that a page's table has, as `counted`."""
    rows = re.findall(r"^\| ([^|]+) \| ([a-z-]+) \|" + len(VERDICTS) * r" (\d+) \|" + "$", page, re.MULTILINE)
    table = pd.DataFrame(rows, columns=["mistake", "part", *VERDICTS]).set_index("mistake")
    return table.astype(dict.fromkeys(VERDICTS, int))


def table(counts: pd.DataFrame, drives: Sequence[str]) -> Iterator[str]:
    """Lines of the table: in how many drives each mistake is found, and the sum."""
    total = counts[list(VERDICTS)].sum()
    sums = ", ".join(f"{total[verdict]} {said}" for verdict, said in VERDICTS.items())
    yield f"{total.sum()} planted mistakes in {', '.join(drives)}: {sums}."
    yield ""
    yield f"| mistake | part | {' | '.join(VERDICTS)} |"
    yield (2 + len(VERDICTS)) * "|---" + "|"
    for mistake, part, *numbers in counts.itertuples():
        yield f"| {mistake} | {part} | {' | '.join(map(str, numbers))} |"


def main() -> None:
    """Render the drives, plant the mistakes, write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=HERE.parent / "datasets" / "data" / "planted")
    parser.add_argument("--only", default="", help="regular expression of mistakes' names or parts; other rows stay")
    parser.add_argument("--scores", action="store_true", help="print by how much each mistake changes scores instead")
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    synthesize(SCENARIO, asked.data, workers=asked.workers)
    drives = {folder.name: folder for folder in sorted(asked.data.iterdir()) if (folder / "recording.json").is_file()}
    tasks = [
        (index, drives[name])
        for index, mistake in enumerate(MISTAKES)
        if re.search(asked.only, f"{mistake.part} {mistake.name}")
        for name in mistake.drives or sorted(drives)
    ]
    if asked.scores:
        for line in effects(tasks):
            sys.stdout.write(f"{line}\n")
            sys.stdout.flush()
        return
    with ProcessPoolExecutor(asked.workers, initializer=use_one_thread) as pool:
        outcomes = []
        for outcome in pool.map(judged, *zip(*tasks, strict=True)):
            outcomes.append(outcome)
            lines = [f"{outcome.mistake} in {outcome.drive}: {outcome.verdict}", *outcome.findings]
            sys.stdout.write("\n    ".join(lines) + "\n")
            sys.stdout.flush()
    page, counts = DOCS.read_text("utf-8"), counted(outcomes)
    names = [mistake.name for mistake in MISTAKES]
    before = written(page)
    counts = pd.concat([counts, before[~before.index.isin(counts.index)]]).loc[lambda rows: rows.index.isin(names)]
    counts = counts.reindex([name for name in names if name in counts.index])
    DOCS.write_text(with_table(page, list(table(counts, sorted(drives))), MARKERS), "utf-8")


if __name__ == "__main__":
    main()
