"""From the two tables of a run to its summary: a pure function, whatever the order of the rows."""

from __future__ import annotations

from bench.evaluation.frame_figures import false_positive_causes, false_positive_figures, segmentation_figures
from bench.evaluation.ledger import frame_ledger, object_ledger
from bench.evaluation.object_figures import object_figures
from bench.evaluation.protocol import Protocol
from bench.evaluation.row_source import Rows
from bench.evaluation.run_sums import RunSums, sum_run
from bench.evaluation.slices import ALL_MOVING, CATEGORY, FRAMES
from bench.evaluation.summary import ProtocolStamp, Summary


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
