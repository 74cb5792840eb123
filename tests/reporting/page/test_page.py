"""The page as a file."""

import re
import shutil

import pyarrow as pa
import pytest

from bench.errors import DataError
from bench.harness import read_run, read_tables
from bench.recordings import load_card, open_dataset
from bench.reference import Category
from bench.reporting.charts import write_figures
from bench.reporting.document import environment
from bench.reporting.object_table import object_table
from bench.reporting.run_page import write_page
from tests.support.counts import change_table
from tests.support.stored_files import change_manifest

SECTIONS = [
    "glance", "results", "splits", "recordings", "around", "plane", "coverage", "threshold", "causes", "worst",
    "frames", "origin", "ledger",
]  # fmt: skip
OF_FRAMES = {"plane", "threshold", "causes"}


def sections(text):
    head = r"(?:<details[^>]*><summary>)?<h2>.*?</h2>(?: <span.*?</span>)?(?:</summary>)?"
    return re.findall(rf'<section id="(\w+)">{head}\s*(<\w+)', text)


def rows_of(table):
    """The rows of a table of object-frames, by heading, as text."""
    names = [cell.text for cell in table.headings()]
    return [dict(zip(names, (cell.text for cell in row), strict=True)) for row in table.cells()]


def test_every_section_opens_with_a_sentence(tiny_page):
    assert sections(tiny_page.read_text()) == [(name, "<p") for name in SECTIONS]


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
    assert "settings: threshold = 0.0005." in about
    assert "12 images of 3 recordings" in about


def test_every_recording_has_a_row_that_leads_to_its_frames_and_its_worst_case(tiny_run, tiny_page):
    text = tiny_page.read_text()
    section = text[text.index('<section id="recordings">') : text.index('<section id="around">')]
    assert set(re.findall(r'href="#recording=([^"]+)">', section)) == {
        "crossing",
        "standing",
        "overtaking",
    }
    worst = re.findall(r'href="#([^"]+)">worst case', section)
    assert len(worst) == 3
    assert all(f'id="{element}"' in text for element in worst)
    objects, _ = read_tables(tiny_run / "paper-v1")
    scored = [row for row in objects.to_pylist() if row["status"] == "evaluated" and row["recording"] == "standing"]
    tpr = sum(row["tp"] / (row["tp"] + row["fn"]) for row in scored) / len(scored)
    line = section[section.index('href="#recording=standing">') :]
    shown = [cell.strip() for cell in re.findall(r'<td[^>]* class="count ">(.*?)</td>', line, re.DOTALL)]
    assert shown[1] == f"{100 * tpr:.1f} %"
    assert shown[3] == str(len(scored))


@pytest.mark.usefixtures("without_charts")
def test_two_runs_stand_side_by_side_on_the_same_images(tiny_run, tmp_path):
    other = shutil.copytree(tiny_run, tmp_path / "other")
    page = write_page(tiny_run, category=Category.CROSSING, other=other, out=tmp_path / "pair.html")
    assert page.problems == ()
    section = re.search(r'<section id="beside">.*?</section>', page.file.read_text(), flags=re.DOTALL)[0]
    assert "on the 12 images that both scored" in section
    assert "other" in section
    titles = re.findall(r"<figcaption>(.*?)</figcaption>", section)
    assert 1 <= len(titles) <= 3
    assert all(title.startswith("Crossing, ") and ", camera front, " in title for title in titles)
    assert section.count("data:image/jpeg") == len(titles)


def test_identifiers_are_used_once(tiny_page):
    found = re.findall(r'\sid="([^"]+)"', tiny_page.read_text())
    assert len(found) == len(set(found))


def test_the_same_bytes_twice(tiny_run, tmp_path):
    files = [write_page(tiny_run, category=Category.CROSSING, out=tmp_path / name).file for name in ("a", "b")]
    assert b"data:image/jpeg" in files[0].read_bytes()
    assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.slow
