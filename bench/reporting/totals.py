"""Totals of a run in lines: what became of objects and images, and what the run cost."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import pandas as pd

from bench.evaluation import Protocol
from bench.evaluation.rows import EVALUATED, NOT_ANNOTATED, read_parts
from bench.evaluation.summary import not_annotated
from bench.harness import Provenance, RunSummary, StoredRun
from bench.plain_text import counted
from bench.reference import IgnoreReason
from bench.reporting.tables import threshold_free_line

FILLED = 0.5  # of the valid pixels: more in every image is no moving object


def total_lines(summary: RunSummary, protocol: Protocol) -> Iterator[str]:
    """Numbers of objects and images that were evaluated, and reasons that the others were not."""
    ledger, images = summary.objects, summary.images
    limits: dict[str, str] = {IgnoreReason.RANGE: f" (beyond {protocol.reference.range_limit_m:g} m)"}
    reasons = [f"{count} {reason}{limits.get(reason, '')}" for reason, count in ledger.ignored.items() if count]
    yield (
        f"{ledger.annotated} annotated object-frames: {ledger.evaluated} evaluated, {ledger.static} static, "
        f"ignored: {', '.join(reasons) or 'none'}"
    )
    if summary.threshold_free is not None:
        yield threshold_free_line(summary.threshold_free)
    ended = f"{images.evaluated} scored, {images.skipped} skipped, {images.failed} failed"
    yield f"{counted(images.images, 'image')}: {ended}"
    if unscored := not_annotated(summary):
        yield unscored
    if summary.unreviewed:
        yield summary.unreviewed


def nothing_scored(summary: RunSummary) -> str:
    """Warn that no object was evaluated though some move; "" otherwise."""
    ledger = summary.objects
    moving = ledger.annotated - ledger.static
    if ledger.evaluated or not moving:
        return ""
    return (
        f"no object was scored: all {moving} moving object-frames are ignored, for the reasons below; if they surprise "
        "you, calibration, ego-motion or boxes may be wrong: see `fisheye-bench validate` and `fisheye-bench view`"
    )


def odd_masks(run: StoredRun) -> str:
    """Warn of a run whose masks are all empty, or all fill more than half of the valid pixels; "" otherwise."""
    shares = pd.concat(
        (rows["detected_px"] / rows["valid_px"])[
            rows["status"].isin([EVALUATED, NOT_ANNOTATED]) & (rows["valid_px"] > 0)
        ]
        for rows in read_parts(run.frames, ["status", "detected_px", "valid_px"])
    )
    if shares.empty or (shares.max() > 0 and shares.min() <= FILLED):
        return ""
    if shares.max() > 0:
        what = f"each of the {len(shares)} masks marks more than half of the valid pixels; an inverted mask does that"
    else:
        what = (
            f"none of the {len(shares)} masks marks anything; scores below the threshold, or of another scale, do that"
        )
    return f"{what}: see `fisheye-bench view`"


def cost_lines(made: Provenance) -> Iterator[str]:
    """Work of a run, and the time and memory that it took."""
    rate = f", {made.images_asked / made.seconds:.1f} images per second" if made.images_asked and made.seconds else ""
    yield (
        f"{made.seconds:.1f} s{rate}, peak memory of a process {made.peak_memory_mb:.0f} MB; "
        f"seconds by stage, over all processes: {stage_times(made.stage_seconds)}"
    )
    stored = made.images - made.images_asked
    found = f"; the answers of {counted(stored, 'image')} were there" if stored > 0 else ""
    yield f"{counted(made.workers, 'process')}; the method was asked for {counted(made.images_asked, 'image')}{found}"


def stage_times(seconds: Mapping[str, float]) -> str:
    """Seconds by stage, as "decode 1.4, method 30.9"."""
    return ", ".join(f"{name} {spent:.1f}" for name, spent in seconds.items())
