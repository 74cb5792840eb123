"""Fewer beams: rings that can be counted by hand, then a whole study of thinned sweeps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.errors import DataError
from bench.evaluation.protocol import load_protocol
from bench.execution import SerialExecutor
from bench.harness.exact import build_scorable
from bench.lidar.sweep import LidarSweep
from bench.recordings import Recording, load_card, open_dataset
from bench.records.recording import PointIndices, SweepRef
from benchmarks.ranking.beams import count_beams, run_beams, with_beams
from benchmarks.ranking.beams_report import beams_table, write_beams_files
from benchmarks.ranking.predictions import parse_predictions
from tests.reporting.printed import texts
from tests.support.runs import run_one

RINGS, COLUMNS = 16, 12


@pytest.fixture(scope="module")
def drive(tiny_card: Path) -> Recording:
    return open_dataset(load_card(tiny_card))[0].open()


def wall(_path: Path, timestamp_ns: int) -> LidarSweep:
    """A wall 6 m away by 16 rings of 12 returns."""
    ring, column = (values.ravel() for values in np.mgrid[:RINGS, :COLUMNS])
    return LidarSweep(
        timestamp_ns=timestamp_ns,
        points_lidar=np.column_stack([np.full(len(ring), 6.0), 0.02 * column, 0.03 * ring]),
        time_offset_ns=1000 * column,
        intensity=(ring / RINGS).astype(np.float32),
        ring=ring.astype(np.uint8),
    )


def before(drive: Recording, reader=wall) -> Recording:
    """The drive before a wall."""
    return replace(drive, sweeps=(SweepRef(timestamp_ns=0, path=Path("wall"), reader=reader),))


@pytest.mark.parametrize(
    ("beams", "rings"),
    [(16, [*range(16)]), (8, [*range(0, 16, 2)]), (4, [0, 4, 8, 12]), (6, [0, 2, 5, 8, 10, 13]), (1, [0])],
)
def test_rings_are_left_out_evenly_and_whole(drive, beams, rings):
    whole, recording = wall(Path(), 7), before(drive)
    assert count_beams(recording) == RINGS
    thinned = with_beams(recording, beams, of=RINGS)
    sweep = thinned.sweeps[0].read()
    kept = np.isin(whole.ring, rings)
    for name in ("points_lidar", "time_offset_ns", "intensity", "ring"):
        assert np.array_equal(getattr(sweep, name), getattr(whole, name)[kept]), name
    assert thinned.tracks is recording.tracks
    assert recording.sweeps[0].read().ring.max() == RINGS - 1  # the recording itself keeps all


def test_what_cannot_be_thinned_is_refused(drive):
    def without_rings(path: Path, timestamp_ns: int) -> LidarSweep:
        return replace(wall(path, timestamp_ns), ring=None)

    with pytest.raises(DataError, match=r"name the ring of each point.*rings in 0 of 1 sweeps"):
        count_beams(before(drive, without_rings))
    by_row = PointIndices(indices=np.arange(3), sweep_timestamp_ns=0)
    (track, *_) = drive.tracks
    state = replace(track.states[0], shape=by_row)
    with pytest.raises(DataError, match="annotated by rows of a sweep"):
        count_beams(replace(drive, tracks=(replace(track, states=(state,)),)))
    with pytest.raises(DataError, match="expected at most 16 beams, as many as its lidar has, got --beams 17"):
        with_beams(before(drive), 17, of=RINGS)


@pytest.fixture(scope="module")
def found(tiny_card: Path, tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    predictions = parse_predictions("truth,truth:grow_px=30")
    named = {"split": None, "recordings": None, "executor": SerialExecutor(), "progress": None}
    beams = run_beams(load_card(tiny_card), beams=(32, 8, 1), predictions=predictions, **named)
    assert beams.stored.failures == ()
    table, *pictures = write_beams_files(tmp_path_factory.mktemp("beams"), beams)
    assert all(f"| {' | '.join(row)} |" in table.read_text() for row in texts(beams_table(beams)))
    assert all(picture.stat().st_size > 100 for picture in pictures)
    return beams.rows[beams.rows["object_class"] == "all"].set_index("beams")


def test_the_whole_sensor_comes_first_and_scores_exact_masks_as_a_run_does(found, tiny_card, tmp_path):
    assert [*found.index] == [64, 32, 8, 1]
    whole, protocol = found.loc[64], load_protocol("surface-v1")
    run = run_one(card=load_card(tiny_card), method=build_scorable("truth"), protocol=protocol, out=tmp_path / "run")
    assert (whole["object_frames"], whole["recordings"], whole["lost"]) == (run.all_moving.object_frames, 3, 0)
    assert whole["ceiling"] == pytest.approx(run.all_moving.iou.value)
    assert whole["unknown_share"] == pytest.approx(run.all_moving.metric("unknown_share").value)


def test_fewer_beams_tell_less(found):
    assert found["in_core"][[64, 32, 8]].is_monotonic_decreasing
    assert found["unknown_share"][[64, 32, 8]].is_monotonic_increasing
    assert {*(found["object_frames"] + found["lost"])} == {found.loc[64, "object_frames"]}
    assert found.loc[64, "ceiling"] > found.loc[8, "ceiling"] > 0.5
    assert [tau.value for tau in found["tau"][[64, 32]]] == pytest.approx([1, 1])
    assert found.loc[1, "lost"] > found.loc[8, "lost"]  # one ring gives hardly an object ten returns