def test_figures_for_papers_are_vectors_and_the_same_twice(tiny_run):
    files = {file.name: file.read_bytes() for file in write_figures(tiny_run)}
    made = {name: content for name, content in files.items() if name.endswith(".pdf")}
    assert set(files) == {name.removesuffix("pdf") + kind for name in made for kind in ("pdf", "svg")}
    kinds = {f"coverage-{kind}.pdf" for kind in ("crossing", "overtaking", "static_ego")}
    of_frames = {"threshold_sweep.pdf", "precision_recall.pdf", "missed-0.pdf", "false-0.pdf"}
    assert set(made) == {"range_map.pdf"} | kinds | of_frames
    assert all(content.startswith(b"%PDF") for content in made.values())
    again = write_figures(tiny_run, category=Category.CROSSING)
    names = [file.name for file in again if file.suffix == ".pdf"]
    assert names == ["range_map-crossing.pdf", "coverage-crossing.pdf"]
    assert again[2].read_bytes() == made["coverage-crossing.pdf"]


def test_every_annotated_object_is_a_row_the_least_covered_first(tiny_run):
    objects, _ = read_tables(tiny_run / "paper-v1")
    table, annotated = object_table(read_run(tiny_run), pictured={})
    assert len(table.rows) == len(table.tags) == annotated == objects.num_rows
    key = ["recording", "camera", "time (s)", "object"]
    shown = {tuple(row[name] for name in key): row for row in rows_of(table)}
    for row in objects.to_pylist():
        time_s = f"{row['timestamp_ns'] / 1e9:.2f}"
        found = shown[row["recording"], row["camera"], time_s, row["track_id"]]
        if row["status"] == "evaluated":
            assert found["TPR %"] == f"{100 * row['tp'] / (row['tp'] + row['fn']):.1f}"
            assert found["IoU %"] == f"{100 * row['tp'] / (row['tp'] + row['fn'] + row['fp']):.1f}"
        else:
            assert found["TPR %"] == found["IoU %"] == ""
    covered = [float(row["TPR %"]) for row in rows_of(table) if row["TPR %"]]
    assert covered == sorted(covered)


def test_a_row_leads_to_its_own_card_or_that_of_its_image(tiny_run):
    source = read_run(tiny_run)
    one, other = read_tables(tiny_run / "paper-v1")[0].to_pylist()[:2]
    keys = [(row["recording"], row["camera"], row["timestamp_ns"]) for row in (one, other)]
    assert keys[0] == keys[1], "two objects of one image"
    pictured = {(*keys[0], ""): "first", (*keys[0], other["track_id"]): "own"}
    table, _ = object_table(source, pictured=pictured)
    found = {row[0].text: row[0].link for row in table.cells() if row[0].link}
    assert found == {one["track_id"]: "#first", other["track_id"]: "#own"}


def test_the_index_of_a_row_is_that_of_its_image(tiny_run, tiny_card):
    images = {handle.name: handle.open().images["front"] for handle in open_dataset(load_card(tiny_card))}
    for row in rows_of(object_table(read_run(tiny_run), pictured={})[0]):
        time_s = images[row["recording"]][int(row["image"])].timestamp_ns / 1e9
        assert f"{time_s:.2f}" == row["time (s)"]


def test_control_characters_are_shown_wherever_a_page_has_them():
    page = environment().from_string("<title>{{ name }}</title>{{ '<b>' | safe }}")
    assert page.render(name="a\x1b[31m\u202e<i>\nb") == "<title>a\\u001b[31m\\u202e&lt;i&gt;\nb</title><b>"


def test_names_from_the_data_are_escaped(hostile_page):
    text = hostile_page.read_text()
    assert "<script>window.broken" not in text
    assert "<img src=x" not in text
    assert "&lt;b&gt;one &amp; all&lt;/b&gt;" in text


@pytest.mark.usefixtures("without_charts")
def test_without_the_data_it_says_so_and_is_complete(tiny_run, tmp_path):
    run = shutil.copytree(tiny_run, tmp_path / "run")
    change_manifest(run, lambda content: content["dataset"].update(card=str(tmp_path / "gone.yaml")))
    page = write_page(run)
    text = page.file.read_text()
    assert len(page.problems) == 1
    assert "gone.yaml" in page.problems[0]
    assert "Pictures are missing" in text
    assert "No picture: the data set was not available." in text
    assert "<img" not in text
    assert [name for name, _ in sections(text)] == SECTIONS
    assert re.search(r'<p class="footnote">found \d+ %, range \d', text)


