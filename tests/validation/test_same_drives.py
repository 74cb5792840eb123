"""The same drive under two names."""

import numpy as np

from bench.recordings import RecordingWriter, load_card, open_dataset
from bench.validation.report import validate_dataset
from tests.support import tiny
from tests.support.cards import write_card


def test_the_same_drive_under_two_names_is_found_by_its_content(tmp_path):
    for name in ("a", "b", "other"):
        tiny.write_recording(tmp_path / "data" / name)
    changed = RecordingWriter(tmp_path / "data" / "other")
    changed.image("front", tiny.TIMES_NS[1], np.zeros((tiny.HEIGHT, tiny.WIDTH), dtype=np.uint8))
    report = validate_dataset("x", open_dataset(load_card(write_card(tmp_path))))
    found = {one.name: [f.got for f in one.findings if f.check == "same-drive"] for one in report.recordings}
    assert found == {"a": [], "b": ["the images and the sweep of 'a' in the middle of it"], "other": []}
    (alone,) = validate_dataset("x", open_dataset(load_card(write_card(tmp_path)), "a")).recordings
    assert "same-drive" not in [finding.check for finding in alone.findings]
