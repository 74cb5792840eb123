"""Seeded regressions on rendered drives: each makes the gate fail, and the same code never does."""

import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pytest

from bench.evaluation.definitions import COUNTS
from bench.evaluation.protocol import load_protocol
from bench.evaluation.sums import sum_run, write_sums
from bench.gate.baseline import read_run_sums, write_baseline
from bench.gate.judge import judge
from bench.gate.tolerances import load_tolerances
from bench.gate.verdict import Outcome, Verdict
from bench.geometry import RigidTransform
from bench.harness.counts import TABLES, read_parts
from bench.harness.stored import SUMS
from bench.methods import MethodInput, Segmentation, build_method
from bench.methods.spherical.method import SphericalMethod
from tests.gate.conftest import run
from tests.support.commands import called_here
from tests.support.counts import change_table

pytestmark = pytest.mark.slow

SEEDS = range(20)


@dataclass(frozen=True, kw_only=True)
class YawSignFlipped(SphericalMethod):
    """The ego-motion's rotation is inverted and the translation kept, as a wrong sign of the yaw rate does."""

    def segment(self, frame: MethodInput) -> Segmentation:
        motions = tuple(RigidTransform(m.rotation.T, m.translation_m) for m in frame.current_from_previous)
        return super().segment(replace(frame, current_from_previous=motions))


@dataclass(frozen=True, kw_only=True)
class CalibrationShifted(SphericalMethod):
    """The principal point is 5 px to the right."""

    def segment(self, frame: MethodInput) -> Segmentation:
        u, v = frame.camera.principal_point
        return super().segment(replace(frame, camera=replace(frame.camera, principal_point=(u + 5.0, v))))


