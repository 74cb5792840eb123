"""From the two tables of a run to its summary: a pure function, whatever the order of the rows."""

from __future__ import annotations

import math

import numpy as np

from bench.evaluation.intervals import MEAN, RATIO, ratio_interval
from bench.evaluation.protocol import Protocol
from bench.evaluation.row_source import Rows
from bench.evaluation.slices import ALL_MOVING, CATEGORY, FRAMES
from bench.evaluation.summary import (
    FalsePositiveFigures,
    Figure,
    ObjectFigures,
    ProtocolStamp,
    SegmentationFigures,
    Summary,
)
from bench.evaluation.sums import (
    CAUSE,
    FALSE_POSITIVE_RATIOS,
    MEANS,
    OBJECT_RATIOS,
    SEGMENTATION_RATIOS,
    Ratio,
    RunSums,
    SliceSums,
    frame_ledger,
    level_ratios,
    object_ledger,
    sum_run,
)


def ratio_figure(sums: SliceSums, place: int, ratio: Ratio) -> Figure:
    """The ratio of two sums over one slice.

    Args:
        sums: of a split.
        place: of the slice.
        ratio: names of the terms above and below; none below 0, and where it is 0, so is the one above.
    """
    numerators, denominators = (sums.terms[name][:, place] for name in ratio)
    cases = float(denominators.sum())
    return Figure(
        value=float(numerators.sum()) / cases if cases else math.nan,
        ci95=ratio_interval(numerators, denominators, within=MEAN if ratio[0] in MEANS else RATIO),
        cases=int(cases),
        recordings=int(np.count_nonzero(denominators)),
    )


def object_figures(sums: SliceSums, *, levels: tuple[float, ...]) -> dict[str, ObjectFigures]:
    """Take the figures of every slice of a split.

    Args:
        sums: over the evaluated object-frames.
        levels: detection levels of the protocol.
    """
    ratios = OBJECT_RATIOS | level_ratios(levels)
    return {
        name: ObjectFigures(
            object_frames=int(sums.rows[:, place].sum()),
            tracks=int(sums.tracks[:, place].sum()),
            recordings=int(np.count_nonzero(sums.rows[:, place])),
            **{figure: ratio_figure(sums, place, ratio) for figure, ratio in ratios.items()},
        )
        for place, name in enumerate(sums.names)
    }


def false_positive_figures(sums: SliceSums) -> dict[str, FalsePositiveFigures]:
    """Take the false-positive figures of every slice of a split.

    Args:
        sums: over the scored image-frames.
    """
    return {
        name: FalsePositiveFigures(
            frames=int(sums.rows[:, place].sum()),
            recordings=int(np.count_nonzero(sums.rows[:, place])),
            **{figure: ratio_figure(sums, place, ratio) for figure, ratio in FALSE_POSITIVE_RATIOS.items()},
        )
        for place, name in enumerate(sums.names)
    }


def segmentation_figures(sums: SliceSums) -> SegmentationFigures:
    """Take the figures of the moving class from summed counts of all images; what lies in I is in none of them."""
    return SegmentationFigures(**{name: ratio_figure(sums, 0, ratio) for name, ratio in SEGMENTATION_RATIOS.items()})


def false_positive_causes(sums: SliceSums) -> dict[str, Figure]:
    """Share of the false-positive pixels by the cause that the method names, by name; empty if it names none."""
    names = sorted(name.removeprefix(CAUSE) for name in sums.terms if name.startswith(CAUSE))
    return {name: ratio_figure(sums, 0, (CAUSE + name, "fp")) for name in names}


def summarise(objects: Rows, frames: Rows, *, protocol: Protocol, rows_at_once: int | None = None) -> Summary:
    """Reduce the tables of a run to its figures.

    Args:
        objects: of `OBJECTS_SCHEMA`, rows in any order, in memory or stored.
        frames: of `FRAMES_SCHEMA`, rows in any order, in memory or stored.
        protocol: that the run was made with.
        rows_at_once: most rows in memory, unless one recording has more; changes no byte of the summary.
    """
    return figures_of(sum_run(objects, frames, protocol=protocol, rows_at_once=rows_at_once), protocol=protocol)


def figures_of(sums: RunSums, *, protocol: Protocol) -> Summary:
    """All figures of a run from its sums."""
    levels = protocol.scoring.detection_levels
    of_objects = {split: object_figures(part, levels=levels) for split, part in sums.objects.items()}
    of_frames = {split: false_positive_figures(part) for split, part in sums.frames.items()}
    return Summary(
        protocol=ProtocolStamp(name=protocol.name, version=protocol.version, digest=protocol.digest),
        categories=of_objects.pop(CATEGORY),
        all_moving=of_objects.pop(ALL_MOVING)[ALL_MOVING],
        false_positives=of_frames.pop(FRAMES)[FRAMES],
        segmentation=segmentation_figures(sums.frames[FRAMES]),
        false_positive_causes=false_positive_causes(sums.frames[FRAMES]),
        breakdowns=of_objects,
        false_positive_breakdowns=of_frames,
        objects=object_ledger(sums.object_ledger),
        images=frame_ledger(sums.frame_ledger),
    )
