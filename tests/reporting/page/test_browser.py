"""All pages in a real browser, opened from disk: accessibility, widths, sorting, filters, pictures, long tables."""

from dataclasses import replace

import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select, WebDriverWait

from bench.reporting.compare import compare_runs, frame_title
from bench.reporting.compare import report as report_comparison
from bench.reporting.document import Choice, Filters, Picture, Table, to_page
from bench.reporting.leaderboard import read_leaderboard, write_leaderboard
from tests.reporting.compare.runs import drawn, write_run
from tests.reporting.test_findings import written
from tests.support.browser import accessibility_faults, opened

pytestmark = pytest.mark.slow

PIXEL = (
    "data:image/png;base64,"
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)
NOT_LOADED = "return [...document.images].filter(i => !i.complete || i.naturalWidth === 0).map(i => i.alt)"
WIDE = "return [...document.querySelectorAll('.scroll')].filter(s => s.scrollWidth > s.clientWidth).length"
SHOWN = "return document.querySelectorAll('tbody tr:not([hidden]):not(.beyond)').length"
ROWS = "#frames tbody tr:not([hidden]):not(.beyond)"


@pytest.fixture(scope="session")
def board(tmp_path_factory):
    runs = tmp_path_factory.mktemp("runs")
    for name, crossing, preceding in (("one", 80, 10), ("two", 30, 60), ("<three>", 20, 20)):
        px = {key: crossing if key[2] == "crossing" else preceding for key in drawn(1)}
        for protocol in ("surface-v1", "paper-v1"):
            write_run(runs / f"{name.strip('<>')}-{protocol}", px, protocol=protocol, method=name)
    return write_leaderboard(read_leaderboard(runs), runs / "board")[0]


@pytest.fixture(scope="session")
def comparison(tmp_path_factory):
    """Crossing objects lost in drives 0 to 6 and gained in drive 7, preceding ones worse, one picture of each kind."""
    folder = tmp_path_factory.mktemp("page")
    after = {key: 90 if key[0] == 7 else 0 if key[1] == 1 else 20 + key[0] for key in drawn(50)}
    runs = [write_run(folder / "old", drawn(50)), write_run(folder / "<new>", after, fp_px=0)]
    (compared,) = compare_runs(runs)
    titles = map(frame_title, compared.frames.groupby("kind", sort=False).head(1).to_dict("records"))
    compared = replace(compared, pictures=tuple(Picture(PIXEL, title, title) for title in titles))
    return report_comparison([compared], out=folder).write(folder, "compare")[0]


@pytest.fixture(scope="session")
def proposals(tmp_path_factory):
    return written(tmp_path_factory.mktemp("proposals"))[0]


@pytest.fixture
def page(browser, tiny_page):
    return opened(browser, tiny_page)


def press(browser, element):
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
    element.click()


def press_heading(page, name):
    press(page, page.find_element(By.XPATH, f"//section[@id='frames']//thead//th[.='{name}']/button"))


def choose(page, name, text):
    Select(page.find_element(By.CSS_SELECTOR, f"[data-filter={name}]")).select_by_visible_text(text)


def column(page, name):
    """Texts of a column of the table of object-frames, as far as it is shown."""
    headings = page.execute_script("return [...document.querySelectorAll('#frames thead th')].map(h => h.textContent)")
    rows = f"[...document.querySelectorAll('{ROWS}')]"
    return page.execute_script(f"return {rows}.map(r => r.cells[{headings.index(name)}].textContent.trim())")


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("name", ["tiny_page", "board", "comparison", "proposals"])
def test_axe_finds_nothing_and_nothing_runs_off(browser, request, name, width, scheme):
    page = opened(browser, request.getfixturevalue(name), width=width, scheme=scheme)
    assert page.get_log("browser") == []
    assert page.execute_script("return document.documentElement.scrollWidth <= innerWidth"), "no scrolling sideways"
    page.execute_script("for (const part of document.querySelectorAll('.part')) part.open = true")
    assert accessibility_faults(page) == []
    page.execute_script("for (const part of document.querySelectorAll('details')) part.open = true")
    if width < 500:
        assert page.execute_script(WIDE) == 0


def test_the_page_of_a_run_on_a_laptop(page):
    assert len(page.find_elements(By.CSS_SELECTOR, ".box img")) >= 9
    assert page.execute_script(NOT_LOADED) == []
    assert page.execute_script("return document.querySelectorAll('svg.chart').length") == 2
    assert page.find_elements(By.CSS_SELECTOR, ".part:not([open])") == []
    table = "document.querySelector('#results .scroll')"
    assert page.execute_script(f"return {table}.scrollWidth <= {table}.clientWidth"), "the main table fits"


def test_sections_fold_on_a_phone_and_a_link_opens_its_section(browser, tiny_page):
    page = opened(browser, tiny_page, width=390)
    assert page.execute_script("return document.documentElement.scrollHeight") < 5000
    (first,) = page.find_elements(By.CSS_SELECTOR, ".part[open]")
    assert "At a glance" in first.text
    press(page, page.find_element(By.CSS_SELECTOR, "nav a[href='#results']"))
    WebDriverWait(page, 10).until(lambda page: len(page.find_elements(By.CSS_SELECTOR, ".part[open]")) == 2)
    _, part = page.find_elements(By.CSS_SELECTOR, ".part[open]")
    assert part.find_element(By.CSS_SELECTOR, "caption").is_displayed()
    named = "return getComputedStyle(document.querySelector('#results td'), '::before').content"
    assert page.execute_script(named) == '"Recs"', "each value stands below its heading"


