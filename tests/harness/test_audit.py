"""A whole audit of a small rendered data set."""

from __future__ import annotations

import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from bench.audit.causes import FalseCause, MissCause
from bench.audit.polygons import Compensation
from bench.audit.run import AuditSummary, Scoring, run_audit
from bench.errors import DataError
from bench.execution import ProcessExecutor
from bench.methods import build_method
from bench.recordings import load_card
from tests.support.changed_data import without_scenario
from tests.support.commands import call
from tests.support.runs import PAPER, score

pytestmark = pytest.mark.slow

TABLES = tuple(f"{name}.parquet" for name in ("polygons", "objects", "frames", "misses", "false_alarms"))


def audited(card: Path, out: Path, *, method: str = "spherical", **options: object) -> AuditSummary:
    found, _ = run_audit(load_card(card), method=build_method(method), protocol=PAPER, out=out, **options)  # type: ignore[arg-type]
    return found


@pytest.fixture(scope="module")
def folder(tiny_card: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("audit") / "tiny"
    audited(tiny_card, out)
    return out


@pytest.fixture(scope="module")
def audit(folder: Path) -> AuditSummary:
    return stored(folder)


def stored(folder: Path) -> AuditSummary:
    return AuditSummary.model_validate_json((folder / "audit.json").read_bytes())


def test_scores_against_lidar_polygons_are_the_benchmark(audit: AuditSummary, tiny_card: Path, tmp_path: Path):
    assert (audit.failures, audit.left_out, audit.recordings) == ((), "", 3)
    run = score(tiny_card, tmp_path / "run")
    assert audit.not_seen == 0
    found = audit.scores[Scoring.LIDAR]
    assert found.categories == run.categories
    assert found.false_positives == run.false_positives


def test_every_scoring_is_over_the_same_object_frames(folder: Path):
    rows = pq.read_table(folder / "objects.parquet").to_pandas()
    rows = rows[rows["status"] == "evaluated"]
    keys = ["recording", "camera", "timestamp_ns", "track_id", "category"]
    sets = [set(part[keys].itertuples(index=False, name=None)) for _, part in rows.groupby("scoring")]
    assert len(sets) == len(Scoring)
    assert all(other == sets[0] for other in sets)
    assert len(sets[0]) > 5


def test_perfect_cells_bound_the_method_with_exact_flow(audit: AuditSummary):
    exact, cells = (audit.scores[scoring] for scoring in (Scoring.EXACT_FLOW, Scoring.CELLS))
    assert cells.all_moving.detection_rate.value == 1
    assert cells.all_moving.tpr_all.value > 0.7
    # All but a bound: a static cell that anti-parallel flags may hold some pixels of an object.
    assert exact.all_moving.tpr_all.value < cells.all_moving.tpr_all.value + 0.02
    assert exact.all_moving.iou.value < cells.all_moving.iou.value + 0.02
    assert exact.false_positives.coverage.value < 0.2 * audit.scores[Scoring.MASKS].false_positives.coverage.value


def test_polygons_of_every_kind_and_compensation_are_compared(folder: Path, audit: AuditSummary):
    rows = pq.read_table(folder / "polygons.parquet").to_pandas()
    assert set(rows["kind"]) == set(audit.polygon_kinds)
    assert audit.polygon_kinds[0] == "convex"
    assert set(rows["compensation"]) == {compensation.value for compensation in Compensation}
    full = rows[rows["compensation"] == Compensation.FULL.value]
    assert full.groupby("kind").size().nunique() == 1
    median = full.groupby("kind")["iou"].median()
    assert (median > 0.4).all()
    assert (median <= 1).all()
    assert (full["area_error"] - (full["region_px"] / full["mask_px"] - 1)).abs().max() < 1e-9


def test_shares_add_up(folder: Path, audit: AuditSummary):
    misses, static = (pq.read_table(folder / f"{name}.parquet").to_pandas() for name in ("misses", "false_alarms"))
    assert (misses["cells"] == misses["hit"] + misses[[*MissCause]].sum(axis=1)).all()
    assert (misses["hit_by_error"] <= misses["hit"]).all()
    assert (static["flagged"] == static[[*FalseCause]].sum(axis=1)).all()
    *categories, every = audit.misses
    assert every.cells == sum(row.cells for row in categories) > 100
    assert every.wrong == every.cells - misses["hit"].sum()
    assert audit.false_alarms is not None
    assert audit.false_alarms.wrong == static["flagged"].sum() > 0
    assert audit.false_alarms.causes["other_constraint"] == 0  # a static point obeys epipolar plane and depth


def test_processes_change_nothing(folder: Path, tiny_card: Path, tmp_path: Path):
    audited(tiny_card, tmp_path / "again", executor=ProcessExecutor(workers=2))
    for name in TABLES:
        assert pq.read_table(tmp_path / "again" / name).equals(pq.read_table(folder / name)), name
    first, second = (stored(place).model_dump_json(exclude={"provenance"}) for place in (folder, tmp_path / "again"))
    assert first == second


def test_a_method_with_cells_and_masks_of_its_own_is_explained_too(tiny_card: Path, tmp_path: Path):
    found = audited(tiny_card, tmp_path / "rigid-scene", method="rigid-scene", recordings=1)
    assert (found.failures, found.left_out) == ((), "")
    masks, exact = found.scores[Scoring.MASKS].all_moving, found.scores[Scoring.EXACT_FLOW].all_moving
    assert exact.iou.value > masks.iou.value + 0.1
    assert exact.iou.value < found.scores[Scoring.CELLS].all_moving.iou.value
    every = found.misses[-1]
    assert every.cells > every.wrong > 100
    assert every.causes["near_epipole"] == 0  # it leaves nothing out there
    assert every.flow_error_px.median < 3
    assert found.false_alarms is not None
    assert found.false_alarms.wrong > 0
    assert found.false_alarms.causes["anti_parallel"] == 0


def test_another_method_is_scored_but_not_explained(tiny_card: Path, tmp_path: Path):
    found = audited(tiny_card, tmp_path / "everything", method="everything", recordings=1)
    assert found.recordings == 1
    assert set(found.scores) == {Scoring.LIDAR, Scoring.MASKS}
    assert found.scores[Scoring.MASKS].all_moving.tpr_all.value == 1
    assert "does not take flow from outside" in found.left_out
    assert (found.misses, found.false_alarms) == ((), None)


def test_without_masks_there_is_nothing_to_compare(own_card: Path, tmp_path: Path):
    without_scenario(own_card)
    for folder in (own_card.parent / "data" / "tiny").glob("*/truth/front"):
        shutil.rmtree(folder)
    with pytest.raises(DataError, match=r"expected rendered masks .* audit a rendered data set"):
        audited(own_card, tmp_path / "out")


def test_images_that_cannot_be_used_are_reported(own_card: Path, tmp_path: Path):
    without_scenario(own_card)
    image = sorted((own_card.parent / "data" / "tiny" / "crossing" / "truth" / "front").iterdir())[2]
    image.write_bytes(image.read_bytes()[:100])
    found = audited(own_card, tmp_path / "out", split="moving")
    assert "names no scenario" in found.left_out
    assert found.polygons
    assert any("cut short" in failure and image.name in failure for failure in found.failures)
    assert found.scores[Scoring.LIDAR].false_positives.frames == 7


def test_the_command_prints_the_tables_and_leaves_the_files(monkeypatch, capsys, tiny_card, tmp_path):
    out = tmp_path / "audit"
    assert call(monkeypatch, "audit", tiny_card, "--out", out, "--split", "moving", "--set", "threshold=0.01") == 0
    shown = capsys.readouterr().out
    for text in ("How well the reference polygons", "lidar polygons", "Why cells of moving", "elsewhere"):
        assert text in shown
    for name in ("audit.json", "audit.md"):
        assert (out / name).stat().st_size > 100
        assert str(out / name) in shown
