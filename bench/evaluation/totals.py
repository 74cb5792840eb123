"""From the two tables of a run to its summary: a pure function, whatever the order of the rows."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from bench.evaluation.bootstrap import sequence_weights
from bench.evaluation.frame_figures import false_positive_causes, false_positive_figures, segmentation_figures
from bench.evaluation.ledger import frame_ledger, object_ledger
from bench.evaluation.object_figures import object_figures
from bench.evaluation.protocol import Protocol
from bench.evaluation.ratios import Cases
from bench.evaluation.slices import IMAGE, Split, frame_splits, object_splits, read_rows
from bench.evaluation.summary import FalsePositiveFigures, ObjectFigures, ProtocolStamp, Summary


def summarise(objects: pa.Table, frames: pa.Table, *, protocol: Protocol) -> Summary:
    """Reduce the tables of a run to its figures.

    Args:
        objects: of `OBJECTS_SCHEMA`, rows in any order.
        frames: of `FRAMES_SCHEMA`, rows in any order.
        protocol: that the run was made with.
    """
    all_objects, all_frames = read_rows(objects, key=[*IMAGE, "track_id"]), read_rows(frames, key=IMAGE)
    object_cases, frame_cases = _cases(all_objects, all_frames, protocol)
    cameras = sorted(set(all_frames["camera"]))
    levels = protocol.scoring.detection_levels
    return Summary(
        protocol=ProtocolStamp(name=protocol.name, version=protocol.version, digest=protocol.digest),
        categories=_categories(object_cases, protocol),
        all_moving=object_figures(object_cases, levels=levels, where=_every_row(object_cases)),
        false_positives=false_positive_figures(frame_cases, where=_every_row(frame_cases)),
        segmentation=segmentation_figures(frame_cases),
        false_positive_causes=false_positive_causes(frame_cases),
        breakdowns=_breakdowns(object_cases, protocol, cameras),
        false_positive_breakdowns=_false_positive_breakdowns(frame_cases, protocol, cameras),
        objects=object_ledger(all_objects),
        images=frame_ledger(all_frames),
    )


def _cases(objects: pd.DataFrame, frames: pd.DataFrame, protocol: Protocol) -> tuple[Cases, Cases]:
    """The evaluated object-frames and the scored image-frames, over the same resampled recordings."""
    evaluated = objects[objects["status"] == "evaluated"].reset_index(drop=True)
    scored = frames[frames["status"] == "evaluated"].reset_index(drop=True)
    recordings = np.unique(scored["recording"].to_numpy(dtype=str))
    assert np.isin(evaluated["recording"].to_numpy(dtype=str), recordings).all(), "objects lie in scored images"
    weights = sequence_weights(len(recordings), draws=protocol.bootstrap.draws, seed=protocol.bootstrap.seed)
    numbers = [np.searchsorted(recordings, rows["recording"].to_numpy(dtype=str)) for rows in (evaluated, scored)]
    return (
        Cases(rows=evaluated, recording=numbers[0], weights=weights),
        Cases(rows=scored, recording=numbers[1], weights=weights),
    )


def _categories(cases: Cases, protocol: Protocol) -> dict[str, ObjectFigures]:
    return _split(cases, (cases.rows["category"].to_numpy(), protocol.reference.categories), protocol)


def _breakdowns(cases: Cases, protocol: Protocol, cameras: list[str]) -> dict[str, dict[str, ObjectFigures]]:
    splits = object_splits(cases.rows, protocol=protocol, cameras=cameras)
    return {name: _split(cases, split, protocol) for name, split in splits.items()}


def _split(cases: Cases, split: Split, protocol: Protocol) -> dict[str, ObjectFigures]:
    (of_row, names), levels = split, protocol.scoring.detection_levels
    rows = {str(name): object_figures(cases, levels=levels, where=of_row == str(name)) for name in names}
    unknown = int(np.count_nonzero(of_row == ""))  # of unknown range, where masks are the reference
    assert sum(row.object_frames for row in rows.values()) + unknown == len(cases.rows), "each is in one slice at most"
    return rows


def _false_positive_breakdowns(
    cases: Cases, protocol: Protocol, cameras: list[str]
) -> dict[str, dict[str, FalsePositiveFigures]]:
    splits = frame_splits(cases.rows, protocol=protocol, cameras=cameras)
    return {
        split: {name: false_positive_figures(cases, where=of_row == name) for name in names}
        for split, (of_row, names) in splits.items()
    }


def _every_row(cases: Cases) -> NDArray[np.bool_]:
    return np.ones(len(cases.rows), dtype=bool)
