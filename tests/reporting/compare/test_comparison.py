import math
import re

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from bench.errors import DataError, UsageError
from bench.evaluation import holm
from bench.reporting.compare.changes import HEADLINES, Kind, Verdict, compare_runs, verdict_line
from bench.reporting.compare.runs import differing_settings, read_comparable
from tests.reporting.compare.runs import IMAGE_PX, IMAGES, RECORDINGS, drawn, write_run
from tests.support.stored_files import change_summary


def compared(*folders):
    return compare_runs(read_comparable(folders))


def rows_by_name(comparison):
    return {row.name: row for row in comparison.rows}


@pytest.fixture(scope="module")
def half(tmp_path_factory):
    """Every object half detected."""
    return write_run(tmp_path_factory.mktemp("runs") / "half", drawn(50))


def test_a_run_against_itself_differs_in_nothing(half):
    (found,) = compared(half, half)
    for row in found.rows:
        for cell in row.metrics.values():
            assert cell.change.difference == 0 or cell.change.cases_before == 0
            assert cell.change.p_value in (None, 1.0)
            assert cell.verdict in (None, Verdict.THE_SAME, Verdict.NO_CASES)
    assert [(c.gained, c.lost) for c in found.detections] == [(0, 0)] * 6
    assert found.frames == []
    assert found.after.label == "half (2)"
    assert verdict_line(found).startswith("half (2) against half, over everything: the same: IoU, all; TPR, all")


def test_a_run_that_finds_nothing_loses_everything(half, tmp_path):
    nothing = write_run(tmp_path / "nothing", drawn(0), fp_px=0)
    (found,) = compared(half, nothing)
    whole = found.detections[-1]
    assert whole.object_frames == RECORDINGS * IMAGES + 3 * IMAGES
    assert (whole.before, whole.after, whole.gained, whole.lost) == (whole.object_frames, 0, 0, whole.object_frames)
    rows = rows_by_name(found)
    assert rows["all_moving"].metrics["detection_rate_50"].verdict is Verdict.WORSE
    assert rows["crossing"].metrics["detection_rate"].change.difference == -1
    assert rows["preceding"].metrics["detection_rate_50"].verdict is Verdict.TOO_FEW, "three recordings"
    assert rows["overtaking"].metrics["iou"].verdict is Verdict.NO_CASES
    assert math.isnan(rows["all_moving"].metrics["tpr"].change.after), "no detected object-frame"
    assert rows["frames"].metrics["false_positive_coverage"].change.before == 3072 / IMAGE_PX
    assert rows["frames"].metrics["false_positive_coverage"].verdict is Verdict.BETTER
    assert {frame.kind for frame in found.frames} == {Kind.LOST, Kind.FEWER_FALSE}
    tracks = [(f.recording, f.track_id) for f in found.frames]
    assert len(tracks) == len(set(tracks)), "one frame per object"


def test_gained_and_lost_add_up_with_the_detected(half, tmp_path):
    before = drawn(50) | {(r, 0, "crossing"): 0 for r in range(4)}
    after = drawn(50) | {(r, 1, "crossing"): 0 for r in range(7)} | {(0, 2, "preceding"): 0}
    (found,) = compared(write_run(tmp_path / "a", before), write_run(tmp_path / "b", after))
    counts = {c.name: c for c in found.detections}
    assert (counts["crossing"].gained, counts["crossing"].lost) == (4, 7)
    assert (counts["preceding"].gained, counts["preceding"].lost) == (0, 1)
    for row in found.detections:
        assert row.after - row.before == row.gained - row.lost
        cell = rows_by_name(found)[row.name].metrics["detection_rate"]
        if row.object_frames:
            assert cell.change.difference * row.object_frames == pytest.approx(row.after - row.before)


def test_the_largest_changes_of_coverage_come_first(half, tmp_path):
    after = drawn(50) | {(1, 1, "crossing"): 20, (2, 1, "crossing"): 5, (2, 2, "crossing"): 10, (3, 0, "crossing"): 80}
    (found,) = compared(half, write_run(tmp_path / "b", after))
    fell = [(f.recording, f.before, f.after) for f in found.frames if f.kind is Kind.FELL]
    assert fell == [("drive-2", 0.5, 0.05), ("drive-1", 0.5, 0.2)]
    assert [(f.recording, f.after) for f in found.frames if f.kind is Kind.ROSE] == [("drive-3", 0.8)]


