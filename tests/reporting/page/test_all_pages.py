"""All pages in a real browser, opened from disk: accessibility, widths, filters, long tables."""

import base64

import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select

from bench.reporting.compare import compare_runs, read_comparable
from bench.reporting.compare import report as report_comparison
from bench.reporting.document import Choice, Filters, Table, to_page
from bench.reporting.leaderboard import read_leaderboard, write_leaderboard
from tests.reporting.compare.runs import drawn, write_run
from tests.reporting.test_findings import written
from tests.support.browser import accessibility_faults, opened

pytestmark = pytest.mark.slow
PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)
WIDE = "return [...document.querySelectorAll('.scroll')].filter(s => s.scrollWidth > s.clientWidth).length"
SHOWN = "return document.querySelectorAll('tbody tr:not([hidden]):not(.beyond)').length"


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
    (compared,) = compare_runs(read_comparable(runs))
    (folder / "pictures").mkdir()
    for number, frame in enumerate(compared.frames.groupby("kind", sort=False).head(1).to_dict("records")):
        (folder / "pictures" / f"{number}.png").write_bytes(PIXEL)
        compared.pictures[f"{number}.png"] = frame
    return report_comparison([compared], out=folder).write(folder, "compare")[0]


@pytest.fixture(scope="session")
def proposals(tmp_path_factory):
    return written(tmp_path_factory.mktemp("proposals"))[0]


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


def choose(page, name, text):
    Select(page.find_element(By.CSS_SELECTOR, f"[data-filter={name}]")).select_by_visible_text(text)


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


def test_the_verdict_comes_first_and_pictures_within_the_first_screens(browser, comparison):
    for width in (1280, 390):
        page = opened(browser, comparison, width=width)
        tiles, picture, table = (
            page.find_element(By.CSS_SELECTOR, selector).rect["y"]
            for selector in (".tiles", "figure img", "table:not(.tiles, .about)")
        )
        assert tiles < 900 * 0.6
        assert tiles < picture < table
        assert picture < 2 * 900


def test_names_of_recordings_are_no_markup(browser, tmp_path):
    name = '"><img src=x onerror=alert(1)>'
    table = Table(columns=["Recording"], rows=[[name], ["other"]], tags=[{"recording": name}, {"recording": "other"}])
    filters = Filters([Choice("recording", "Recording")])
    (tmp_path / "a.html").write_text(to_page("a", [filters, table], folder=tmp_path))
    page = opened(browser, tmp_path / "a.html")
    assert page.find_elements(By.TAG_NAME, "img") == []
    choose(page, "recording", name)
    assert page.execute_script(SHOWN) == 1


def test_long_tables_show_more_on_demand(browser, tmp_path):
    table = Table(columns=["n", "square"], rows=[[n, n * n] for n in range(120)])
    (tmp_path / "a.html").write_text(to_page("a", [table], folder=tmp_path))
    page = opened(browser, tmp_path / "a.html")
    assert page.execute_script(SHOWN) == 50
    page.find_element(By.CSS_SELECTOR, ".more").click()
    assert page.execute_script(SHOWN) == 120
    assert page.find_elements(By.CSS_SELECTOR, ".more") == []
