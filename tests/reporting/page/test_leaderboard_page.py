"""The page of a leaderboard in a real browser, opened from disk."""

import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select

from bench.reporting.leaderboard.page import write_leaderboard
from bench.reporting.leaderboard.reading import read_leaderboard
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


def methods(page):
    return [cell.text for cell in page.find_elements(By.CSS_SELECTOR, "#board tbody th")]


@pytest.mark.parametrize("width", [1280, 390])
def test_it_sorts_and_filters_and_fits_the_screen(browser, board, width):
    page = opened(browser, board, width=width)
    assert page.get_log("browser") == []
    assert page.execute_script("return document.documentElement.scrollWidth <= innerWidth"), "no scrolling sideways"
    assert methods(page) == ["one", "two", "<three>"]
    Select(page.find_element(By.ID, "row")).select_by_visible_text("Preceding")
    assert methods(page) == ["two", "<three>", "one"]
    first = page.find_element(By.CSS_SELECTOR, "#board thead button")
    page.execute_script("arguments[0].click()", first)
    assert methods(page) == ["<three>", "one", "two"]
    Select(page.find_element(By.ID, "protocol")).select_by_visible_text("paper-v1")
    assert "carried along" in page.find_element(By.ID, "about").text


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_and_no_column_runs_off(browser, board, width, scheme):
    page = opened(browser, board, width=width, scheme=scheme)
    assert accessibility_faults(page) == []
    assert page.execute_script("return (s => s.scrollWidth <= s.clientWidth)(document.querySelector('#table .scroll'))")
