"""The page in a real browser, opened from disk."""

import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select, WebDriverWait

from tests.support.browser import opened

pytestmark = pytest.mark.slow

HIDDEN = "return [...document.images].filter(i => !i.complete || i.naturalWidth === 0).map(i => i.alt)"
ROWS = "#frames tbody tr:not([hidden]):not(.beyond)"


def column(browser, name):
    headings = browser.execute_script(
        "return [...document.querySelectorAll('#frames thead th')].map(h => h.textContent)"
    )
    script = (
        f"return [...document.querySelectorAll('{ROWS}')].map(r => r.cells[{headings.index(name)}].textContent.trim())"
    )
    return browser.execute_script(script)


def heading(browser, name):
    return browser.find_element(By.XPATH, f"//section[@id='frames']//thead//th[.='{name}']")


def press(browser, element):
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
    element.click()


@pytest.fixture
def page(browser, tiny_page):
    return opened(browser, tiny_page)


def test_every_picture_loads(page):
    assert len(page.find_elements(By.CSS_SELECTOR, ".box img")) >= 9
    assert page.execute_script(HIDDEN) == []
    assert page.execute_script("return document.querySelectorAll('svg.chart').length") == 2


def test_on_a_phone_each_value_stands_below_its_heading(browser, tiny_page):
    page = opened(browser, tiny_page, width=390)
    named = "return getComputedStyle(document.querySelector('#results td'), '::before').content"
    assert page.execute_script(named) == '"Recs"'


def test_a_picture_stands_within_the_first_two_screens(browser, tiny_page):
    for width in (1280, 390):
        page = opened(browser, tiny_page, width=width)
        top = page.execute_script("return document.querySelector('figure img').getBoundingClientRect().top")
        assert top < 2 * 900


def test_sections_fold_on_a_phone_and_a_link_opens_its_section(browser, tiny_page):
    page = opened(browser, tiny_page, width=390)
    assert page.execute_script("return document.documentElement.scrollHeight") < 5000
    (first,) = page.find_elements(By.CSS_SELECTOR, ".part[open]")
    assert "At a glance" in first.text
    press(page, page.find_element(By.CSS_SELECTOR, "nav a[href='#results']"))
    WebDriverWait(page, 10).until(lambda page: len(page.find_elements(By.CSS_SELECTOR, ".part[open]")) == 2)
    _, part = page.find_elements(By.CSS_SELECTOR, ".part[open]")
    assert part.find_element(By.CSS_SELECTOR, "caption").is_displayed()
    wide = opened(browser, tiny_page)
    assert wide.find_elements(By.CSS_SELECTOR, ".part:not([open])") == []


def test_on_a_laptop_the_main_table_fits(page):
    assert page.execute_script(
        "return (s => s.scrollWidth <= s.clientWidth)(document.querySelector('#results .scroll'))"
    )


def test_a_recording_filters_the_frames(page):
    press(page, page.find_element(By.ID, "recordings").find_element(By.LINK_TEXT, "standing"))
    assert set(column(page, "recording")) == {"standing"}


def test_sorting_by_a_heading_goes_both_ways(page):
    before = [float(text) for text in column(page, "TPR %")]
    assert before == sorted(before)
    press(page, heading(page, "range (m)").find_element(By.TAG_NAME, "button"))
    near_first = [float(text) for text in column(page, "range (m)")]
    assert near_first == sorted(near_first)
    assert heading(page, "range (m)").get_attribute("aria-sort") == "ascending"
    press(page, heading(page, "range (m)").find_element(By.TAG_NAME, "button"))
    assert [float(text) for text in column(page, "range (m)")] == near_first[::-1]
    assert heading(page, "range (m)").get_attribute("aria-sort") == "descending"
    press(page, heading(page, "recording").find_element(By.TAG_NAME, "button"))
    assert heading(page, "range (m)").get_attribute("aria-sort") == "none"
    assert column(page, "recording") == sorted(column(page, "recording"))
    assert len(set(column(page, "recording"))) == 3


def test_empty_cells_come_last_both_ways(page):
    Select(page.find_element(By.CSS_SELECTOR, "[data-filter=outcome]")).select_by_visible_text("any")
    for _ in range(2):
        press(page, heading(page, "TPR %").find_element(By.TAG_NAME, "button"))
        filled = [text != "" for text in column(page, "TPR %")]
        assert False in filled
        assert filled == sorted(filled, reverse=True)


def test_typing_and_choosing_filter_the_rows(page):
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
    Select(page.find_element(By.CSS_SELECTOR, "[data-filter=kind]")).select_by_visible_text("crossing")
    assert set(column(page, "kind")) == {"crossing"}


def test_an_object_leads_to_its_pictures_and_a_picture_enlarges(page):
    link = next(a for a in page.find_elements(By.CSS_SELECTOR, f"{ROWS} th a"))
    press(page, link)
    box = page.find_element(By.CSS_SELECTOR, link.get_attribute("href").partition("#")[2].join(["#", ""]))
    assert len(box.find_elements(By.TAG_NAME, "img")) == 3, "areas, close-up, panels"
    press(page, box.find_element(By.TAG_NAME, "img"))
    viewer = page.find_element(By.ID, "viewer")
    assert viewer.is_displayed()
    assert viewer.find_element(By.ID, "viewer-title").text.startswith("Camera image of ")
    assert page.execute_script(HIDDEN) == []
    viewer.find_element(By.CSS_SELECTOR, "button").click()
    assert not viewer.is_displayed()


def test_the_command_draws_what_has_no_picture(page):
    command = page.find_element(By.CSS_SELECTOR, "#frames pre").text
    assert command.startswith("fisheye-bench view ")
    assert "--set threshold=0.0005" in command
    assert command.endswith("--recording RECORDING --camera CAMERA --time-ns TIME")


def test_it_prints(page):
    printed = page.execute_cdp_cmd("Page.printToPDF", {"printBackground": True})
    assert len(printed["data"]) > 100_000
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    for selector in ("nav", "#filters"):
        assert not page.find_element(By.CSS_SELECTOR, selector).is_displayed()
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
