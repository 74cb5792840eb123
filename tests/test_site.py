"""The documentation as a site: every page in a browser."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.browser import accessibility_faults, headless_chromium, opened

ROOT = Path(__file__).parents[1]
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """All pages but that of the theme for addresses that do not exist."""
    site = tmp_path_factory.mktemp("site")
    build = ["-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(site)]
    subprocess.run([sys.executable, *build], cwd=ROOT, check=True, capture_output=True)
    return sorted(page for page in site.rglob("*.html") if page.name != "404.html")


def test_no_page_needs_the_network(pages):
    for page in pages:
        assert not re.findall(r"<(?:script|img|link)[^>]*(?:src|href)=.?(?:https?:)?//", page.read_text("utf-8")), page


@pytest.mark.parametrize(("width", "scheme"), [(1280, "dark"), (390, "light")])
def test_every_page_is_accessible_and_as_wide_as_the_window(pages, tmp_path, width, scheme):
    faults = []
    with headless_chromium(tmp_path) as browser:
        for page in pages:
            opened(browser, page, width=width, scheme=scheme)
            needed_px = browser.execute_script("return document.documentElement.scrollWidth")
            faults += [f"{page.name}: {fault}" for fault in accessibility_faults(browser)]
            faults += [f"{page.name}: {needed_px} px wide"] * (needed_px > width)
    assert (len(pages) > 20, faults) == (True, [])
