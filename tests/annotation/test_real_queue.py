"""A real queue by day, seen by an HDL-64E: a tanker of 14 m slows down beside the vehicle, which stops behind a car."""

import lzma
import shutil

import numpy as np
import pytest

from bench.annotation.evaluate import evaluate_proposals, proposal_scores
from bench.annotation.proposals import propose
from bench.annotation.settings import ProposalSettings
from bench.recordings import open_native
from tests.annotation.street import annotated
from tests.support.real import REAL, needs_real

START_NS, SWEEP_NS = 1_000_000_000, 100_000_000


def queue(folder):
    """The recording with one image, since nobody looks at them."""
    shutil.copytree(REAL / "kitti-sfnd/native/sfnd", folder)
    for part in ("images/front", "lidar"):
        (folder / part).mkdir(parents=True)
    first = next((REAL / "kitti-sfnd").glob("*/image_02/data/0000000000.png"))
    shutil.copy(first, folder / "images/front" / f"{START_NS}.png")
    for file in (REAL / "kitti-sfnd").glob("*/velodyne_points/data/*.bin.xz"):
        values = np.frombuffer(lzma.decompress(file.read_bytes()), np.float32).reshape(-1, 4)
        turns = np.arctan2(values[:, 1].astype(np.float64), values[:, 0]) / (2 * np.pi)  # ahead at the sweep's time
        np.savez(
            folder / "lidar" / f"{START_NS + int(file.name.split('.')[0]) * SWEEP_NS}.npz",
            points_lidar=values[:, :3],
            time_offset_ns=np.round(turns * SWEEP_NS).astype(np.int64),
        )
    return open_native(folder)


@needs_real
@pytest.mark.slow
def test_a_tanker_and_a_car_in_a_real_queue_and_nothing_of_the_vehicle_itself(tmp_path):
    recording = queue(tmp_path / "sfnd")
    proposals = propose(recording)
    frames = evaluate_proposals(recording, annotated(proposals, recording))
    scores = proposal_scores(frames, minutes=len(recording.sweeps) / 600).set_index(["range", "group"])
    near = scores.loc[("< 8 m", "all")]
    assert near["object_frames"] == 88
    assert near["recall"] > 0.95
    assert near["precision"] > 0.95
    assert near["speed_error_median"] < 0.1
    for proposal in proposals:
        lidar_m = [recording.trajectory.world_from_vehicle(s.timestamp_ns).translation_m for s in proposal.states]
        away_m = np.hypot(*(np.array([s.centre_m for s in proposal.states]) - np.array(lidar_m)).T[:2])
        assert np.ptp(away_m) > ProposalSettings().own_sway_m or away_m.min() > ProposalSettings().own_range_m
