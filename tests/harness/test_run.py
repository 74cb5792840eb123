"""A whole run on rendered drives: what is stored, what fails, and what goes on."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from bench.errors import DataError
from bench.evaluation import load_protocol
from bench.harness import (
    RunRequest,
    plan_units,
    read_run,
    read_tables,
    run_benchmark,
    tasks,
)
from bench.harness import run as run_module
from bench.harness.manifest import Manifest, read_manifest
from bench.methods import build_method
from bench.methods.spherical.method import SphericalMethod
from bench.recordings import load_card, open_dataset
from tests.support.manifests import method_of_run
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
    assert summary.failures == ()
    assert read_run(tmp_path / "run").summary == summary
    stored = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert stored["categories"]["approaching"]["tpr"]["value"] is None
    assert {"schema_version", "false_positives", "provenance", "files"} <= set(stored)
    told = json.loads((tmp_path / "run" / "manifest.json").read_text())
    assert set(told) & set(stored) == {"sha256"}, "what the run is is told once"
    del told["sha256"]
    manifest = read_run(tmp_path / "run").manifest
    assert Manifest.model_validate(told) == read_manifest(tmp_path / "run") == manifest
    assert manifest.protocol.digest == PAPER.digest


def test_moving_objects_are_found(tiny_card, tmp_path):
    summary = score(tiny_card, tmp_path / "run")
    assert summary.categories["static_ego"].tpr.value > 0.5
    assert summary.all_moving.detection_rate.value > 0.9


def test_the_reference_digest_is_of_the_reference_alone(tiny_card, own_card, tmp_path):
    for name in ("spherical", "nothing"):
        score(tiny_card, tmp_path / name, method=name)
    ours, nothing = (read_run(tmp_path / name).manifest for name in ("spherical", "nothing"))
    assert ours.reference == nothing.reference
    labels = own_card.parent / "data" / "tiny" / "crossing" / "annotations.json"
    labels.write_text(labels.read_text().replace('"pedestrian"', '"cyclist"'))
    score(own_card, tmp_path / "other", method="nothing")
    other = read_run(tmp_path / "other")
    assert other.manifest.reference != ours.reference
    before, after = ours.dataset.recordings, other.manifest.dataset.recordings
    assert [name for name in before if after[name] != before[name]] == ["crossing"]
    assert other.protocol.digest == PAPER.digest == ours.protocol.digest


def test_everything_and_nothing_bound_the_table(tiny_card, tmp_path):
    nothing, everything = (score(tiny_card, tmp_path / name, method=name) for name in ("nothing", "everything"))
    assert nothing.all_moving.detection_rate.value == 0
    assert nothing.false_positives.coverage.value == 0
    assert everything.all_moving.detection_rate.value == 1
    assert everything.all_moving.tpr.value == 1


def images_of(card: Path, recording: str) -> list[Path]:
    return sorted((card.parent / "data" / "tiny" / recording / "images" / "front").iterdir())


def test_a_truncated_image_costs_its_two_pairs_and_is_named(own_card, tmp_path):
    victim = images_of(own_card, "crossing")[2]
    victim.write_bytes(victim.read_bytes()[:-200])
    summary = score(own_card, tmp_path / "run")
    assert (summary.images.failed, summary.images.evaluated) == (2, 10)
    assert all(victim.name in failure for failure in summary.failures)
    _, frames = read_tables(tmp_path / "run")
    assert sum(victim.name in (p or "") for p in frames["problem"].to_pylist()) == 2


def test_a_missing_image_is_a_gap_that_is_skipped_not_bridged(own_card, tmp_path):
    images_of(own_card, "crossing")[2].unlink()
    summary = score(own_card, tmp_path / "run")
    assert (summary.images.images, summary.images.skipped, summary.images.failed) == (11, 1, 0)
    assert summary.failures == ()
    (problem,) = summary.images.problems
    assert "133.3 ms after the image before it, where 66.7 ms are due" in problem


def test_a_recording_without_calibration_does_not_stop_the_rest(own_card, tmp_path):
    (own_card.parent / "data" / "tiny" / "crossing" / "recording.json").unlink()
    summary = score(own_card, tmp_path / "run")
    assert summary.images.evaluated == 8
    (failure,) = summary.failures
    assert "recording 'crossing'" in failure
    assert "recording.json" in failure


def test_a_damaged_sweep_costs_the_images_that_need_it(own_card, tmp_path):
    sweeps = sorted((own_card.parent / "data" / "tiny" / "crossing" / "lidar").iterdir())
    for sweep in sweeps:
        sweep.write_bytes(sweep.read_bytes()[:1000])
    summary = score(own_card, tmp_path / "run")
    assert (summary.images.failed, summary.images.evaluated) == (4, 8)
    assert "lidar" in summary.failures[0]


def test_when_nothing_can_be_used_the_run_says_why(own_card, tmp_path):
    for recording in ("crossing", "standing", "overtaking"):
        (own_card.parent / "data" / "tiny" / recording / "recording.json").write_text("{}")
    with pytest.raises(DataError, match=r"a recording that can be used.*recording\.json"):
        score(own_card, tmp_path / "run")


def test_progress_rises_to_the_number_of_images(tiny_card, tmp_path):
    seen = []
    score(tiny_card, tmp_path / "run", method="nothing", progress=lambda done, total: seen.append((done, total)))
    done = [d for d, _ in seen]
    assert done == sorted(done)
    assert seen[0] == (0, 0), "before the first recording is open"
    assert seen[-1] == (12, 12)
    assert sorted(set(done)) == [0, 4, 8, 12], "after each unit"


def test_recordings_are_opened_one_after_the_other(tiny_card, tmp_path, monkeypatch):
    """Images of the first are scored before the second is opened, and each is opened once."""
    events = []
    opening, scoring = tasks._open, run_module.score_unit

    def opened(spec, handle):
        if not any(name == handle.name for _, name in tasks._held):
            events.append(f"open {handle.name}")
        return opening(spec, handle)

    def scored(spec, task):
        events.append(f"score {task.unit.recording}")
        return scoring(spec, task)

    monkeypatch.setattr(tasks, "_held", {})
    monkeypatch.setattr(tasks, "_open", opened)
    monkeypatch.setattr(run_module, "score_unit", scored)
    score(tiny_card, tmp_path / "run", method="nothing")
    names = [handle.name for handle in open_dataset(load_card(str(tiny_card)))]
    assert events == [f"{what} {name}" for name in names for what in ("open", "score")]


def test_units_cover_every_image_once(tiny_card):
    recording = open_dataset(load_card(str(tiny_card)))[0].open()
    units = list(plan_units(recording, build_method("spherical"), chunk_images=3))
    assert [(u.start, u.stop) for u in units] == [(1, 4), (4, 5)]


def test_what_is_no_summary_is_refused_by_name(tmp_path):
    with pytest.raises(DataError, match=r"summary\.json: expected the summary of a run"):
        read_run(tmp_path)
    (tmp_path / "summary.json").write_text('{"schema_version": 1}')
    with pytest.raises(DataError, match=r"summary\.json: expected the summary of a run"):
        read_run(tmp_path)
    with pytest.raises(DataError, match=r"objects\.parquet"):
        read_tables(tmp_path)


def test_what_a_stored_method_is_called(tiny_card, tmp_path):
    score(tiny_card, tmp_path / "ours")
    assert read_run(tmp_path / "ours").manifest.method.called == "spherical"
    stranger = method_of_run("stranger", place="bench.methods.baselines:Nothing")
    assert stranger.called == "bench.methods.baselines:Nothing"


def test_several_protocols_in_one_pass_give_the_runs_that_each_gives_alone(tiny_card, tmp_path, monkeypatch):
    names = ("paper-v1", "surface-v1", "extended-v1")
    for name in names:
        score(tiny_card, tmp_path / "alone" / name, protocol=load_protocol(name))
    asked = []
    segment = SphericalMethod.segment
    monkeypatch.setattr(SphericalMethod, "segment", lambda self, given: asked.append(given) or segment(self, given))
    runs = {tmp_path / "together" / name: load_protocol(name) for name in names}
    together = RunRequest(card=load_card(str(tiny_card)), method=build_method("spherical"), runs=runs)
    found = [*run_benchmark(together).values()]
    assert [run.protocol.name for run in found] == list(names)
    assert [run.folder for run in found] == [*runs]
    summaries = [run.summary for run in found]
    assert len(asked) == summaries[0].images.evaluated, "the method is asked once for all of them"
    assert all(summary.provenance.stage_seconds["method"] > 0 for summary in summaries), "the stages are of the pass"
    for name in names:
        for file in ("objects.parquet", "frames.parquet", "masks.parquet", "image_maps.npz"):
            alone = (tmp_path / "alone" / name / file).read_bytes()
            assert (tmp_path / "together" / name / file).read_bytes() == alone, (name, file)
    # A run that is there already is not computed again beside one that is not.
    one_is_new = {**dict([*runs.items()][:1]), tmp_path / "together" / "masks-v1": load_protocol("masks-v1")}
    again = run_benchmark(replace(together, runs=one_is_new))
    assert [run.summary.provenance.work.units_reused for run in again.values()] == [3, 0]
