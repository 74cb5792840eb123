"""The page of a run: its top, statements read off the tables, the worst cases, and the file."""

import math
import re
import shutil
from types import SimpleNamespace

import pyarrow as pa
import pytest

from bench.evaluation.rows import OBJECT, to_frame
from bench.evaluation.summary import FrameLedger, Metric
from bench.harness.stored import read_run
from bench.reporting.document import environment
from bench.reporting.formats import bar_cell, percent
from bench.reporting.run_page import (
    breakdown_tables,
    image_facts,
    object_facts,
    object_table,
    remarks,
    tiles,
    worst_frames,
    worst_objects,
    write_page,
)
from tests.evaluation.runs import random_run, shuffled
from tests.reporting.compare.runs import drawn, write_run
from tests.reporting.printed import texts
from tests.reporting.summaries import figure, object_figures, summary
from tests.support.counts import change_table, read_tables
from tests.support.result_rows import evaluated, frame_row, frames_table, object_row, objects_table
from tests.support.stored_files import change_manifest


def test_only_slices_that_occur_are_listed():
    rows = {"[0, 2)": object_figures(0.9), "[2, 4)": object_figures(0.2), "[4, 6)": object_figures(math.nan)}
    none = {"front": object_figures(math.nan)}
    (table,) = breakdown_tables(summary().model_copy(update={"breakdowns": {"range_m": rows, "camera": none}}))
    assert table.title == "By range"
    assert [row[:2] for row in texts(table)] == [["[0, 2)", "40.5 %"], ["[2, 4)", "9.0 %"]]
    iou = table.cells()[0][1]
    assert iou.below == ("[35.5, 45.5]",)
    assert (iou.bar.share, *iou.bar.interval) == pytest.approx((0.405, 0.355, 0.455))
    cell = bar_cell(figure(math.nan))
    assert (cell.below, cell.bar) == (("(0 cases)",), None), "no cases, no bar"


def test_the_page_begins_with_the_headlines_and_the_ceiling_of_iou():
    figures = summary()
    ceiling = Metric(value=0.92, ci95=None, cases=100, recordings=8)
    with_truth = figures.all_moving.model_copy(update={"ceiling_iou": ceiling})
    table = tiles(figures.model_copy(update={"all_moving": with_truth}), large_px=100)
    assert list(zip(table.headings(), texts(table)[0], strict=True)) == [
        ("IoU, all", "27.0 %"),
        ("TPR, all", "42.0 %"),
        ("Detection at 50 %", percent(figures.all_moving.metric("detection_rate_50").value)),
        ("False-positive coverage", "10.5 %"),
        ("Frames with a large false positive", "88.0 %"),
    ]
    assert table.cells()[0][4].below == ("[83.0, 93.0]", "of the images have a false patch of more than 100 px")
    assert table.cells()[0][0].below == ("[22.0, 32.0]", "ceiling 92.0 %; over 100 object-frames")
    assert tiles(figures, large_px=100).cells()[0][0].below[-1] == "over 100 object-frames"


def test_what_was_not_scored_is_said():
    images = FrameLedger(images=10, evaluated=7, failed=2, skipped=1, problems={})
    assert [remark.text for remark in remarks(summary().model_copy(update={"images": images}), ["a", "b"])] == [
        "3 of 10 images could not be scored, with 2 failures: all values are of the rest; the last section says why."
    ]
    (none,) = remarks(summary().model_copy(update={"all_moving": object_figures(math.nan)}))
    assert (none.style, none.text) == (
        "warn", "No object-frame was evaluated: there is nothing to say of moving objects."
    )  # fmt: skip


# The worst cases.

S = 1_000_000_000


def objects(*rows):
    return evaluated(objects_table([
        object_row(0) | {"track_id": track, "timestamp_ns": time, "tp": tp, "fn": 100 - tp} for track, time, tp in rows
    ]))  # fmt: skip


def frames(*rows):
    size = {"width": 10, "height": 10}
    return evaluated(frames_table([
        frame_row(0) | size | {"recording": name, "timestamp_ns": time, "fp_px": fp} for name, time, fp in rows
    ]))  # fmt: skip


