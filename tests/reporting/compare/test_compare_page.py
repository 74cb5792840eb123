"""The page of a comparison in a real browser, opened from disk."""

import base64

import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select

from bench.reporting.compare import compare_runs, read_comparable, report
from bench.reporting.document import Choice, Filters, Table, to_page
from tests.reporting.compare.runs import drawn, write_run
from tests.support.browser import accessibility_faults, headless_chromium, opened

pytestmark = pytest.mark.slow
PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)
TAGGED = "return [...document.querySelectorAll('tr, figure')].filter(e => e.dataset.recording && !e.hidden)"

WIDE = "return [...document.querySelectorAll('.scroll')].filter(s => s.scrollWidth > s.clientWidth).length"
TABLES = "return [...document.querySelectorAll('.scroll:not([hidden])')].length"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    opened = headless_chromium(tmp_path_factory.mktemp("chromium"))
    yield opened
    opened.quit()


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Crossing objects lost in drives 0 to 6 and gained in drive 7, preceding ones worse, one picture of each kind."""
    folder = tmp_path_factory.mktemp("page")
    after = {key: 90 if key[0] == 7 else 0 if key[1] == 1 else 20 + key[0] for key in drawn(50)}
    runs = [write_run(folder / "old", drawn(50)), write_run(folder / "<new>", after, fp_px=0)]
    (comparison,) = compare_runs(read_comparable(runs))
    (folder / "pictures").mkdir()
    for number, frame in enumerate(comparison.frames.groupby("kind", sort=False).head(1).to_dict("records")):
        (folder / "pictures" / f"{number}.png").write_bytes(PIXEL)
        comparison.pictures[f"{number}.png"] = frame
    report([comparison], out=folder).write(folder, "compare")
    return folder / "compare.html"


def choose(browser, name, text):
    Select(browser.find_element(By.CSS_SELECTOR, f"[data-filter={name}]")).select_by_visible_text(text)


def shown(browser, attribute):
    return set(browser.execute_script(f"{TAGGED}.map(e => e.dataset.{attribute})"))


@pytest.mark.parametrize("width", [1280, 390])
def test_filters_hide_what_does_not_fit_and_clear_shows_it_again(browser, page, width):
    opened(browser, page, width=width)
    assert browser.get_log("browser") == []
    assert browser.execute_script("return document.documentElement.scrollWidth <= innerWidth"), "no scrolling sideways"
    told = browser.find_element(By.CSS_SELECTOR, "#filters output")
    whole = told.text
    assert shown(browser, "recording") == {f"drive-{n}" for n in range(8)}
    choose(browser, "recording", "drive-7")
    assert shown(browser, "recording") == {"drive-7"}
    choose(browser, "recording", "any")
    choose(browser, "motion", "Preceding")
    assert shown(browser, "motion") == {"Preceding", None}, "rows of recordings are of all kinds"
    tables = browser.execute_script(TABLES)
    choose(browser, "recording", "drive-7")
    assert browser.execute_script(TABLES) < tables, "tables without rows are hidden"
    assert "All moving" in browser.find_element(By.TAG_NAME, "main").get_property("textContent"), "of all kinds"
    browser.find_element(By.CSS_SELECTOR, "#filters button").click()
    browser.execute_async_script("setTimeout(arguments[0], 50)")
    assert told.text == whole


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing(browser, page, width, scheme):
    opened(browser, page, width=width, scheme=scheme)
    browser.execute_script("for (const part of document.querySelectorAll('details')) part.open = true")
    assert accessibility_faults(browser) == []
    assert browser.execute_script(WIDE) == 0


def test_the_verdict_comes_first_and_pictures_within_the_first_screens(browser, page):
    for width in (1280, 390):
        opened(browser, page, width=width)
        tiles, picture, table = (
            browser.find_element(By.CSS_SELECTOR, selector).rect["y"]
            for selector in (".tiles", "figure img", "table:not(.tiles, .about)")
        )
        assert tiles < 900 * 0.6
        assert tiles < picture < table
        assert picture < 2 * 900


def test_names_of_recordings_are_no_markup(tmp_path, browser):
    name = '"><img src=x onerror=alert(1)>'
    table = Table(columns=["Recording"], rows=[[name], ["other"]], tags=[{"recording": name}, {"recording": "other"}])
    filters = Filters([Choice("recording", "Recording")])
    (tmp_path / "a.html").write_text(to_page("a", [filters, table], folder=tmp_path))
    opened(browser, tmp_path / "a.html")
    assert browser.find_elements(By.TAG_NAME, "img") == []
    choose(browser, "recording", name)
    assert len(browser.find_elements(By.CSS_SELECTOR, "tbody tr:not([hidden])")) == 1