@pytest.mark.usefixtures("without_charts")
def test_a_run_without_maps_of_the_image_plane_still_makes_a_page(tiny_run, tmp_path):
    run = shutil.copytree(tiny_run, tmp_path / "run")
    for file in run.rglob("*.map.npz"):
        file.unlink()
    text = write_page(run, pictures=False).file.read_text()
    assert "holds no maps of the image plane" in text
    assert [name for name, _ in sections(text)] == SECTIONS


@pytest.mark.usefixtures("without_charts")
def test_pictures_show_what_was_scored_and_call_no_method(tiny_run, tmp_path, monkeypatch):
    run = shutil.copytree(tiny_run, tmp_path / "run")
    trap = {"name": "my-own", "place": "subprocess:Popen", "settings": {"args": ["touch", str(tmp_path / "p")]}}
    change_manifest(run, lambda content: content["method"].update(trap))
    text = write_page(run, category=Category.CROSSING).file.read_text()
    assert "<img" in text
    assert not (tmp_path / "p").exists()


@pytest.mark.usefixtures("without_charts")
def test_a_picture_that_would_not_show_what_was_scored_is_not_drawn(tiny_run, tmp_path):
    run = shutil.copytree(tiny_run, tmp_path / "run")

    def one_more(frames: pa.Table) -> pa.Table:
        counts = pa.array([count + 1 for count in frames["fp_px"].to_pylist()])
        return frames.set_column(frames.schema.get_field_index("fp_px"), "fp_px", counts)

    change_table(run / "paper-v1", "frames", one_more)
    page = write_page(run, category=Category.CROSSING)
    assert "<img" not in page.file.read_text()
    assert all("code or data changed since" in problem for problem in page.problems)


@pytest.mark.usefixtures("without_charts")
def test_without_answers_there_are_no_pictures_and_the_reason_is_said(tiny_run, tmp_path):
    run = shutil.copytree(tiny_run, tmp_path / "run")
    for file in (run / "answers").rglob("*.parquet"):
        file.write_bytes(file.read_bytes()[:-50])
    assert "expected answers of a run" in str(write_page(run, category=Category.CROSSING).problems)
    shutil.rmtree(run / "answers")
    assert "the run holds no answer" in str(write_page(run, category=Category.CROSSING).problems)


@pytest.mark.usefixtures("without_charts")
def test_a_page_of_one_kind_has_only_its_rows(tiny_run):
    page = write_page(tiny_run, category=Category.OVERTAKING)
    text = page.file.read_text()
    assert page.file.name == "index-overtaking.html"
    assert [name for name, _ in sections(text)] == [name for name in SECTIONS if name not in OF_FRAMES]
    assert set(re.findall(r' data-kind="([^"]*)"', text)) == {"overtaking"}
    assert "<small>(positive depth)</small>" in text
    assert "(epipolar)" not in text
    assert 'id="worst-overtaking-0"' in text


@pytest.mark.usefixtures("without_charts")
def test_a_kind_without_cases_is_no_error(tiny_run, tmp_path):
    text = write_page(tiny_run, category=Category.PRECEDING, out=tmp_path / "page.html").file.read_text()
    assert "No object-frame of this kind was evaluated." in text
    assert "<small>(0 cases)</small>" in text
    assert "Left out, without cases: preceding." in text


def test_the_main_table_has_rows_with_cases_alone_and_names_the_others(tiny_page):
    text = tiny_page.read_text()
    section = text[text.index('<section id="results">') : text.index('<section id="splits">')]
    labels = re.findall(r'<th scope="row">\s*([^<]*?)\s*<', section[: section.index("</table>")])
    assert labels == ["Crossing", "Overtaking", "Static ego-vehicle", "All moving", "False positives"]
    assert section.count("Left out, without cases: preceding, approaching.") == 1


def test_a_folder_without_a_run_is_named(tmp_path):
    with pytest.raises(DataError, match=r"summary\.json"):
        write_page(tmp_path)
