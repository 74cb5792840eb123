"""Run a sweep: one run for each value, all with one cache, and the metrics of all of them on the same images."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import reduce
from operator import or_
from pathlib import Path

from bench.evaluation import Summary, summarise
from bench.evaluation.rows import CommonImages, RowsOnImages
from bench.execution import TaskExecutor
from bench.harness import provenance as origin
from bench.harness.cache import CacheFolder
from bench.harness.keys import MethodIdentity
from bench.harness.merge import combined_provenance
from bench.harness.method_stamp import MethodStamp
from bench.harness.run import SERIAL, RunRequest, run_benchmark
from bench.harness.stages import Progress, part_of
from bench.harness.stored import RunSummary, open_tables
from bench.harness.sweep.plan import SweepPlan
from bench.harness.sweep.results import MARK, SCHEMA_VERSION, FlowCalls, SweepResult, SweepRow, write_sweep
from bench.recordings import DatasetCard, write_text

OWN_CACHE = ".cache"


def run_sweep(
    card: DatasetCard,
    *,
    plan: SweepPlan,
    out: Path,
    cache: CacheFolder | None,
    split: str | None = None,
    executor: TaskExecutor = SERIAL,
    progress: Progress | None = None,
) -> SweepResult:
    """Score every value of a sweep on a data set and store the metrics.

    Each value is a run in a folder of `out`; what an interrupted sweep has stored is not computed again. The metrics
    are those on the images that all values scored. Errors of the input reach the method only; the reference keeps the
    true calibration and ego-motion.

    Args:
        card: the data set.
        plan: what to run.
        out: folder of the sweep; an older `sweep.json` in it is replaced.
        cache: of the steps that values share; None for one that is removed at the end.
        split: of the data set; None for all of it.
        executor: computes the units; the result does not depend on it.
        progress: called with the values done (with a fraction for the one at work) and their number.

    Returns:
        The metrics, also stored as `sweep.json`.

    Raises:
        DataError: the data set is not there, nothing of it could be used, `cache` is a folder of other files, or the
            folder of a value is in use or holds something that is no run.
    """
    start = origin.Start.now()
    write_text(out / MARK, "")
    summaries = []
    with _shared(cache, out) as steps, executor:
        for number, (value, setup) in enumerate(zip(plan.values, plan.setups, strict=True)):
            request = RunRequest(
                card=card,
                method=setup.method,
                protocol=setup.protocol,
                input_errors=setup.input_errors,
                out=plan.folder(value, out),
                split=split,
                overwrite=True,  # as `sweep.json` is: another method or protocol than in an earlier sweep
                executor=executor,
                cache=steps,
                progress=part_of(progress, number=number, total=len(plan.values)),
            )
            summaries.append(run_benchmark(request))
    result = _result(card, plan, summaries, out=out, split=split, start=start, workers=executor.workers)
    write_sweep(out, result)
    return result


@contextmanager
def _shared(cache: CacheFolder | None, out: Path) -> Iterator[CacheFolder]:
    """The cache of all values: the given one, or one in the folder of the sweep for as long as this one runs."""
    if cache is not None:
        yield cache
        return
    try:
        yield CacheFolder(folder=out / OWN_CACHE)
    finally:
        shutil.rmtree(out / OWN_CACHE, ignore_errors=True)


def _result(
    card: DatasetCard,
    plan: SweepPlan,
    summaries: Sequence[RunSummary],
    *,
    out: Path,
    split: str | None,
    start: origin.Start,
    workers: int,
) -> SweepResult:
    rows = _rows(plan, summaries, out)
    own = summaries[plan.values.index(plan.operating)].provenance
    made = combined_provenance(
        [own, *(summary.provenance for summary in summaries if summary.provenance is not own)],
        images=rows[0].false_positives.frames,
    )
    assert made.work is not None, "every run tells its work"
    method = plan.base.method
    return SweepResult(
        schema_version=SCHEMA_VERSION,
        what=plan.what,
        title=plan.sweep.title,
        about=plan.sweep.about,
        part=plan.sweep.part,
        scale=plan.sweep.scale,
        dataset=card.name,
        card=str(card.file),
        split=split,
        method=MethodStamp.of(method, MethodIdentity.of(method)),
        protocol=plan.base.protocol.name,
        rows=rows,
        flow=FlowCalls(computed=made.work.steps_computed.get("flow", 0), read=made.work.steps_found.get("flow", 0)),
        provenance=made.model_copy(
            update={"seconds": start.elapsed_s, "work": made.work.model_copy(update={"workers": workers})}
        ),
        failures=tuple(reduce(or_, (Counter(summary.failures) for summary in summaries)).elements()),
    )


def _rows(plan: SweepPlan, summaries: Sequence[RunSummary], out: Path) -> tuple[SweepRow, ...]:
    """The metrics of every value, on the images that all of them scored."""
    return tuple(
        SweepRow(
            value=value,
            operating=value == plan.operating,
            settings=setup.method.settings(),
            protocol_digest=setup.protocol.digest,
            injected=setup.input_errors.named,
            categories=metrics.categories,
            all_moving=metrics.all_moving,
            false_positives=metrics.false_positives,
        )
        for value, setup, metrics in zip(plan.values, plan.setups, _on_common_images(plan, summaries, out), strict=True)
    )


def _on_common_images(plan: SweepPlan, summaries: Sequence[RunSummary], out: Path) -> Sequence[Summary]:
    """The metrics of each run; counted again where another one could not score all of its images."""
    tables = [open_tables(plan.folder(value, out)) for value in plan.values]
    common = CommonImages([frames for _, frames in tables])
    if {common.count()} == {summary.images.evaluated for summary in summaries}:
        return summaries
    return [
        summarise(RowsOnImages(objects, common), RowsOnImages(frames, common), protocol=setup.protocol)
        for (objects, frames), setup in zip(tables, plan.setups, strict=True)
    ]
