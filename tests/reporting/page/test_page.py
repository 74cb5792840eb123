"""The page as a file."""

import re
import shutil

import pyarrow as pa
import pytest

from bench.harness import read_run, read_tables
from bench.reporting.document import environment
from bench.reporting.figures import write_figures
from bench.reporting.run_page import object_table, write_page
from tests.support.counts import change_table
from tests.support.stored_files import change_manifest

SECTIONS = [
    "glance", "results", "splits", "recordings", "around", "threshold", "causes", "worst", "frames",
    "origin", "ledger",
]  # fmt: skip


def sections(text):
    head = r"(?:<details[^>]*><summary>)?<h2>.*?</h2>(?: <span.*?</span>)?(?:</summary>)?"
    return re.findall(rf'<section id="(\w+)">{head}', text)


def rows_of(table):
    """The rows of a table of object-frames, by heading, as text."""
    names = [cell.text for cell in table.headings()]
    return [dict(zip(names, (cell.text for cell in row), strict=True)) for row in table.cells()]


def test_the_sections_are_all_there(tiny_page):
    assert sections(tiny_page.read_text()) == SECTIONS


def test_it_holds_everything_itself(tiny_page):
    text = tiny_page.read_text()
    addresses = re.findall(r'(?:src|href|url)\s*[=(]\s*"?([^\s")>]+)', text)
    assert len(addresses) > 20
    assert all(address.startswith(("data:", "#")) for address in addresses)
    assert text.count("<script") == 1
    assert "@import" not in text


def test_it_names_paper_data_and_method_with_its_settings(tiny_page):
    about = re.search(r'<table class="about">.*?</table>', tiny_page.read_text(), flags=re.DOTALL)[0]
    assert "Spherical formulation of geometric motion segmentation constraints in fisheye cameras" in about
    assert "(bench.methods.spherical.method:SphericalMethod); threshold = 0.0005." in about
    assert "12 images of 3 recordings" in about


def test_every_recording_has_a_row_that_leads_to_its_frames(tiny_run, tiny_page):
    text = tiny_page.read_text()
    section = text[text.index('<section id="recordings">') : text.index('<section id="around">')]
    assert set(re.findall(r'href="#recording=([^"]+)">', section)) == {
        "crossing",
        "standing",
        "overtaking",
    }
    objects, _ = read_tables(tiny_run / "paper-v1")
    scored = [row for row in objects.to_pylist() if row["status"] == "evaluated" and row["recording"] == "standing"]
    tpr = sum(row["tp"] / (row["tp"] + row["fn"]) for row in scored) / len(scored)
    line = section[section.index('href="#recording=standing">') :]
    shown = [cell.strip() for cell in re.findall(r'<td[^>]* class="count ">(.*?)</td>', line, re.DOTALL)]
    assert shown[1] == f"{100 * tpr:.1f} %"
    assert shown[3] == str(len(scored))


def test_identifiers_are_used_once(tiny_page):
    found = re.findall(r'\sid="([^"]+)"', tiny_page.read_text())
    assert len(found) == len(set(found))


def test_the_same_bytes_twice(tiny_run, tiny_page, tmp_path):
    again = write_page(tiny_run, out=tmp_path / "again.html").file
    assert again.read_bytes() == tiny_page.read_bytes()


@pytest.mark.slow
def test_figures_for_papers_are_vectors(tiny_run):
    files = {file.name: file.read_bytes() for file in write_figures(tiny_run)}
    names = ("range_map", "threshold_sweep")
    assert set(files) == {f"{name}.{kind}" for name in names for kind in ("pdf", "png")}
    assert all(content.startswith(b"%PDF") for name, content in files.items() if name.endswith(".pdf"))


def test_every_annotated_object_is_a_row_the_least_covered_first(tiny_run):
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
    covered = [float(row["TPR %"]) for row in rows_of(table) if row["TPR %"]]
    assert covered == sorted(covered)


def test_a_row_leads_to_its_own_box(tiny_run):
    first, *_ = read_tables(tiny_run / "paper-v1")[0].to_pylist()
    key = first["recording"], first["camera"], first["timestamp_ns"], first["track_id"]
    table, _ = object_table(read_run(tiny_run), {key: "own"})
    assert {row[0].text: row[0].link for row in table.cells() if row[0].link} == {first["track_id"]: "#own"}


def test_control_characters_are_shown_wherever_a_page_has_them():
    page = environment().from_string("<title>{{ name }}</title>{{ '<b>' | safe }}")
    assert page.render(name="a\x1b[31m\u202e<i>\nb") == "<title>a\\u001b[31m\\u202e&lt;i&gt;\nb</title><b>"


@pytest.mark.usefixtures("without_charts")
def test_without_the_data_it_says_so_and_is_complete(tiny_run, tmp_path):
    run = shutil.copytree(tiny_run, tmp_path / "run")
    change_manifest(run, lambda content: content["dataset"].update(name="gone", card=str(tmp_path / "gone.yaml")))
    page = write_page(run)
    text = page.file.read_text()
    assert len(page.problems) == 1
    assert "gone.yaml" in page.problems[0]
    assert "Pictures are missing" in text
    assert "No picture: the data set was not available." in text
    assert "<img" not in text
    assert sections(text) == SECTIONS
    assert '<article class="box" id="crossing-0">' in text


@pytest.mark.usefixtures("without_charts")
def test_pictures_show_what_was_scored_and_call_no_method(tiny_run, tmp_path, monkeypatch):
    run = shutil.copytree(tiny_run, tmp_path / "run")
    trap = {"name": "my-own", "place": "subprocess:Popen", "settings": {"args": ["touch", str(tmp_path / "p")]}}
    change_manifest(run, lambda content: content["method"].update(trap))
    text = write_page(run).file.read_text()
    assert "<img" in text
    assert not (tmp_path / "p").exists()


@pytest.mark.usefixtures("without_charts")
def test_a_picture_that_would_not_show_what_was_scored_is_not_drawn(tiny_run, tmp_path):
    run = shutil.copytree(tiny_run, tmp_path / "run")

    def one_more(frames: pa.Table) -> pa.Table:
        counts = pa.array([count + 1 for count in frames["fp_px"].to_pylist()])
        return frames.set_column(frames.schema.get_field_index("fp_px"), "fp_px", counts)

    change_table(run / "paper-v1", "frames", one_more)
    page = write_page(run)
    assert "<img" not in page.file.read_text()
    assert all("code or data changed since" in problem for problem in page.problems)


@pytest.mark.usefixtures("without_charts")
def test_without_answers_there_are_no_pictures_and_the_reason_is_said(tiny_run, tmp_path):
    run = shutil.copytree(tiny_run, tmp_path / "run")
    for file in (run / "answers").rglob("*.parquet"):
        file.write_bytes(file.read_bytes()[:-50])
    assert "expected answers of a run" in str(write_page(run).problems)
    shutil.rmtree(run / "answers")
    assert "the run holds no answer" in str(write_page(run).problems)


def test_the_main_table_has_rows_with_cases_alone_and_names_the_others(tiny_page):
    text = tiny_page.read_text()
    section = text[text.index('<section id="results">') : text.index('<section id="splits">')]
    labels = re.findall(r'<th scope="row">\s*([^<]*?)\s*<', section[: section.index("</table>")])
    assert labels == ["Crossing", "Overtaking", "Static ego-vehicle", "All moving", "False positives"]
    assert section.count("Left out, without cases: preceding, approaching.") == 1
