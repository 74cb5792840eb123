"""The page of proposals against annotations."""

import numpy as np
import pandas as pd
import pytest

from bench.reporting.proposal_scores import COLUMNS, write_proposal_scores
from tests.support.browser import accessibility_faults, headless_chromium, opened


@pytest.fixture
def files(tmp_path):
    """Scores of two ranges; nothing was annotated in the second group."""
    rows = [
        dict(zip(COLUMNS, (label, group, *values), strict=True))
        for label in ("< 8 m", "all")
        for group, values in (
            ("all", (40, 0.975, 0.9, 1, 2.0, 0.875, 0.03, 0.2, 0.1, 0.4, 0.3, 0.7, 1.5, 12.5)),
            ("<animal>", (0, np.nan, np.nan, 0, 0.0, *9 * [np.nan])),
        )
    ]
    worst = pd.DataFrame({"recording": "one", "track": [f"<{n}>" for n in range(25)], "wrong": "missed", "frames": 7})
    *found, tracks = write_proposal_scores(
        tmp_path / "out",
        pd.DataFrame(rows),
        0.5,
        worst=worst,
        dataset="a & b",
        recordings=["one", "two"],
    )
    assert pd.read_csv(tracks).equals(worst)
    return {file.suffix: file for file in found}


def test_all_files_tell_the_same(files):
    page, text, table = (files[suffix].read_text() for suffix in (".html", ".md", ".csv"))
    for told in (page, text):
        assert "2 recordings, 30 s of sweeps." in told
        assert all(word in told for word in ("Nearer than 8 m", "At any range", "97.5", "n/a", "87.5", "12.5"))
        assert "5 more are in evaluate-tracks.csv" in told
        assert told.count("missed") == 21, "20 tracks and their explanation"
    assert "<animal>" not in page
    assert "&lt;animal&gt;" in page
    assert "a &amp; b" in page
    assert len(table.splitlines()) == 5
    assert "nan" not in page + text


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing(files, tmp_path, width, scheme):
    browser = headless_chromium(tmp_path / "chromium")
    try:
        opened(browser, files[".html"], width=width, scheme=scheme)
        assert accessibility_faults(browser) == []
        assert browser.execute_script("return document.documentElement.scrollWidth") <= width
        assert browser.get_log("browser") == []
    finally:
        browser.quit()
