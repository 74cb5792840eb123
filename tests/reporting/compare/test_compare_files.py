import csv
import io
import re
from urllib.parse import unquote

import pandas as pd
import pytest

from bench.reporting.compare import compare_runs, read_comparable, terminal_report, write_comparison
from bench.reporting.formats import points
from tests.reporting.compare.runs import drawn, write_run
from tests.reporting.printed import printed

NAMES = ["compare.html", "compare.md", "compare.csv"]


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    runs = tmp_path_factory.mktemp("runs")
    after = {key: 0 if key[0] < 7 and key[1] == 1 else 20 + key[0] for key in drawn(50)}
    return [write_run(runs / "old", drawn(50)), write_run(runs / "new", after, fp_px=0), write_run(runs / "x|y", after)]


def test_equal_input_gives_equal_bytes(folders, tmp_path):
    _, first = write_comparison(folders, tmp_path / "one")
    _, second = write_comparison(folders, tmp_path / "two")
    assert [file.name for file in first] == NAMES
    assert [file.read_bytes() for file in first] == [file.read_bytes() for file in second]


def test_all_forms_carry_the_same_numbers(folders, tmp_path):
    comparisons, _ = write_comparison(folders, tmp_path)
    (row,) = [
        row
        for row in csv.DictReader(io.StringIO((tmp_path / "compare.csv").read_text()))
        if (row["after_run"], row["row"], row["metric"]) == ("new", "crossing", "tpr_all")
    ]
    # Seven recordings lose one image of four; of the others (20 + r) % are found.
    difference = sum(0.2 + r / 100 for r in range(8) for k in range(4) if r == 7 or k != 1) / 32 - 0.5
    cell = comparisons[0].changes.droplevel("breakdown").loc[("crossing", "tpr_all")]
    assert cell["difference"] == float(row["difference"]) == pytest.approx(difference)
    assert cell["ci95"] == (float(row["ci95_low"]), float(row["ci95_high"]))
    assert cell["p_holm"] == float(row["p_holm"])
    assert cell["verdict"] == row["verdict"] == "worse"
    assert (
        f"| TPR, all | Crossing | worse | 8 | 50.0 | {50 + 100 * difference:.1f} | {points(difference)} |"
        in (tmp_path / "compare.md").read_text()
    )
    assert comparisons[0].detections.loc["all_moving"].lost == 7 + 3


def test_recordings_are_set_beside_each_other(folders, tmp_path):
    write_comparison(folders[:2], tmp_path)
    keys = ["breakdown", "metric", "recording"]
    sums = [pd.read_csv(folder / "paper-v1" / "sums.csv").set_index(keys).loc["all_moving"] for folder in folders[:2]]
    lines = (tmp_path / "compare.md").read_text().splitlines()
    for recording in (f"drive-{number}" for number in range(8)):
        rows = [one.loc[metric, recording] for metric in ("iou", "tpr_all", "detection_rate_50") for one in sums]
        expected = [f"{100 * row['numerator'] / row['denominator']:.1f}" for row in rows]
        (line,) = [line for line in lines if line.startswith(f"| {recording} |")]
        assert line.split(" | ")[1:7] == expected


def test_markdown_says_what_is_better_and_what_is_worse(folders, tmp_path):
    write_comparison(folders, tmp_path)
    text = (tmp_path / "compare.md").read_text()
    assert (
        "**new against old, over everything: better: False-positive coverage. worse: IoU, all; TPR, all; Detection"
        in text
    )
    for metric in ("TPR, all", "IoU, all", "Detection at 50 %"):
        assert f"| {metric} | Crossing | worse | 8 |" in text
        assert f"| {metric} | Preceding | too few recordings | 3 |" in text
    assert "6 recordings with cases of both runs" in text
    assert "| TPR, all | Preceding | too few recordings | 3 | 50.0 |" in text
    assert "| Overtaking | 0 |" in text
    assert "n/a" not in text, "kinds without object-frames are not judged"
    assert "| newly missed: vehicle 'crossing', crossing, 4.0 m (drive-0, front, 100 ms) | 50.0 | 0.0 |" in text
    assert "| fewer false positives (drive-0, front, 0 ms) | 1.0 | 0.0 |" in text
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert all(line.replace(r"\|", "").count("|") >= 3 for line in lines)


def test_without_data_there_are_no_pictures_and_the_reason_is_said(folders, tmp_path):
    comparisons, _ = write_comparison(folders, tmp_path)
    assert not (tmp_path / "pictures").exists()
    remarks = [comparison.remarks for comparison in comparisons]
    assert all(remark.startswith("no picture: nowhere.yaml") for (remark,) in remarks)
    assert "no picture: nowhere.yaml" in (tmp_path / "compare.md").read_text()


def test_the_page_leads_to_the_pages_of_the_runs(folders, tmp_path):
    page = folders[1] / "paper-v1" / "index.html"
    page.write_text("a page")
    write_comparison(folders[:2], tmp_path / "a b")
    links = re.findall(r'<a href="([^"]*)">([^<]*)</a>', (tmp_path / "a b" / "compare.html").read_text())
    page.unlink()
    ((address, label),) = links  # the other run has no page
    assert label == "new"
    assert (tmp_path / "a b" / unquote(address)).resolve() == page.resolve()


def test_old_pictures_go_and_other_files_stay(folders, tmp_path):
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    for name in ("01-01-newly-missed.jpg", "mine.jpg"):
        (pictures / name).write_bytes(b"")
    write_comparison(folders, tmp_path)
    assert [file.name for file in pictures.iterdir()] == ["mine.jpg"]


def test_the_terminal_table_fits(folders):
    comparison = compare_runs(read_comparable(folders))[0]
    shown = printed(terminal_report(comparison), width=100)
    assert "…" not in shown
    assert "(Holm) \n" in shown, "the last column is whole"
    for word in ("new (after) against old (before)", "Crossing", "False positives"[:5], "worse", "-28.7", "<0.001"):
        assert word in shown
    lines = [line.split() for line in shown.splitlines()]
    assert ["Preceding", "too", "few", "3", "50.0", "15.8", "-34.2"] in lines
