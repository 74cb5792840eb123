"""A run goes on where it stopped, and a stored result is used only while all that it depends on is the same."""

import os
import shutil
import subprocess
import sys
from importlib import invalidate_caches, reload
from pathlib import Path
from shutil import ignore_patterns

import pyarrow.parquet as pq
import pytest

import bench
from bench.errors import DataError
from bench.evaluation import load_protocol
from bench.harness.digests import content as code
from bench.harness.masks import MASKS
from bench.harness.provenance import NOT_STORED
from tests.support.changed_data import (
    DAMAGES,
    change_annotation,
    change_calibration,
    change_egomotion,
    change_image,
    change_sweep,
    damage_image,
    remove_image,
)
from tests.support.runs import ALL, NONE, ONE, bytes_of, score

CHANGES = [
    change_image,
    change_sweep,
    change_annotation,
    change_egomotion,
    change_calibration,
    remove_image,
    damage_image,
]


def test_a_second_run_computes_nothing_and_gives_the_same_bytes(own_card, tmp_path):
    score(own_card, tmp_path / "run")
    first = bytes_of(tmp_path / "run")
    again = score(own_card, tmp_path / "run")
    assert bytes_of(tmp_path / "run") == first
    assert (again.provenance.work.units_computed, again.provenance.work.units_reused) == (NONE, ALL)


@pytest.mark.parametrize("change", CHANGES)
def test_a_changed_input_recomputes_what_depends_on_it_and_nothing_else(own_card, tmp_path, change):
    out, cache = tmp_path / "run", tmp_path / "cache"
    score(own_card, out, cache=cache)
    before = bytes_of(out)
    change(own_card.parent / "data" / "tiny" / "overtaking")
    again = score(own_card, out, cache=cache)
    assert again.provenance.work.units_computed == ONE
    score(own_card, tmp_path / "fresh")
    assert bytes_of(out) == bytes_of(tmp_path / "fresh")
    assert bytes_of(out) != before, "the change shows in the result"


@pytest.mark.parametrize(
    ("options", "computed"),
    [
        ({"settings": {"threshold": 1e-3}}, {}),
        ({"settings": {"weights": {"anti_parallel": 0.0}}}, {"likelihood": 12}),
        ({"settings": {"cell_size_px": 4}}, {"likelihood": 12, "flow": 12}),
        ({"settings": {"flow": "dis"}}, {"likelihood": 12, "flow": 12}),
        ({"protocol": load_protocol("extended-v1")}, {"reference": 12}),
        ({"method": "epipolar-only"}, {"likelihood": 12}),
        ({"method": "nothing"}, {}),
    ],
    ids=["threshold", "weights", "cells", "flow", "protocol", "method", "nothing"],
)
def test_a_changed_parameter_computes_only_the_steps_that_depend_on_it(own_card, tmp_path, options, computed):
    out, cache = tmp_path / "run", tmp_path / "cache"
    score(own_card, out, cache=cache)
    again = score(own_card, out, cache=cache, overwrite=True, **options)
    assert again.provenance.work.units_computed == ALL
    assert again.provenance.work.steps_computed == computed
    score(own_card, tmp_path / "fresh", **options)
    assert bytes_of(out) == bytes_of(tmp_path / "fresh")


@pytest.fixture
def forget_code():
    """Digests of code are taken once a process."""
    code.code_digest.cache_clear()
    yield code.code_digest.cache_clear
    code.code_digest.cache_clear()


def test_another_version_recomputes_everything(own_card, tmp_path, monkeypatch, forget_code):
    out, cache = tmp_path / "run", tmp_path / "cache"
    score(own_card, out, cache=cache)
    monkeypatch.setattr(bench, "__version__", "999.0")
    forget_code()
    work = score(own_card, out, cache=cache).provenance.work
    assert (work.units_computed, work.steps_found) == (ALL, {})


def test_other_libraries_recompute_everything(own_card, tmp_path, monkeypatch, forget_code):
    score(own_card, tmp_path / "run")
    monkeypatch.setattr(code, "library_versions", lambda: {"numpy": "999.0"})
    forget_code()
    assert score(own_card, tmp_path / "run").provenance.work.units_computed == ALL


def test_a_module_of_this_package_that_changed_is_named(tiny_card, tmp_path):
    """As an edited checkout does it: the same command, once before and once after the edit."""
    copied = shutil.copytree(Path(bench.__file__).parent, tmp_path / "copy" / "bench", ignore=ignore_patterns("*.pyc"))
    words = ("run", tiny_card, "--method", "nothing", "--no-cache", "--no-pictures", "--out", tmp_path / "run")

    def told() -> str:
        done = subprocess.run(
            [sys.executable, "-m", "bench", *map(str, words)],
            check=True, capture_output=True, text=True, cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(copied.parent)},
        )  # fmt: skip
        return " ".join(done.stdout.split())

    assert "computed again" not in told()
    for name in ("geometry/plane.py", "cameras/unified.py", "cli/bundle.py"):  # the last is no part of a result
        (copied / name).write_text((copied / name).read_text() + "\n# edited\n")
    assert f"changed: code: bench/cameras/unified.py, bench/geometry/plane.py ({ALL})" in told()


