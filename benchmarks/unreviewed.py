"""Scores by proposals that nobody looked at, against scores by the annotations: is such a reference good enough?

python -m benchmarks.unreviewed writes the tables into reports/studies/proposals.md. Drives of `paper`, drawn by a
fixed seed before
the first look, are proposed as they are and with a weakness in each (`CONDITIONS`). Methods are then scored by
`surface-v1` twice on the same data: by the drives' own annotations, and by the proposals, unreviewed.
"""

from __future__ import annotations

import argparse
import random
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import kendalltau

import bench
from bench.annotation.decisions import to_tracks
from bench.annotation.drives import evaluate_drives, propose_drives
from bench.annotation.evaluate import proposal_scores
from bench.annotation.store import read_review, review_file
from bench.execution import ProcessExecutor
from bench.methods.registry import known_methods
from bench.recordings import load_card, open_dataset, write_annotations
from bench.synthesis import read_scenario, synthesize
from benchmarks import planting
from benchmarks.false_alarms import with_table
from benchmarks.mistakes import MISTAKES
from benchmarks.ranking.beams import of_rings

ROOT = Path(__file__).parents[1]
SCENARIO = ROOT / "datasets" / "paper.scenario.yaml"
DOCS = ROOT / "reports/studies/proposals.md"
MARKERS = "<!-- written by python -m benchmarks.unreviewed -->", "<!-- end -->"
SEED, DRIVES, LEAST_RECORDINGS = 2900, 25, 6
CEILING = "truth"
FEW = ("spherical", "epipolar-only", "rigid-scene", "learned", "frame-difference")  # of drives with a weakness
CARD = """
name: {name}
title: Drives by {name}
source: rendered
how_to_get: rendered
licence: CC0-1.0
adapter: native
splits: {{all: "*"}}
root: {root}
options: {{ego_motion: recorded, calibration: recorded}}
"""


_PLANTED = {mistake.name: mistake.plant for mistake in MISTAKES}
CONDITIONS: dict[str, Callable[[Path], object]] = {
    "as recorded": lambda _root: None,
    "yaw rate off by 1 degree per second": _PLANTED["yaw rate off by 1 degree per second"],
    "speed 2 % too high": _PLANTED["speed 2 % too high"],
    "32 of 64 beams": lambda root: planting.change_sweeps(root, partial(of_rings, rings=np.arange(0, 64, 2))),
}


def prepare(drives: Sequence[Path], condition: str, folder: Path, workers: int) -> tuple[Path, Path, pd.DataFrame]:
    """Make the two data sets of a condition.

    Returns:
        Card of the drives with their annotations, card of the same with proposals, and scores of the proposals.
    """
    root, proposed = folder / "annotations", folder / "proposals"
    for drive in drives:
        if not (proposed / drive.name).exists():
            copy = shutil.copytree(drive, root / drive.name)
            CONDITIONS[condition](copy)
            shutil.copytree(copy, proposed / drive.name, ignore=shutil.ignore_patterns("annotations.json"))
    cards = [folder / "annotations.yaml", folder / "proposals.yaml"]
    for card, data in zip(cards, (root, proposed), strict=True):
        card.write_text(CARD.format(name=data.name, root=data), "utf-8")
    handles, executor = open_dataset(load_card(cards[0])), ProcessExecutor(workers=workers)
    failed = [
        drive.failure for drive in propose_drives("annotations", handles, folder, executor=executor) if drive.failure
    ]
    assert not failed, failed
    frames, minutes = evaluate_drives(handles, folder, executor=executor)
    found = frames[frames["outcome"] == "found"]
    for handle in handles:
        of_drive = found[found["recording"] == handle.name]
        names = of_drive.groupby("proposal")["object"].agg(lambda objects: objects.mode()[0]).drop_duplicates()
        recording, review = handle.open(), read_review(review_file(folder, handle.name))
        masks = {track.track_id: track.instance_id for track in recording.tracks}
        tracks = [
            replace(track, instance_id=masks.get(names.get(track.track_id, "")))
            for track in to_tracks(review, recording, unreviewed=True)
        ]
        if tracks:
            times_ns = [sweep.timestamp_ns for sweep in recording.sweeps]
            write_annotations(proposed / handle.name / "annotations.json", tracks, timestamps_ns=times_ns)
    return *cards, proposal_scores(frames, minutes=minutes)


