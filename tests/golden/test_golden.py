"""One tiny drive whose score may not change unnoticed."""

import json
from collections import defaultdict
from pathlib import Path

import pytest

from bench.evaluation.protocol import load_protocol
from bench.methods import build_method
from bench.recordings import load_card
from tests.support.counts import read_tables
from tests.support.runs import run_one

GOLDEN = Path(__file__).with_name("tiny.json")
RELATIVE = 0.02  # libraries on other processors may round a pixel away


def counts(card: Path, out: Path) -> dict[str, dict[str, int]]:
    run_one(card=load_card(str(card)), method=build_method("spherical"), protocol=load_protocol("paper-v1"), out=out)
    objects, frames = read_tables(out)
    sums: dict[str, dict[str, int]] = defaultdict(lambda: defaultdict(int))
    for row in objects.to_pylist():
        if row["status"] == "evaluated":
            for name in ("points", "tp", "fn", "fp"):
                sums[row["category"]][name] += row[name]
    for row in frames.to_pylist():
        for name in ("valid_px", "detected_px", "fp_px", "undefined_px"):
            sums["images"][name] += row[name]
    return {group: dict(values) for group, values in sums.items()}


def test_the_tiny_drive_scores_as_it_did(tiny_card, tmp_path):
    found, golden = counts(tiny_card, tmp_path / "run"), json.loads(GOLDEN.read_text())
    assert found.keys() == golden.keys(), "write tests/golden/HISTORY.md"
    for group, values in golden.items():
        for name, value in values.items():
            assert found[group][name] == pytest.approx(value, rel=RELATIVE, abs=20), (
                f"{group}.{name}: a line in tests/golden/HISTORY.md?"
            )