def test_holm_runs_over_the_rows_of_one_metric_with_a_p_value(half, tmp_path):
    after = {key: 30 if key[2] == "crossing" else 51 for key in drawn(50)}
    after |= {(0, 0, "approaching"): 40}
    before = drawn(50) | {(0, 0, "approaching"): 50}
    (found,) = compared(write_run(tmp_path / "a", before), write_run(tmp_path / "b", after))
    for metric in HEADLINES:
        cells = [row.metrics[metric] for row in found.rows if metric in row.metrics]
        assert [cell.p_holm for cell in cells] == holm([cell.change.p_value for cell in cells])
    rows = rows_by_name(found)
    tested = [row.name for row in found.rows if "tpr_all" in row.metrics and row.metrics["tpr_all"].p_holm is not None]
    assert tested == ["crossing", "all_moving"], "three recordings are no test"
    lowest, other = rows["all_moving"].metrics["tpr_all"], rows["crossing"].metrics["tpr_all"]
    assert lowest.p_holm == pytest.approx(2 * lowest.change.p_value)
    assert other.p_holm == other.change.p_value == 2 / 2**RECORDINGS, "all of them agree"
    alone = rows["frames"].metrics["false_positive_coverage"]
    assert alone.p_holm == alone.change.p_value == 1
    extras = [cell for row in found.rows for name, cell in row.metrics.items() if name not in HEADLINES]
    assert extras
    assert all(cell.p_holm is None and cell.verdict is None for cell in extras)


def test_chance_stands_beside_detection_only(half):
    (found,) = compared(half, half)
    crossing = rows_by_name(found)["crossing"].metrics
    assert {name for name, cell in crossing.items() if cell.chance} == {
        "detection_rate", "detection_rate_10", "detection_rate_50",
    }  # fmt: skip
    before, after = crossing["detection_rate"].chance
    assert before.value == after.value == 1, "5 pixels of the other mask"


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            {"protocol": "extended-v1"},
            r"protocol extended-v1 version 1 \([0-9a-f]{12}\), was paper-v1 version 1 \(",
        ),
        (
            {"region_px": 90},
            "on the 32 images that both scored: 44 object-frames with another polygon_px, the first drive-0 front 0 ",
        ),
        ({"dataset": "other"}, "data set 'other', was 'demo'"),
        ({"split": "test"}, "split 'test', was none"),
    ],
)
def test_runs_that_do_not_compare_are_refused_with_both_values(half, tmp_path, changed, message):
    other = write_run(tmp_path / "other", drawn(50), **changed)
    with pytest.raises(UsageError, match=message) as refused:
        compared(half, half, other)
    assert str(refused.value).startswith(f"{half} and {other} do not compare: ")
    assert "\n" not in str(refused.value)


def test_one_run_is_not_enough(half):
    with pytest.raises(UsageError, match="at least two runs, got 1"):
        compared(half)


def test_object_frames_that_one_run_alone_has_are_an_error(half, tmp_path):
    other = write_run(tmp_path / "other", drawn(50))
    objects = pq.read_table(other / "objects.parquet")
    pq.write_table(objects.slice(1), other / "objects.parquet")
    change_summary(other)
    with pytest.raises(DataError, match=r"1 that only one has, first drive-0 front 0 crossing"):
        compared(half, other)


def test_the_order_of_the_rows_changes_nothing(half, tmp_path):
    after = drawn(50) | {(r, 1, "crossing"): 10 * r for r in range(7)}
    one, two = write_run(tmp_path / "one", after), write_run(tmp_path / "two", after)
    for name in ("objects.parquet", "frames.parquet"):
        table = pq.read_table(two / name)
        pq.write_table(table.take(pa.array(range(len(table))[::-1])), two / name)
    change_summary(two)
    (first,), (second,) = compared(half, one), compared(half, two)
    # As text, since NaN is not equal to itself; sums may differ in their last digits.
    texts = [
        re.sub(r"\d+\.\d+", lambda number: f"{float(number[0]):.10f}", repr((one.rows, one.frames, one.detections)))
        for one in (first, second)
    ]
    assert texts[0] == texts[1]


def test_settings_are_named_where_they_differ(tmp_path):
    weights = [{"weights": {"depth": 1.0, "height": h}, "flow": "dis"} for h in (0.2, 0.0)]
    runs = [write_run(tmp_path / str(n), drawn(50), settings=own) for n, own in enumerate(weights)]
    (found,) = compared(*runs)
    assert found.methods == ("nothing (weights.height=0.2)", "nothing (weights.height=0.0)")
    assert differing_settings([found.before.summary, found.before.summary]) == [{}, {}]
    assert re.fullmatch("[01]", found.before.label)