def scores(card: Path, methods: Sequence[str], folder: Path, workers: int) -> pd.DataFrame:
    """Score methods on a data set.

    Returns:
        One row for each method and row of the table: `object_frames`, `recordings`, and in percent `iou`, `tpr_all`
        and `false_positives`.
    """
    scored = []
    for method in methods:
        out = folder / f"{card.stem}-{method}"
        run = bench.run(card, method, protocol="surface-v1", pictures=False, out=out, workers=workers)
        recordings = run.objects[run.objects["status"] == "evaluated"].groupby("category")["recording"].nunique()
        table = 100 * run.metrics[["iou", "tpr_all"]].astype(float)
        table["object_frames"], table["recordings"] = run.metrics["object_frames"], recordings
        table["false_positives"] = 100 * run.false_positives
        scored.append(table.rename_axis("row").reset_index().assign(method=method))
    return pd.concat(scored, ignore_index=True)


def compared(by_annotations: pd.DataFrame, by_proposals: pd.DataFrame) -> pd.DataFrame:
    """One row for each row of the table: tau of the methods' two orders by IoU, and the largest differences.

    Returns:
        `row`, `object_frames` by either, `tau` (tau-b, NaN if it is less than `LEAST_RECORDINGS` recordings),
        `ceiling` (change of the IoU of exact masks), `iou`, `tpr_all` and `false_positives` (largest change of a
        method, with its sign) and `method` (the one whose IoU changed most).
    """
    both = by_annotations.merge(by_proposals, on=["method", "row"], suffixes=("", "_proposed"))
    rows = []
    for row, of_row in both.groupby("row", sort=False):
        exact = of_row["method"] == CEILING
        real = of_row[~exact]
        changes = {name: real[f"{name}_proposed"] - real[name] for name in ("iou", "tpr_all", "false_positives")}
        enough = row == "all_moving" or bool((of_row["recordings"] >= LEAST_RECORDINGS).all())
        worst = changes["iou"].abs()
        rows.append(
            {
                "row": row,
                "object_frames": int(of_row["object_frames"].iloc[0]),
                "object_frames_proposed": int(of_row["object_frames_proposed"].iloc[0]),
                "tau": float(kendalltau(real["iou"], real["iou_proposed"]).statistic) if enough else float("nan"),
                "ceiling": float((of_row["iou_proposed"] - of_row["iou"])[exact].sum())
                if exact.any()
                else float("nan"),
                **{
                    name: float(change.loc[change.abs().idxmax()])
                    for name, change in changes.items()
                    if change.notna().any()
                },
                "method": real["method"][worst.idxmax()] if worst.notna().any() else "",
            }
        )
    return pd.DataFrame(rows)


def table(condition: str, found: pd.DataFrame, proposals: pd.DataFrame) -> Iterator[str]:
    """Lines about a condition: the proposals, then rows of `compared`."""
    near, far = (proposals.query("range == @band and group == 'all'").iloc[0] for band in ("< 8 m", "< 20 m"))
    yield (
        f"**{condition.capitalize()}**: recall {100 * near['recall']:.1f} %, precision "
        f"{100 * near['precision']:.1f} % within 8 m; {100 * far['recall']:.1f} and "
        f"{100 * far['precision']:.1f} % within 20 m, {far['false_tracks_per_minute']:.1f} false tracks a minute."
    )
    yield ""
    yield "| row | object-frames | by proposals | tau | ceiling | IoU | method | TPR | false positives |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for one in found.itertuples():
        tau = "n/a" if np.isnan(one.tau) else f"{one.tau:.2f}"
        yield (
            f"| {str(one.row).replace('_', ' ')} | {one.object_frames} | {one.object_frames_proposed} | {tau} "
            f"| {one.ceiling:+.1f} | {one.iou:+.1f} | {one.method} | {one.tpr_all:+.1f} | {one.false_positives:+.1f} |"
        )
    yield ""


def main() -> None:
    """Render the drives, propose, score, write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=ROOT / "datasets" / "data" / "paper", help="rendered `paper`")
    parser.add_argument("--folder", type=Path, required=True, help="of copies, reviews and runs; what is there is used")
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    names = random.Random(SEED).sample(sorted(spec.name for spec in read_scenario(SCENARIO).recordings), DRIVES)
    synthesize(SCENARIO, asked.data, only=names, workers=asked.workers)
    lines: list[str] = []
    for number, condition in enumerate(CONDITIONS):
        folder = asked.folder / str(number)
        by_annotations, by_proposals, proposals = prepare(
            [asked.data / name for name in sorted(names)], condition, folder, asked.workers
        )
        methods = [CEILING, *(known_methods() if number == 0 else FEW)]
        pair = [scores(card, methods, folder, asked.workers) for card in (by_annotations, by_proposals)]
        lines += table(condition, compared(*pair), proposals)
        sys.stdout.write("\n".join(lines) + "\n")
        sys.stdout.flush()
    DOCS.write_text(with_table(DOCS.read_text("utf-8"), lines[:-1], MARKERS), "utf-8")


if __name__ == "__main__":
    main()
