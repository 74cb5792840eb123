"""The page of a leaderboard in a real browser, opened from disk."""

import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select

from bench.reporting.leaderboard import read_leaderboard, write_leaderboard
from tests.reporting.compare.runs import drawn, write_run
from tests.support.browser import accessibility_faults, opened

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    runs = tmp_path_factory.mktemp("runs")
    for name, crossing, preceding in (("one", 80, 10), ("two", 30, 60), ("<three>", 20, 20)):
        px = {key: crossing if key[2] == "crossing" else preceding for key in drawn(1)}
        for protocol in ("surface-v1", "paper-v1"):
            write_run(runs / f"{name.strip('<>')}-{protocol}", px, protocol=protocol, method=name)
    write_leaderboard(read_leaderboard(runs), runs / "board")
    return runs / "board" / "index.html"


TABLE = "#table .group:not([hidden]) table"


def methods(page):
    rows = f"document.querySelector('{TABLE}').querySelectorAll('tbody tr:not([hidden])')"
    return page.execute_script(f"return [...{rows}].map(row => row.cells[1].innerText.split(/\\s/)[0])")


@pytest.mark.parametrize("width", [1280, 390])
def test_it_sorts_and_filters_and_fits_the_screen(browser, board, width):
    page = opened(browser, board, width=width)
    assert page.get_log("browser") == []
    assert page.execute_script("return document.documentElement.scrollWidth <= innerWidth"), "no scrolling sideways"
    assert methods(page) == ["one", "two", "<three>"]
    shown = "return [...document.querySelectorAll('#table h3')].filter(h => h.offsetParent).map(h => h.textContent)"
    (title,) = page.execute_script(shown)
    assert "surface-v1" in title
    page.execute_script("document.querySelector(arguments[0]).querySelectorAll('thead button')[1].click()", TABLE)
    assert methods(page) == ["<three>", "one", "two"]
    Select(page.find_element(By.CSS_SELECTOR, "[data-filter=protocol]")).select_by_visible_text("paper-v1")
    (title,) = page.execute_script(shown)
    assert "paper-v1" in title


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_and_no_column_runs_off(browser, board, width, scheme):
    page = opened(browser, board, width=width, scheme=scheme)
    assert accessibility_faults(page) == []
    page.execute_script("for (const part of document.querySelectorAll('details')) part.open = true")
    wide = "return [...document.querySelectorAll('.scroll')].filter(s => s.scrollWidth > s.clientWidth).length"
    assert page.execute_script(wide) == 0
