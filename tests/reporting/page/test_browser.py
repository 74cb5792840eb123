"""The page in a real browser, opened from disk."""

import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select, WebDriverWait

from tests.reporting.page.hostile import TRACK
from tests.support.browser import accessibility_faults, opened

pytestmark = pytest.mark.slow

HIDDEN = "return [...document.images].filter(i => !i.complete || i.naturalWidth === 0).map(i => i.alt)"
CONTRAST = """
const parse = (text) => text.match(/[\\d.]+/g).slice(0, 3).map(Number);
const linear = (v) => v <= .04045 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4;
const light = (c) => { const [r, g, b] = c.map((v) => linear(v / 255)); return .2126 * r + .7152 * g + .0722 * b; };
const paper = light(parse(getComputedStyle(document.body).backgroundColor));
const against = (selector, property) => {
  const ink = light(parse(getComputedStyle(document.querySelector(selector))[property]));
  return (Math.max(ink, paper) + .05) / (Math.min(ink, paper) + .05); };
return [against("body", "color"), against("small", "color"), against("a", "color"), against("svg.chart", "fill")];
"""


def column(browser, name):
    headings = browser.execute_script("return [...document.querySelectorAll('#objects th')].map(h => h.dataset.name)")
    place = headings.index(name) + 1
    script = f"return [...document.querySelectorAll('#objects tbody td:nth-child({place})')].map(c => c.textContent)"
    return browser.execute_script(script)


def heading(browser, name):
    return browser.find_element(By.CSS_SELECTOR, f"#objects th[data-name={name}]")


def press(browser, element):
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
    element.click()


@pytest.fixture
def page(browser, tiny_page):
    return opened(browser, tiny_page)


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (1280, "dark"), (375, "light")])
def test_it_renders_without_errors_and_every_picture_loads(browser, tiny_page, width, scheme):
    page = opened(browser, tiny_page, width=width, scheme=scheme)
    assert page.get_log("browser") == []
    assert len(page.find_elements(By.CSS_SELECTOR, ".card img")) > 9
    assert page.execute_script(HIDDEN) == []
    assert page.execute_script("return document.querySelectorAll('svg.chart').length") >= 6
    assert page.execute_script("return document.documentElement.scrollWidth <= innerWidth"), "no scrolling sideways"


def test_on_a_phone_tables_show_tpr_and_iou_without_scrolling_sideways(browser, tiny_page):
    page = opened(browser, tiny_page, width=390)
    page.execute_script("for (const part of document.querySelectorAll('.part')) part.open = true")
    ends = page.execute_script(
        "return [...document.querySelectorAll('table.metrics, #objects')].map(t => [...t.querySelectorAll('thead th')]"
        ".filter(h => /TPR|IoU/.test(h.textContent)).slice(0, 2).map(h => h.getBoundingClientRect().right))"
    )
    assert len(ends) >= 8
    assert all(len(two) == 2 and max(two) <= 390 for two in ends), ends


def test_sections_fold_on_a_phone_and_a_link_opens_its_section(browser, tiny_page):
    page = opened(browser, tiny_page, width=390)
    assert page.execute_script("return document.documentElement.scrollHeight") < 5000
    assert page.find_elements(By.CSS_SELECTOR, ".part[open]") == []
    press(page, page.find_element(By.CSS_SELECTOR, "nav a[href='#results']"))
    (part,) = page.find_elements(By.CSS_SELECTOR, ".part[open]")
    assert part.find_element(By.CSS_SELECTOR, "caption").is_displayed()
    assert page.execute_script(
        "return (s => s.scrollWidth <= s.clientWidth)(document.querySelector('#results .scroll'))"
    )
    wide = opened(browser, tiny_page)
    assert wide.find_elements(By.CSS_SELECTOR, ".part:not([open])") == []


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing(browser, tiny_page, width, scheme):
    page = opened(browser, tiny_page, width=width, scheme=scheme)
    page.execute_script("for (const part of document.querySelectorAll('.part')) part.open = true")
    assert accessibility_faults(page) == []


def test_on_a_laptop_the_main_table_fits(page):
    assert page.execute_script(
        "return (s => s.scrollWidth <= s.clientWidth)(document.querySelector('#results .scroll'))"
    )


def test_a_recording_filters_the_frames(page):
    press(page, page.find_element(By.ID, "recordings").find_element(By.LINK_TEXT, "standing"))
    assert set(column(page, "recording")) == {"standing"}


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_words_and_charts_read_in_both_schemes(browser, tiny_page, scheme):
    page = opened(browser, tiny_page, scheme=scheme)
    assert min(page.execute_script(CONTRAST)) >= 4.5
    background = page.execute_script("return getComputedStyle(document.body).backgroundColor")
    assert (background == "rgb(255, 255, 255)") == (scheme == "light")


