"""Protocols: released files stay as they are, own files are checked."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from bench.errors import DataError
from bench.evaluation.protocol import known_protocols, load_protocol
from bench.records.reference import Category

# A released protocol is never edited, only superseded by a new file with a line of its own here.
RELEASED = {
    "extended-v1": "833215ad50200e776400f0253caea26641ae6ce00b0eabf54f64adcf44c939c5",
    "masks-v1": "aa5e3d806e140ea1780791bd375f7102ce8bd1d543873c981ea950fee59c3670",
    "paper-v1": "075012207d4a3e1dfa20861e3573c2c0bfa8dc5856d3fe8c175059ddc759328b",
    "surface-v1": "0a2e151f9528195889d028cfbac6f4e9852b207b2014a8e516dd4d84d9a341ce",
}


def write(path: Path, content: object) -> Path:
    path.write_text(yaml.safe_dump(content), "utf-8")
    return path


def test_released_protocols_are_unchanged() -> None:
    found = {name: load_protocol(name) for name in known_protocols()}
    assert {name: protocol.digest for name, protocol in found.items()} == RELEASED
    assert [protocol.name for protocol in found.values()] == [*found]


def test_the_papers_rules() -> None:
    settings = load_protocol("paper-v1").reference
    assert (settings.range_limit_m, settings.polygon_kind) == (8.0, "convex")
    assert settings.categories == tuple(kind for kind in Category if kind is not Category.MOVING)
    assert (settings.max_annotation_gap_ms, settings.motion.crossing_from_deg) == (100, 45)


def test_the_digest_is_of_the_content_not_of_its_writing(tmp_path: Path) -> None:
    paper = load_protocol("paper-v1")
    content = paper.model_dump(mode="json", exclude_unset=True)
    turned = write(tmp_path / "same.yaml", dict(reversed(content.items())))
    turned.write_text("# a comment\n\n" + turned.read_text("utf-8").replace("8.0", "8"), "utf-8")
    assert load_protocol(turned).digest == paper.digest
    changed = content | {"name": "ours-v1", "range_map": {"cell_m": 1.0, "min_object_frames": 6}}
    assert load_protocol(write(tmp_path / "other.yaml", changed)).digest != paper.digest


@pytest.mark.parametrize(
    ("part", "change", "field"),
    [
        ("colour", "red", "colour"),
        ("version", "one", "version: expected a valid integer, unable to parse string as an integer"),
        ("reference", {"range_limit_m": 1e5}, "reference.range_limit_m"),
        ("reference", {"min_points": 10**300}, "reference.min_points"),
        ("reference", {"motion": {"min_run_s": 1e300}}, "reference.motion.min_run_s"),
        ("reference", {"unknown_band": {"range_noise_m": 1e300}}, "reference.unknown_band.range_noise_m"),
        ("reference", {"unknown_band": {"limbs": {"Pedestrain": []}}}, "reference.unknown_band.limbs.Pedestrain"),
        ("reference", {"classes": ["Pedestrain"]}, "reference.classes.0"),
        ("reference", {"classes": ["pedestrian", "pedestrian"]}, "reference.classes"),
        ("scoring", {"chance_lag_s": 1e300}, "scoring.chance_lag_s"),
        ("scoring", {"detection_levels": [0.5, 0.5]}, "scoring.detection_levels"),
        ("scoring", {"detection_levels": [2]}, "scoring.detection_levels.0"),
        ("bins", {"range_m": [0, 2, 2]}, "bins.range_m"),
        ("bins", {"range_m": [1, 2]}, "bins.range_m"),
        ("range_map", {"min_object_frames": 0}, "range_map.min_object_frames"),
        ("range_map", {"cell_m": 1e-3}, "range maps of at most 1000 cells"),
    ],
)
def test_a_fault_is_one_line_that_names_file_and_field(tmp_path: Path, part, change, field) -> None:
    file = write(tmp_path / "mine.yaml", {"based_on": "surface-v1", "name": "ours", part: change})
    with pytest.raises(DataError, match=rf"mine\.yaml: .*{field}.*got .*$"):
        load_protocol(file)


def test_what_is_no_protocol_at_all_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    for text in ("[1, 2", "- a list", ""):
        file.write_text(text, "utf-8")
        with pytest.raises(DataError, match=r"mine\.yaml"):
            load_protocol(file)


def test_an_own_protocol_says_only_what_differs_from_a_shipped_one(tmp_path: Path) -> None:
    own = {"based_on": "surface-v1", "name": "ours", "version": 1, "reference": {"range_limit_m": 12.0}}
    found, base = load_protocol(write(tmp_path / "ours.yaml", own)), load_protocol("surface-v1")
    reference = base.reference.model_copy(update={"range_limit_m": 12.0})
    assert found == base.model_copy(update={"name": "ours", "version": 1, "reference": reference})
    assert found.digest != base.digest
    with pytest.raises(DataError, match=r"mine\.yaml: based_on: expected one of .*, got 'paper-v9'"):
        load_protocol(write(tmp_path / "mine.yaml", {"based_on": "paper-v9"}))


@pytest.mark.parametrize("name", ["paper-v1", "surface-v1"])
def test_a_released_name_belongs_to_its_rules(tmp_path, name):
    file = tmp_path / "ours.yaml"
    file.write_text(f"based_on: {name}\nreference: {{min_points: 1}}\n")
    with pytest.raises(DataError, match=f"name: expected a name of its own, since {name} is released with other rules"):
        load_protocol(file)
    file.write_text(f"based_on: {name}\nname: '{name} '\n")
    with pytest.raises(DataError, match="name: expected String should match pattern"):
        load_protocol(file)
