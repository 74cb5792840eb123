"""Results over time: in the order of commits, changes as `compare` judges them, breaks where runs do not compare."""

import csv
import io
from pathlib import Path

import pytest
from matplotlib.colors import to_hex

from bench.errors import DataError
from bench.evaluation import find_metric, load_protocol
from bench.reporting.canvas import BLACK, GREEN, GREY, VERMILION
from bench.reporting.compare.changes import Shown, changes_over_everything, compare_runs, verdict_line
from bench.reporting.compare.runs import read_comparable
from bench.reporting.history import draw, history_tables, read_history, write_history
from tests.reporting.compare.runs import RECORDINGS, drawn, write_run
from tests.reporting.printed import printed

ROOT = Path("/")  # no checkout knows these commits: runs are in the order of their own times


def spread(shift: int) -> dict:
    """Recordings of very different difficulty, all of which change by nearly the same."""
    return {(r, n, category): 10 * r + 10 + shift + (r % 2 if shift else 0) for r, n, category in drawn(0)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Five runs over time: the same, better in pairs alone, worse with changed files; then other data."""
    runs = tmp_path_factory.mktemp("runs")
    for day, (name, detected, fp_px, commit, more) in enumerate(
        (
            ("later/last", spread(3), 3072, "dddd00000000", {"region_px": 90}),
            ("a-first", spread(0), 3072, "aaaa00000000", {}),
            ("b-better", spread(6), 3072, "bbbb00000000", {}),
            ("c-worse", spread(6), 9000, "cccc00000000+", {}),
        )
    ):
        started = "2026-03-09T10:00:00+00:00" if "last" in name else f"2026-03-0{day}T10:00:00+00:00"
        write_run(runs / name, detected, fp_px=fp_px, commit=commit, started_utc=started, **more)
    return runs


def test_runs_stand_in_order_and_a_changed_reference_ends_a_stretch(folder):
    ((title, series),) = read_history([folder], checkout=ROOT).series.items()
    assert title == "nothing on demo, all recordings, paper-v1"
    assert [(point.name, point.stretch) for point in series] == [
        ("aaaa0000", 1), ("bbbb0000", 1), ("cccc0000+", 1), ("dddd0000", 2),
    ]  # fmt: skip
    assert [point.committed for point in series] == [True, True, False, True]
    reason = f"the reference changed on the {RECORDINGS * 4} images that all scored"
    assert [point.break_before for point in series] == ["", "", "", reason]
    assert [point.since is None for point in series] == [True, False, False, True]


def test_a_change_is_what_compare_says_of_the_pair_not_what_intervals_seem_to_say(folder):
    ((_, series),) = read_history([folder], checkout=ROOT).series.items()
    first, second, third, _ = series
    for before, after, metric, verdict in (
        (first, second, "iou", Shown.BETTER),
        (first, second, "false_positive_coverage", Shown.THE_SAME),
        (second, third, "iou", Shown.THE_SAME),
        (second, third, "false_positive_coverage", Shown.WORSE),
    ):
        (compared,) = compare_runs(read_comparable([before.run.folder, after.run.folder]))
        row = changes_over_everything(compared).loc[metric]
        change = after.change(metric)
        assert change["verdict"] == row["verdict"] == verdict
        assert (change["difference"], change["ci95"]) == (row["difference"], row["ci95"])
        assert f"{verdict.value}: " in verdict_line(compared)
    one, two = first.metrics["iou"].ci95, second.metrics["iou"].ci95
    assert one[1] > second.metrics["iou"].value, "the intervals overlap widely"
    assert two[0] < first.metrics["iou"].value


def test_the_line_is_coloured_by_the_verdict_and_broken_where_runs_do_not_compare(folder):
    ((title, series),) = read_history([folder], checkout=ROOT).series.items()
    figure = draw(title, series)
    assert [" ".join(axes.get_ylabel().split()) for axes in figure.axes] == [
        find_metric(name).label for name in ("iou", "tpr_all", "detection_rate_50", "false_positive_coverage")
    ]
    for axes, colours in ((figure.axes[0], [GREEN, GREY]), (figure.axes[3], [GREY, VERMILION])):
        steps = {
            round(min(line.get_xdata())): to_hex(line.get_color())
            for line in axes.lines
            if len(line.get_xdata()) == 2 and max(line.get_xdata()) - min(line.get_xdata()) == 1
            and to_hex(line.get_color()) != BLACK
        }  # fmt: skip
        assert [steps[place] for place in sorted(steps)] == colours, "none to the last run"
        hollow = [line.get_xdata()[0] for line in axes.lines if len(line.get_xdata()) == 1
                  and to_hex(line.get_markerfacecolor()) == "#ffffff"]  # fmt: skip
        assert hollow == [2]
        (broken,) = [line for line in axes.lines if line.get_linestyle() == "--" and len(line.get_xdata())]
        assert list(broken.get_xdata()) == [2.5, 2.5]
    labels = [text.get_text() for text in figure.axes[-1].get_xticklabels()]
    assert labels[0] == "aaaa0000\n2026-03-01"


def test_files_and_terminal_say_the_same(folder, tmp_path):
    found = read_history([folder], checkout=ROOT)
    files = write_history(found, tmp_path / "one")
    again = write_history(read_history([folder, folder / "a-first"], checkout=ROOT), tmp_path / "two")
    assert [file.read_bytes() for file in files] == [file.read_bytes() for file in again], "no run twice"
    assert [file.name for file in files] == [
        "history.html", "history.md", "history.csv", "history.tex", "history-1.png", "history-1.svg",
    ]  # fmt: skip
    assert files[0].read_text().count('<img src="data:image/png;base64,') == 1
    sentence = "dddd0000 does not compare with cccc0000+, which is no change of the method: the reference changed"
    for text in (files[0].read_text(), files[1].read_text(), printed(history_tables(found))):
        assert sentence in " ".join(text.split())
    assert "no difference shown" not in files[1].read_text().partition("| aaaa0000 to bbbb0000")[2].splitlines()[0]
    assert r"\label{tab:history-1-changes-1}" in files[3].read_text()
    rows = {(row["commit"], row["metric"]): row for row in csv.DictReader(io.StringIO(files[2].read_text()))}
    assert len(rows) == 4 * 4
    row = rows["bbbb00000000", "iou"]
    assert (row["verdict"], row["before_run"], row["stretch"], row["images_compared"]) == (
        "better",
        "a-first",
        "1",
        "32",
    )
    assert float(row["difference_ci95_low"]) > 0
    assert rows["dddd00000000", "iou"]["verdict"] == rows["aaaa00000000", "iou"]["difference"] == ""


def test_changed_data_and_another_state_of_the_protocol_break_the_line_too(tmp_path):
    """Also where the reference on the images stayed; a recording that was added breaks nothing."""
    days = iter(range(1, 9))

    def add(name, **more):
        write_run(tmp_path / name, drawn(50), started_utc=f"2026-03-0{next(days)}T10:00:00+00:00", **more)

    add("one", recordings={"drive-0": "1"}, commit="a" * 40)
    add("two", recordings={"drive-0": "1", "drive-9": "1"}, commit="b" * 40)
    add("three", recordings={"drive-0": "2", "drive-9": "1"}, commit=None)
    rules = load_protocol("paper-v1").model_dump_json(exclude_unset=True).replace('"version":1', '"version":2')
    (tmp_path / "rules.yaml").write_text(rules)
    add("four", recordings={"drive-0": "2", "drive-9": "1"}, commit=None, protocol=tmp_path / "rules.yaml")
    (series,) = read_history([tmp_path], checkout=ROOT).series.values()
    assert [(point.name, point.stretch) for point in series] == [
        ("aaaaaaaa", 1), ("bbbbbbbb", 1), ("three", 2), ("four", 3),
    ]  # fmt: skip
    assert "data recordings changed: 'drive-0' (1 of 2)" in series[2].break_before
    assert series[3].break_before.startswith("protocol paper-v1 version 2 (")


def test_each_method_as_it_was_asked_for_is_a_series_and_one_run_is_none(folder, tmp_path):
    for name, more in (("x", {"method": "empty"}), ("y", {"split": "part"}), ("z", {"protocol": "extended-v1"})):
        write_run(tmp_path / name, drawn(50), **more)
    found = read_history([folder, tmp_path], checkout=ROOT)
    assert [*found.series] == ["nothing on demo, all recordings, paper-v1"]
    assert found.alone == (
        "empty on demo, all recordings, paper-v1",
        "nothing on demo, all recordings, extended-v1",
        "nothing on demo, part, paper-v1",
    )
    assert "Of one run only" in printed(history_tables(found))
    with pytest.raises(DataError, match="expected several runs of one method, got one run of each"):
        read_history([tmp_path], checkout=ROOT)