@pytest.mark.parametrize("width", [1280, 390])
def test_pictures_stand_within_the_first_two_screens_and_verdicts_first(browser, tiny_page, comparison, width):
    def top(selector):
        return page.find_element(By.CSS_SELECTOR, selector).rect["y"]

    page = opened(browser, tiny_page, width=width)
    assert top("figure img") < 2 * 900
    page = opened(browser, comparison, width=width)
    assert top(".tiles") < 900 * 0.6
    assert top(".tiles") < top("figure img") < min(top("table:not(.tiles, .about)"), 2 * 900)


def test_sorting_by_a_heading_goes_both_ways_and_empty_cells_come_last(page):
    def order():
        return page.find_element(By.XPATH, "//section[@id='frames']//thead//th[.='range (m)']").get_attribute(
            "aria-sort"
        )

    before = [float(text) for text in column(page, "TPR %")]
    assert before == sorted(before)
    press_heading(page, "range (m)")
    near_first = [float(text) for text in column(page, "range (m)")]
    assert (near_first, order()) == (sorted(near_first), "ascending")
    press_heading(page, "range (m)")
    assert ([float(text) for text in column(page, "range (m)")], order()) == (near_first[::-1], "descending")
    press_heading(page, "recording")
    assert order() == "none"
    assert column(page, "recording") == sorted(column(page, "recording"))
    choose(page, "outcome", "any")
    for _ in range(2):
        press_heading(page, "TPR %")
        filled = [text != "" for text in column(page, "TPR %")]
        assert False in filled
        assert filled == sorted(filled, reverse=True)


def test_recordings_words_and_choices_filter_the_rows(page):
    search = page.find_element(By.CSS_SELECTOR, "#filters input")
    every = len(column(page, "recording"))
    search.send_keys("OVERtaking vehicle")
    assert set(column(page, "recording")) == {"overtaking"}
    shown = len(column(page, "recording"))
    assert 0 < shown < every
    assert page.find_element(By.CSS_SELECTOR, "#filters output").text == f"{shown} of 16 rows"
    search.clear()
    search.send_keys("nothing is called so")
    assert column(page, "recording") == []
    search.clear()
    search.send_keys(" ")
    choose(page, "kind", "crossing")
    assert set(column(page, "kind")) == {"crossing"}
    choose(page, "kind", "any")
    press(page, page.find_element(By.ID, "recordings").find_element(By.LINK_TEXT, "standing"))
    assert set(column(page, "recording")) == {"standing"}


def test_an_object_leads_to_its_pictures_and_a_picture_enlarges(page):
    link = next(a for a in page.find_elements(By.CSS_SELECTOR, f"{ROWS} th a"))
    press(page, link)
    box = page.find_element(By.CSS_SELECTOR, link.get_attribute("href").partition("#")[2].join(["#", ""]))
    assert len(box.find_elements(By.TAG_NAME, "img")) == 2, "areas, panels"
    press(page, box.find_element(By.TAG_NAME, "img"))
    viewer = page.find_element(By.ID, "viewer")
    assert viewer.is_displayed()
    assert viewer.find_element(By.ID, "viewer-title").text.startswith("Camera image of ")
    assert page.execute_script(NOT_LOADED) == []
    viewer.find_element(By.CSS_SELECTOR, "button").click()
    assert not viewer.is_displayed()


def test_it_prints(page):
    printed = page.execute_cdp_cmd("Page.printToPDF", {"printBackground": True})
    assert len(printed["data"]) > 100_000
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    for selector in ("nav", "#filters"):
        assert not page.find_element(By.CSS_SELECTOR, selector).is_displayed()
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


def test_a_leaderboard_sorts_and_shows_one_protocol(browser, board):
    page = opened(browser, board)
    table = "#table .group:not([hidden]) table"
    rows = f"[...document.querySelector('{table}').querySelectorAll('tbody tr:not([hidden])')]"
    methods = f"return {rows}.map(row => row.cells[1].innerText.split(/\\s/)[0])"
    shown = "return [...document.querySelectorAll('#table h3')].filter(h => h.offsetParent).map(h => h.textContent)"
    (title,) = page.execute_script(shown)
    assert "surface-v1" in title
    assert page.execute_script(methods) == ["one", "two", "<three>"]
    page.execute_script("document.querySelector(arguments[0]).querySelectorAll('thead button')[1].click()", table)
    assert page.execute_script(methods) == ["<three>", "one", "two"]
    choose(page, "protocol", "paper-v1")
    (title,) = page.execute_script(shown)
    assert "paper-v1" in title


def test_names_are_no_markup_and_long_tables_show_more_on_demand(browser, tmp_path):
    name = '"><img src=x onerror=alert(1)>'
    named = Table(columns=["Recording"], rows=[[name], ["other"]], tags=[{"recording": name}, {"recording": "other"}])
    pages = {"named": [Filters([Choice("recording", "Recording")]), named],
             "long": [Table(columns=["n", "square"], rows=[[n, n * n] for n in range(120)])]}  # fmt: skip
    for file, blocks in pages.items():
        (tmp_path / f"{file}.html").write_text(to_page("a", blocks))
    page = opened(browser, tmp_path / "named.html")
    assert page.find_elements(By.TAG_NAME, "img") == []
    choose(page, "recording", name)
    assert page.execute_script(SHOWN) == 1
    page = opened(browser, tmp_path / "long.html")
    assert page.execute_script(SHOWN) == 50
    page.find_element(By.CSS_SELECTOR, ".more").click()
    assert page.execute_script(SHOWN) == 120
    assert page.find_elements(By.CSS_SELECTOR, ".more") == []