METHOD = """
from pathlib import Path

import numpy as np

from bench.methods import Method, Segmentation


class Bright(Method):
    name = "bright"
    files = (Path(__file__).with_name("weights.txt"),)

    def segment(self, frame):
        level = float(self.files[0].read_text())
        return Segmentation(cell_size_px=1, mask=frame.images[-1] > level)
"""


def test_code_and_files_of_a_method_from_elsewhere_count(own_card, tmp_path, monkeypatch):
    place = tmp_path / "own"
    place.mkdir()
    (place / "bright_method.py").write_text(METHOD)
    (place / "weights.txt").write_text("200")
    monkeypatch.syspath_prepend(str(place))

    changed = []

    def computed() -> int:
        work = score(own_card, tmp_path / "run", method="bright_method:Bright").provenance.work
        changed.append(work.changed)
        return work.units_computed

    assert (computed(), computed()) == (ALL, NONE)
    (place / "weights.txt").write_text("100")
    assert (computed(), computed()) == (ALL, NONE)
    assert changed == [{NOT_STORED: ALL}, {}, {"method: weights.txt": ALL}, {}]
    (place / "bright_method.py").write_text(METHOD.replace("> level", "< level"))
    invalidate_caches()
    reload(sys.modules["bright_method"])
    assert computed() == ALL


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_unit_is_computed_again(own_card, tmp_path, damage):
    score(own_card, tmp_path / "run")
    before = bytes_of(tmp_path / "run")
    DAMAGES[damage](sorted((tmp_path / "run" / "units").glob("crossing*.unit"))[0])
    assert score(own_card, tmp_path / "run").provenance.work.units_computed == ONE
    assert bytes_of(tmp_path / "run") == before


def test_a_unit_that_became_unusable_leaves_nothing_of_what_it_was(own_card, tmp_path):
    """Neither rows nor masks nor maps of images that cannot be read any more are joined."""
    score(own_card, tmp_path / "run")
    for image in (own_card.parent / "data" / "tiny" / "crossing" / "images" / "front").iterdir():
        image.write_bytes(b"damaged")
    summary = score(own_card, tmp_path / "run")
    score(own_card, tmp_path / "fresh")
    assert bytes_of(tmp_path / "run") == bytes_of(tmp_path / "fresh")
    assert summary.images.failed > 0
    assert "crossing" not in pq.read_table(tmp_path / "run" / MASKS)["recording"].to_pylist()


def test_a_damaged_entry_of_the_cache_is_computed_again(own_card, tmp_path):
    score(own_card, tmp_path / "run", cache=tmp_path / "cache")
    entries = sorted((tmp_path / "cache").glob("*/*/*.npz"))
    assert len(entries) == 3 * 12
    for number, entry in enumerate(entries):
        content = entry.read_bytes()
        entry.write_bytes(content[: len(content) * (number % 4) // 4])
    work = score(own_card, tmp_path / "other", cache=tmp_path / "cache").provenance.work
    assert work.steps_found == {}
    assert bytes_of(tmp_path / "other") == bytes_of(tmp_path / "run")


def test_units_of_another_cut_or_data_set_do_not_stay(own_card, tmp_path):
    score(own_card, tmp_path / "run")
    (tmp_path / "run" / "units" / f"former-front-00000000-{'0' * 64}.unit").write_text("{}")
    score(own_card, tmp_path / "run")
    assert not list((tmp_path / "run" / "units").glob("former*"))


def test_files_that_change_while_they_are_read_are_not_scored(own_card, tmp_path, monkeypatch):
    from bench.harness import tasks

    scored = tasks.run_unit

    def meddle(recording, unit, **options):
        tables = scored(recording, unit, **options)
        if unit.recording == "standing":
            change_image(own_card.parent / "data" / "tiny" / "standing")
        return tables

    monkeypatch.setattr(tasks, "run_unit", meddle)
    summary = score(own_card, tmp_path / "run")
    assert len(summary.failures) == 1
    assert "stay the same while they are scored" in summary.failures[0]
    monkeypatch.undo()
    again = score(own_card, tmp_path / "run")
    assert (again.failures, again.provenance.work.units_computed) == ((), ONE)


def test_a_failed_run_leaves_the_results_of_the_last_one_as_they_were(own_card, tmp_path):
    score(own_card, tmp_path / "run")
    before = bytes_of(tmp_path / "run")
    for file in own_card.parent.glob("data/tiny/*/recording.json"):
        file.unlink()
    with pytest.raises(DataError):
        score(own_card, tmp_path / "run")
    assert bytes_of(tmp_path / "run") == before
    assert not list(tmp_path.glob(".run*"))