def test_sorting_by_a_heading_goes_both_ways(page):
    before = [float(text) for text in column(page, "coverage")]
    assert before == sorted(before)
    assert heading(page, "coverage").get_attribute("aria-sort") == "ascending"
    press(page, heading(page, "range_m").find_element(By.TAG_NAME, "button"))
    near_first = [float(text) for text in column(page, "range_m")]
    assert near_first == sorted(near_first)
    assert heading(page, "coverage").get_attribute("aria-sort") == "none"
    press(page, heading(page, "range_m").find_element(By.TAG_NAME, "button"))
    assert [float(text) for text in column(page, "range_m")] == near_first[::-1]
    assert heading(page, "range_m").get_attribute("aria-sort") == "descending"
    press(page, heading(page, "recording").find_element(By.TAG_NAME, "button"))
    assert column(page, "recording") == sorted(column(page, "recording"))
    assert len(set(column(page, "recording"))) == 3


def test_empty_cells_come_last_both_ways(page):
    page.find_element(By.CSS_SELECTOR, "#filters [type=reset]").click()
    WebDriverWait(page, 5).until(lambda p: "static" in column(p, "outcome"))
    for _ in range(2):
        filled = [text != "" for text in column(page, "coverage")]
        assert False in filled
        assert filled == sorted(filled, reverse=True)
        press(page, heading(page, "coverage").find_element(By.TAG_NAME, "button"))


def test_typing_and_choosing_filter_the_rows(page):
    search = page.find_element(By.ID, "search")
    every = len(column(page, "recording"))
    search.send_keys("OVERtaking vehicle")
    assert set(column(page, "recording")) == {"overtaking"}
    shown = len(column(page, "recording"))
    assert 0 < shown < every
    assert page.find_element(By.ID, "found").text.startswith(f"{shown} of 16 ")
    search.clear()
    search.send_keys("nothing is called so")
    assert column(page, "recording") == []
    search.clear()
    search.send_keys(" ")
    Select(page.find_element(By.CSS_SELECTOR, "[data-filter=category]")).select_by_visible_text("crossing")
    assert set(column(page, "category")) == {"crossing"}
    page.find_element(By.ID, "pictured").click()
    buttons = page.find_elements(By.CSS_SELECTOR, "#objects tbody button")
    assert buttons
    assert {button.text for button in buttons} == {"picture"}


def test_a_picked_frame_opens_its_pictures(page):
    page.find_element(By.ID, "pictured").click()
    track, recording = column(page, "track_id")[0], column(page, "recording")[0]
    press(page, page.find_element(By.CSS_SELECTOR, "#objects tbody button"))
    viewer = page.find_element(By.ID, "viewer")
    assert viewer.is_displayed()
    assert track in viewer.find_element(By.ID, "viewer-title").text
    assert recording in viewer.find_element(By.ID, "viewer-title").text
    assert viewer.find_elements(By.CSS_SELECTOR, "img.panels")
    assert viewer.find_element(By.CLASS_NAME, "facts").text.startswith("found ")
    assert len(viewer.find_elements(By.TAG_NAME, "img")) == 3, "areas, close-up, panels"
    assert page.execute_script(HIDDEN) == []
    viewer.find_element(By.CSS_SELECTOR, "button").click()
    assert not viewer.is_displayed()


def test_a_frame_without_pictures_names_the_command(page):
    button = next(b for b in page.find_elements(By.CSS_SELECTOR, "#objects tbody button") if b.text == "command")
    press(page, button)
    command = page.find_element(By.CSS_SELECTOR, "#viewer pre").text
    assert command.startswith("fisheye-bench view ")
    assert "--set threshold=0.0005" in command
    assert "{" not in command


def test_names_from_the_data_stay_text(browser, hostile_page):
    page = opened(browser, hostile_page)
    assert page.get_log("browser") == []
    assert page.execute_script("return window.broken === undefined")
    assert TRACK in column(page, "track_id")
    place = column(page, "track_id").index(TRACK)
    press(page, page.find_elements(By.CSS_SELECTOR, "#objects tbody button")[place])
    assert TRACK.split("\u2028")[0].strip() in page.find_element(By.ID, "viewer-title").get_property("textContent")
    assert page.execute_script("return window.broken === undefined")


def test_it_prints(page):
    printed = page.execute_cdp_cmd("Page.printToPDF", {"printBackground": True})
    assert len(printed["data"]) > 100_000
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    for selector in ("nav", "#filters", ".pager", "#objects tbody button"):
        assert not page.find_element(By.CSS_SELECTOR, selector).is_displayed()
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
