"""Totals of a run in lines: what became of objects and images, and what the run cost."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from bench.evaluation import Protocol
from bench.evaluation.summary import not_annotated
from bench.harness import Provenance, RunSummary
from bench.harness.provenance import NOT_STORED
from bench.reference import IgnoreReason
from bench.reporting.tables import threshold_free_line


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
    yield f"{images.images} images: {images.evaluated} scored, {images.skipped} skipped, {images.failed} failed"
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


def cost_lines(made: Provenance) -> Iterator[str]:
    """Work of a run, and the time and memory that it took."""
    work = made.work
    images = made.images if work is None else work.images_computed
    rate = f", {images / made.seconds:.1f} images per second" if images and made.seconds else ""
    yield (
        f"{made.seconds:.1f} s{rate}, peak memory of a process {made.peak_memory_mb:.0f} MB; "
        f"seconds by stage, over all processes: {stage_times(made.stage_seconds)}"
    )
    if work is not None:
        steps = sorted({*work.steps_found, *work.steps_computed})
        cached = "; ".join(
            f"{step} found {work.steps_found.get(step, 0)}, computed {work.steps_computed.get(step, 0)}"
            for step in steps
        )
        changed = ", ".join(f"{name} ({count})" for name, count in work.changed.items() if name != NOT_STORED)
        missing = work.changed.get(NOT_STORED, 0) if changed or work.units_reused else 0
        yield (
            f"{work.workers} processes; units computed {work.units_computed}, found done {work.units_reused}"
            + (f"; computed again since these changed: {changed}" if changed else "")
            + (f"; without a stored result: {missing}" if missing else "")
            + (f"; cache: {cached}" if cached else "")
        )


def stage_times(seconds: Mapping[str, float]) -> str:
    """Seconds by stage, as "decode 1.4, method 30.9"."""
    return ", ".join(f"{name} {spent:.1f}" for name, spent in seconds.items())
