"""What holds for every kind of region."""

from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from bench.errors import UnknownNameError
from bench.recordings import PointIndices
from bench.records.reference import Limb, RegionKindName
from bench.reference import REGION_KINDS, OutlineErrors, Status
from tests.reference.drives import pixels_of, reference_of, wall_recording, with_settings

ROOT = Path(__file__).parents[2]
every_kind = pytest.mark.parametrize("kind", sorted(REGION_KINDS))


def frame_of(recording, kind, **changes):
    return reference_of(recording, with_settings(polygon_kind=kind, **changes))


@every_kind
def test_a_scanned_wall_is_evaluated_within_its_polygon(kind):
    recording, truth = wall_recording(away_m=6.0, width_m=2.0)
    frame = frame_of(recording, kind)
    (wall,) = frame.objects
    assert wall.status is Status.EVALUATED
    assert wall.region_px == wall.polygon_px == (frame.labels == 1).sum()
    np.testing.assert_array_equal(frame.labels == 1, pixels_of(wall.polygon) & frame.valid)
    assert wall.polygon.intersection(truth).area > 0.8 * wall.polygon.union(truth).area
    assert not frame.ignored.any()


@every_kind
def test_a_band_takes_from_the_region_and_adds_beside_it(kind):
    recording, truth = wall_recording(away_m=6.0, width_m=2.0)
    errors = OutlineErrors(range_noise_m=0.02, angle_rad=0.002, position_m=0.007, limbs={"vehicle": (LIMB,)})
    (plain,), frame = frame_of(recording, kind).objects, frame_of(recording, kind, outline=errors)
    (wall,) = frame.objects
    assert wall.region_px < pixels_of(truth).sum()
    assert wall.region_px + wall.unknown_px > plain.region_px
    assert wall.unknown_px == frame.ignored.sum() > 0


LIMB = Limb(joint=0.5, end=0.0, speed=1.0)


@every_kind
@pytest.mark.parametrize("chosen", [range(0), range(2), range(5)], ids=["no returns", "two returns", "one row"])
def test_returns_that_span_no_area_have_no_region_or_a_small_one(kind, chosen):
    recording, _ = wall_recording(away_m=6.0, width_m=2.0)
    (track,) = recording.tracks
    named = PointIndices(sweep_timestamp_ns=0, indices=np.array(chosen, dtype=np.intp))
    track = replace(track, states=(replace(track.states[0], shape=named),))
    (found,) = frame_of(replace(recording, tracks=(track,)), kind, min_points=1).objects
    assert found.status is Status.IGNORED
    assert found.polygon_px < 20


@every_kind
def test_a_kind_is_told_in_the_documentation(kind):
    assert f"`{kind}`" in (ROOT / "docs" / "metrics.md").read_text("utf-8")


def test_a_kind_that_does_not_exist_is_refused():
    with pytest.raises(UnknownNameError, match="convex"):
        frame_of(wall_recording()[0], "bounding")


def test_protocols_may_name_every_kind_and_no_other():
    assert set(get_args(RegionKindName)) == REGION_KINDS.keys()
