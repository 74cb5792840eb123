"""A whole run on rendered drives: what is stored, what fails, and what goes on."""

import json
from pathlib import Path

import pytest

from bench.errors import DataError
from bench.harness.manifest import Manifest, read_manifest
from bench.harness.stored import read_run
from tests.support.counts import read_tables
from tests.support.runs import PAPER, score


def test_run_stores_rows_of_every_image_and_object(tiny_card, tmp_path):
    summary = score(tiny_card, tmp_path / "run")
    objects, frames = read_tables(tmp_path / "run")
    assert frames.num_rows == 3 * 4  # the first image of each recording has nothing before it
    assert objects.num_rows == (2 + 1 + 1) * 4
    assert summary.objects.annotated == 16
    assert summary.objects.static == 4  # the parked car
    assert summary.images.evaluated == 12
    assert summary.categories["crossing"].object_frames == 4
    assert summary.categories["static_ego"].object_frames == 4
    assert summary.categories["overtaking"].object_frames == 4
    assert summary.categories["approaching"].object_frames == 0
    assert summary.categories["static_ego"].tpr.value > 0.5
    assert summary.all_moving.detection_rate.value > 0.9
    assert summary.failures == ()
    assert read_run(tmp_path / "run").summary == summary
    results = tmp_path / "run" / "paper-v1"
    stored = json.loads((results / "summary.json").read_text())
    assert stored["categories"]["approaching"]["tpr"]["value"] is None
    assert {"schema_version", "false_positives", "provenance"} <= set(stored)
    told = json.loads((results / "manifest.json").read_text())
    assert not set(told) & set(stored), "what the run is is told once"
    manifest = read_run(tmp_path / "run").manifest
    assert Manifest.model_validate(told) == read_manifest(results) == manifest
    assert manifest.protocol.digest == PAPER.digest


def test_the_reference_digest_is_of_the_reference_alone(tiny_card, own_card, tmp_path):
    for name in ("frame-difference", "reference"):
        score(tiny_card, tmp_path / name, method=name)
    ours, itself = (read_run(tmp_path / name).manifest for name in ("frame-difference", "reference"))
    assert ours.reference == itself.reference
    labels = own_card.parent / "data" / "tiny" / "crossing" / "annotations.json"
    labels.write_text(labels.read_text().replace('"pedestrian"', '"cyclist"'))
    score(own_card, tmp_path / "other", method="nothing")
    other = read_run(tmp_path / "other")
    assert other.manifest.reference != ours.reference
    before, after = ours.dataset.recordings, other.manifest.dataset.recordings
    assert [name for name in before if after[name] != before[name]] == ["crossing"]
    assert other.protocol.digest == PAPER.digest == ours.protocol.digest


def images_of(card: Path, recording: str) -> list[Path]:
    return sorted((card.parent / "data" / "tiny" / recording / "images" / "front").iterdir())


def test_a_truncated_image_costs_its_two_pairs_and_is_named(own_card, tmp_path):
    victim = images_of(own_card, "crossing")[2]
    victim.write_bytes(victim.read_bytes()[:-200])
    summary = score(own_card, tmp_path / "run", method="frame-difference")
    assert (summary.images.failed, summary.images.evaluated) == (2, 10)
    assert all(victim.name in failure for failure in summary.failures)
    _, frames = read_tables(tmp_path / "run")
    assert sum(victim.name in (p or "") for p in frames["problem"].to_pylist()) == 2


def test_a_missing_image_is_a_gap_that_is_skipped_not_bridged(own_card, tmp_path):
    images_of(own_card, "crossing")[2].unlink()
    summary = score(own_card, tmp_path / "run", method="frame-difference")
    assert (summary.images.images, summary.images.skipped, summary.images.failed) == (11, 1, 0)
    assert summary.failures == ()
    (problem,) = summary.images.problems
    assert "133.3 ms after the image before it, where 66.7 ms are due" in problem


def test_a_recording_without_calibration_does_not_stop_the_rest(own_card, tmp_path):
    (own_card.parent / "data" / "tiny" / "crossing" / "recording.json").unlink()
    summary = score(own_card, tmp_path / "run", method="frame-difference")
    assert summary.images.evaluated == 8
    (failure,) = summary.failures
    assert "recording 'crossing'" in failure
    assert "recording.json" in failure


def test_a_damaged_sweep_costs_the_images_that_need_it(own_card, tmp_path):
    sweeps = sorted((own_card.parent / "data" / "tiny" / "crossing" / "lidar").iterdir())
    for sweep in sweeps:
        sweep.write_bytes(sweep.read_bytes()[:1000])
    summary = score(own_card, tmp_path / "run", method="frame-difference")
    assert (summary.images.failed, summary.images.evaluated) == (4, 8)
    assert "lidar" in summary.failures[0]


def test_when_nothing_can_be_used_the_run_says_why(own_card, tmp_path):
    for recording in ("crossing", "standing", "overtaking"):
        (own_card.parent / "data" / "tiny" / recording / "recording.json").write_text("{}")
    with pytest.raises(DataError, match=r"a recording that can be used.*recording\.json"):
        score(own_card, tmp_path / "run")


def test_progress_rises_to_the_number_of_images(tiny_card, tmp_path):
    seen = []
    score(tiny_card, tmp_path / "run", method="nothing", progress=lambda *numbers: seen.append(numbers))
    assert seen == [(0, 0), (4, 12), (8, 12), (12, 12)], "before the recordings are open, and after each task"


def test_what_is_no_summary_is_refused_by_name(tmp_path):
    with pytest.raises(DataError, match=r"expected the folder of a finished run, got no summary\.json"):
        read_run(tmp_path)
    with pytest.raises(DataError, match="expected the folder of a finished run, got no such folder"):
        read_run(tmp_path / "nope")
    (tmp_path / "run.zip").write_bytes(b"PK")
    with pytest.raises(DataError, match="got a file; unpack an archive first"):
        read_run(tmp_path / "run.zip")
    (tmp_path / "summary.json").write_text('{"schema_version": 1}')
    with pytest.raises(DataError, match=r"summary\.json: categories: expected"):
        read_run(tmp_path)
    with pytest.raises(DataError, match="expected counts of a run"):
        read_tables(tmp_path)