def test_the_least_found_image_of_each_object():
    table = objects(("a", 0, 1), ("a", S // 2, 2), ("a", 2 * S, 3), ("b", 0, 40), ("c", 0, 90))
    for most, expected in ((2, [("a", 0, 1), ("b", 0, 40)]), (9, [("a", 0, 1), ("b", 0, 40), ("c", 0, 90)])):
        picked = worst_objects([table.iloc[:1], table.iloc[1:]], most=most)
        assert [(row["track_id"], row["timestamp_ns"], row["tp"]) for row in picked] == expected
        assert [row["coverage"] for row in picked] == [tp / 100 for *_, tp in expected]


def test_the_image_with_most_false_marks_of_each_recording():
    table = frames(("x", 0, 50), ("x", 2 * S, 40), ("y", 0, 10), ("z", 0, 0))
    assert [(r["recording"], r["coverage"]) for r in worst_frames([table.iloc[:1], table.iloc[1:]], most=9)] == [
        ("x", 0.5),
        ("y", 0.1),
    ]
    assert [r["recording"] for r in worst_frames([table], most=1)] == ["x"]


ROW = {"coverage": 0.2, "range_m": 4.0, "points": 12, "region_px": 400, "polygon_px": 1000, "speed_mps": 4.8,
       "ego_speed_mps": 5.0}  # fmt: skip


def test_what_was_measured_is_said():
    assert object_facts(ROW) == (
        "20 % found; 4.0 m away, 12 lidar points, 400 of its polygon's 1000 px count; 4.8 m/s, ego vehicle 5.0 m/s"
    )
    counts = {"fp_px": 100, "fp_by_cause": {"epipolar": 70, "height": 30}, "coverage": 0.5, "fp_components": 7,
              "ego_speed_mps": 5.0}  # fmt: skip
    assert image_facts(counts) == ("50 % wrongly marked in 7 patches, most by epipolar, 70 %; ego vehicle 5.0 m/s")
    assert "most by" not in image_facts(counts | {"fp_by_cause": None})


def test_the_least_covered_object_frames_are_listed():
    table, _ = random_run(2)
    content = table.to_pylist()
    evaluated = sorted(
        (row["tp"] / (row["tp"] + row["fn"]), -row["region_px"], *(row[name] for name in OBJECT))
        for row in content
        if row["region_px"]
    )
    drives = [rows for _, rows in to_frame(shuffled(table, 1)).groupby("recording")]
    run = SimpleNamespace(parts=lambda _, columns: (rows.filter(columns) for rows in drives))
    listed, annotated = object_table(run, {}, most=10)
    assert annotated == len(content)
    assert [*listed.rows[OBJECT].itertuples(index=False, name=None)] == [row[2:] for row in evaluated[:10]]
    every, _ = object_table(run, {}, most=10_000)
    assert len(every.rows) == len(every.tags) == annotated


# The file.

SECTIONS = [
    "glance", "results", "splits", "recordings", "around", "threshold", "causes", "worst", "frames",
    "origin", "ledger",
]  # fmt: skip


def sections(text):
    return re.findall(r'<section id="(\w+)"><details[^>]*><summary><h2>.*?</h2></summary>', text)


def rows_of(table):
    """The rows of a table of object-frames, by heading, as text."""
    return [dict(zip(table.headings(), (cell.text for cell in row), strict=True)) for row in table.cells()]


def test_it_holds_all_sections_and_all_that_they_need(tiny_page):
    text = tiny_page.read_text()
    assert sections(text) == SECTIONS
    addresses = re.findall(r'(?:src|href|url)\s*[=(]\s*"?([^\s")>]+)', text)
    assert len(addresses) > 20
    assert all(address.startswith(("data:", "#")) for address in addresses)
    assert text.count("<script") == 1
    assert "@import" not in text
    identifiers = re.findall(r'\sid="([^"]+)"', text)
    assert len(identifiers) == len(set(identifiers))


def test_it_names_paper_data_and_method_with_its_settings_and_the_command_that_draws(tiny_page):
    text = tiny_page.read_text()
    about = re.search(r'<table class="about">.*?</table>', text, flags=re.DOTALL)[0]
    assert "Spherical formulation of geometric motion segmentation constraints in fisheye cameras" in about
    assert "(bench.methods.spherical.method:SphericalMethod); threshold = 0.0005." in about
    assert "12 images of 3 recordings" in about
    assert text.count("Left out, without cases: preceding, approaching.") == 1
    (command,) = re.findall(r"fisheye-bench view [^<]*", text)
    assert "--set threshold=0.0005" in command
    assert command.endswith("--recording RECORDING --camera CAMERA --time-ns TIME")


def test_every_recording_has_a_row_that_leads_to_its_frames(tiny_run, tiny_page):
    text = tiny_page.read_text()
    section = text[text.index('<section id="recordings">') : text.index('<section id="around">')]
    assert set(re.findall(r'href="#recording=([^"]+)">', section)) == {"crossing", "standing", "overtaking"}
    objects, _ = read_tables(tiny_run / "paper-v1")
    scored = [row for row in objects.to_pylist() if row["status"] == "evaluated" and row["recording"] == "standing"]
    tpr = sum(row["tp"] / (row["tp"] + row["fn"]) for row in scored) / len(scored)
    line = section[section.index('href="#recording=standing">') :]
    shown = [cell.strip() for cell in re.findall(r'<td[^>]* class="count ">(.*?)</td>', line, re.DOTALL)]
    assert shown[1] == f"{100 * tpr:.1f} %"
    assert shown[3] == str(len(scored))


def test_the_same_bytes_twice_and_figures_for_papers_as_vectors(tiny_run, tiny_page, tmp_path):
    files, _ = write_page(tiny_run, out=tmp_path / "again.html")
    assert files[0].read_bytes() == tiny_page.read_bytes()
    names = [f"{name}.{kind}" for name in ("range_map", "threshold_sweep") for kind in ("pdf", "png")]
    assert [file.name for file in files] == ["again.html", *names]
    assert all(file.read_bytes().startswith(b"%PDF") for file in files if file.suffix == ".pdf")


def test_every_annotated_object_is_a_row(tiny_run):
    objects, _ = read_tables(tiny_run / "paper-v1")
    table, annotated = object_table(read_run(tiny_run), {})
    assert len(table.rows) == len(table.tags) == annotated == objects.num_rows
    key = ["recording", "camera", "time (ns)", "object"]
    shown = {tuple(row[name] for name in key): row for row in rows_of(table)}
    for row in objects.to_pylist():
        found = shown[row["recording"], row["camera"], str(row["timestamp_ns"]), row["track_id"]]
        if row["status"] == "evaluated":
            assert found["TPR %"] == f"{100 * row['tp'] / (row['tp'] + row['fn']):.1f}"
            assert found["IoU %"] == f"{100 * row['tp'] / (row['tp'] + row['fn'] + row['fp']):.1f}"
        else:
            assert found["TPR %"] == found["IoU %"] == ""


def test_a_row_leads_to_its_own_box(tiny_run):
    first, *_ = read_tables(tiny_run / "paper-v1")[0].to_pylist()
    key = first["recording"], first["camera"], first["timestamp_ns"], first["track_id"]
    table, _ = object_table(read_run(tiny_run), {key: "own"})
    assert {row[0].text: row[0].link for row in table.cells() if row[0].link} == {first["track_id"]: "#own"}


def test_control_characters_are_shown_wherever_a_page_has_them():
    page = environment().from_string("<title>{{ name }}</title>{{ '<b>' | safe }}")
    assert page.render(name="a\x1b[31m\u202e<i>\nb") == "<title>a\\u001b[31m\\u202e&lt;i&gt;\nb</title><b>"


@pytest.mark.usefixtures("without_charts")
@pytest.mark.parametrize(("protocol", "times"), [("surface-v1", 2), ("paper-v1", 0)])
def test_the_core_is_explained_where_it_counts(tmp_path, protocol, times):
    (page,), _ = write_page(write_run(tmp_path / "run", drawn(50), protocol=protocol), pictures=False)
    assert page.read_text().count("Core: the part of an object&#39;s region") == times


@pytest.mark.usefixtures("without_charts")
def test_without_the_data_it_says_so_and_is_complete(tiny_run, tmp_path):
    run = shutil.copytree(tiny_run, tmp_path / "run")
    change_manifest(run, lambda content: content["dataset"].update(name="gone", card=str(tmp_path / "gone.yaml")))
    (page,), (problem,) = write_page(run)
    text = page.read_text()
    assert "gone.yaml" in problem
    assert "Pictures are missing" in text
    assert "No picture: the data set was not available." in text
    assert "<img" not in text
    assert sections(text) == SECTIONS
    assert '<article class="box" id="crossing-0">' in text


@pytest.mark.usefixtures("without_charts")
def test_a_picture_that_would_not_show_what_was_scored_is_not_drawn(tiny_run, tmp_path):
    run = shutil.copytree(tiny_run, tmp_path / "run")

    def one_more(frames: pa.Table) -> pa.Table:
        counts = pa.array([count + 1 for count in frames["fp_px"].to_pylist()])
        return frames.set_column(frames.schema.get_field_index("fp_px"), "fp_px", counts)

    change_table(run / "paper-v1", "frames", one_more)
    (page,), problems = write_page(run)
    assert "<img" not in page.read_text()
    assert all(
        "code or data changed since, so that a picture would not show what was scored" in problem
        for problem in problems
    )


@pytest.mark.usefixtures("without_charts")
def test_without_answers_there_are_no_pictures_and_the_reason_is_said(tiny_run, tmp_path):
    run = shutil.copytree(tiny_run, tmp_path / "run")
    for file in (run / "answers").rglob("*.parquet"):
        file.write_bytes(file.read_bytes()[:-50])
    assert "expected answers of a run" in str(write_page(run)[1])
    shutil.rmtree(run / "answers")
    assert "the run holds no answer" in str(write_page(run)[1])
