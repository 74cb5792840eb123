"""The page of proposals against annotations."""

import numpy as np
import pandas as pd

from bench.reporting.findings import COUNTS, ERRORS, WHERE, write_proposal_scores

WORST = pd.DataFrame({"recording": "one", "track": [f"<{n}>" for n in range(25)], "wrong": "missed", "frames": 7})


def written(folder):
    """Files of scores of two ranges; nothing was annotated in the second group."""
    rows = [
        dict(zip((*WHERE, *COUNTS, *ERRORS), (label, group, *values), strict=True))
        for label in ("< 8 m", "all")
        for group, values in (
            ("all", (40, 0.975, 0.9, 1, 2.0, 0.875, 0.03, 0.2, 0.1, 0.4, 0.3, 0.7, 1.5, 12.5)),
            ("<animal>", (0, np.nan, np.nan, 0, 0.0, *9 * [np.nan])),
        )
    ]
    scores = pd.DataFrame(rows)
    return write_proposal_scores(folder, scores, 0.5, worst=WORST, dataset="a & b", recordings=["one", "two"])


def test_all_files_tell_the_same(tmp_path):
    *files, tracks = written(tmp_path / "out")
    assert pd.read_csv(tracks).equals(WORST)
    page, text, table = (file.read_text() for file in files)
    for told in (page, text):
        assert "2 recordings, 30 s of sweeps." in told
        assert all(word in told for word in ("8 m", "97.5", "n/a", "87.5", "12.5"))
        assert "5 more in evaluate-tracks.csv" in told
        assert told.count("missed") == 21, "20 tracks and their explanation"
    assert "<animal>" not in page
    assert "&lt;animal&gt;" in page
    assert "a &amp; b" in page
    assert len(table.splitlines()) == 5
    assert "nan" not in page + text