@pytest.fixture(scope="module")
def baseline(good_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("baselines") / "gated"
    write_baseline(read_run_sums(good_run), folder)
    return folder


def command(folder: Path, baseline: Path) -> CompletedProcess[str]:
    return called_here("gate", folder, "--baseline", baseline, "--tolerances", "rendered-v1")


def verdict(good: Path, other: Path, tolerances: str = "rendered-v1") -> Verdict:
    return judge(read_run_sums(good), read_run_sums(other), tolerances=load_tolerances(tolerances))


def rows_with(found: Verdict, outcome: Outcome = Outcome.FAILED) -> set[tuple[str, str]]:
    return {(row.slice_name, row.metric) for row in found.rows_with(outcome)}


FALSE_POSITIVES = ("frames", "false_positive_coverage")
REGRESSIONS = {  # of methods, and what fails by them and what is suspect
    "positive depth switched off": (
        build_method("spherical", {"weights": {"positive_depth": 0}}),
        {("overtaking", "tpr_all"), ("overtaking", "iou")},
        {("frames", "recall")},
    ),
    "sign of the yaw rate flipped": (YawSignFlipped(), {FALSE_POSITIVES}, {("frames", "precision")}),
    "calibration shifted by 5 px": (CalibrationShifted(), {FALSE_POSITIVES}, set()),
}


@pytest.mark.parametrize("name", REGRESSIONS)
def test_a_method_that_got_worse_fails_by_its_scores(gated_card, good_run, baseline, tmp_path, name):
    method, failing, suspect = REGRESSIONS[name]
    found = verdict(good_run, run(gated_card, tmp_path / "run", method))
    assert rows_with(found) >= failing
    assert rows_with(found, Outcome.SUSPECT) >= suspect, "it decides nothing"
    assert not found.failed_checks, "the data are the same: the score tells it"
    assert command(tmp_path / "run", baseline).returncode == 1
    if "depth" in name:
        assert rows_with(verdict(good_run, tmp_path / "run", "default-v1")) >= failing
    if "yaw" in name:
        worst = next(row for row in found.rows_with(Outcome.FAILED) if row.slice_name == "frames")
        assert worst.worst_recordings[0].recording.startswith("turning")


def test_calibration_shifted_by_5_px_in_the_data(gated_card, good_run, baseline, tmp_path):
    folder = shutil.copytree(gated_card.parent, tmp_path / "datasets")
    for file in folder.glob("data/gated/*/recording.json"):
        recording = json.loads(file.read_text())
        (camera,) = recording["cameras"].values()
        camera["model"]["principal_point"][0] += 5
        file.write_text(json.dumps(recording))
    found = verdict(good_run, run(folder / gated_card.name, tmp_path / "run"), "default-v1")
    assert {check.name for check in found.failed_checks} >= {"reference", "data"}
    assert command(tmp_path / "run", baseline).returncode == 1


def well_covered(objects: pa.Table) -> pa.Table:
    """All rows but the evaluated objects that are covered by less than 90 %."""
    covered = pc.divide(pc.cast(objects["tp"], "float64"), pc.cast(objects["region_px"], "float64"))
    poor = pc.and_(pc.equal(objects["status"], "evaluated"), pc.less(covered, 0.9))
    return objects.filter(pc.invert(poor))


def count_objects(results: Path) -> int:
    return sum(map(len, read_parts(results, "objects")))


def test_a_run_that_drops_its_hardest_objects(good_run, baseline, tmp_path):
    folder = shutil.copytree(good_run, tmp_path / "copy")
    results = folder / "paper-v1"
    before = count_objects(results)
    change_table(results, "objects", well_covered)  # as if it had been run like this
    dropped = before - count_objects(results)
    assert dropped > 0
    write_sums(
        sum_run(*(read_parts(results, table) for table in TABLES), protocol=load_protocol("paper-v1")), results / SUMS
    )
    found = verdict(good_run, folder)
    (counts,) = [check for check in found.failed_checks if check.name == "reference"]
    assert counts.message.startswith(f"reference changed: {dropped} object-frames fewer in all_moving")
    assert not rows_with(found)  # the scores got no worse, which is why the objects are counted
    assert command(folder, baseline).returncode == 1


def test_a_regression_in_two_recordings_is_suspect_not_failed(gated_card, good_run, tmp_path):
    """A limit of the gate: where few recordings show a mistake, the interval includes no change."""
    folder = run(gated_card, tmp_path / "run", YawSignFlipped())
    good, bad = read_run_sums(good_run), read_run_sums(folder)
    kept = {"turning-left", "turning-right"}
    sides = [side.sums[side.sums["recording"].isin(kept) == own] for side, own in ((good, False), (bad, True))]
    one = replace(bad, sums=pd.concat(sides))
    found = judge(good, one, tolerances=load_tolerances())
    suspect = {(row.slice_name, row.metric): row for row in found.rows_with(Outcome.SUSPECT)}
    assert suspect["frames", "false_positive_coverage"].worst_recordings[0].recording in kept
    assert ("frames", "false_positive_coverage") not in rows_with(found)


def test_the_same_code_never_fails(gated_card, good_run, baseline, tmp_path):
    good, again = read_run_sums(good_run), read_run_sums(run(gated_card, tmp_path / "run"))
    pd.testing.assert_frame_equal(again.sums, good.sums, check_exact=True)
    found = judge(good, again, tolerances=load_tolerances())
    assert found.passed
    assert {row.outcome for row in found.rows} == {Outcome.PASSED, Outcome.NOT_JUDGED}
    assert command(tmp_path / "run", baseline).returncode == 0


def test_noise_of_another_processor_never_fails_whatever_the_seed(good_run):
    """Half a percent of every recording's sums; another processor moved false-positive coverage by a hundredth."""
    good = read_run_sums(good_run)
    for seed in SEEDS:
        draw = np.random.default_rng(seed)
        shaken = good.sums.assign(numerator=good.sums["numerator"] * draw.uniform(0.995, 1.005, len(good.sums)))
        counted = shaken["metric"].isin(COUNTS)
        shaken.loc[counted, "numerator"] = good.sums.loc[counted, "numerator"]
        assert judge(good, replace(good, sums=shaken), tolerances=load_tolerances()).passed
