"""JSON Schemas: files that are read pass, damaged ones do not, and every field that a reader meets is explained."""

import copy
import json
import re
from importlib import resources
from pathlib import Path

import pytest
import yaml
from jsonschema import Draft202012Validator

from bench.commands.schemas import OPTIONS, SCHEMAS, json_schema
from bench.recordings.catalogue import ADAPTERS
from tests.support import tiny_rosbag
from tests.support.commands import called_here
from tests.support.data_sets import DATA_SETS

ROOT = Path(__file__).parents[2]
CARD = {"name": "drives", "title": "Drives", "adapter": "native", "root": "data", "licence": "internal"}
OWN_RULES = {"based_on": "surface-v1", "name": "mine", "reference": {"motion": {"object_static_mps": 0.5}}}


def files():
    """Every kind of file with examples: (schema, name, content)."""
    shipped = {"card": "datasets", "protocol": "bench/evaluation/protocols", "tolerances": "bench/gate/tolerances"}
    for schema, folder in shipped.items():
        for file in sorted((ROOT / folder).glob("*.yaml")):
            if not file.stem.endswith(".scenario"):
                yield schema, file.stem, yaml.safe_load(file.read_text("utf-8"))
    for template in ("card", "adapter_card"):
        text = (resources.files("bench.commands") / f"templates/{template}.yaml.txt").read_text("utf-8")
        yield "card", f"new {template}", yaml.safe_load(text)
    yield "card", "part", CARD | {"annotated": {"timestamps_ns": [[None, 5]], "left_out_m": [[[0, 0], [1, 0], [1, 1]]]}}
    yield "card", "of a plug-in", CARD | {"adapter": "theirs", "options": {"anything": [1]}}
    yield "rig", "rig", tiny_rosbag.RIG
    text = re.findall(r"```json\n(.*?)```", (ROOT / "docs/your-data.md").read_text("utf-8"), re.DOTALL)[0]
    yield "recording", "of the docs", json.loads(text)
    yield "protocol", "own", OWN_RULES
    yield "summary", "stored", json.loads((ROOT / "tests/stored/spherical/summary.json").read_text("utf-8"))
    yield "manifest", "baseline", json.loads((ROOT / "reports/baselines/demo/manifest.json").read_text("utf-8"))


def faults(name, content):
    return [error.json_path for error in Draft202012Validator(json_schema(name)).iter_errors(content)]


@pytest.mark.parametrize("name", SCHEMAS)
def test_the_command_prints_a_schema_that_is_one(name):
    done = called_here("list", "--schema", name)
    printed = json.loads(done.stdout)
    assert (done.returncode, printed) == (0, json_schema(name))
    Draft202012Validator.check_schema(printed)


def test_the_command_lists_the_schemas():
    shown = called_here("list", "formats").stdout
    assert all(f"\n{name} " in shown for name in SCHEMAS)
    assert "did you mean 'card'" in called_here("list", "--schema", "cards").stderr


@pytest.mark.parametrize(("schema", "content"), [pytest.param(s, c, id=f"{s}-{name}") for s, name, c in files()])
def test_files_that_are_read_pass(schema, content):
    assert faults(schema, content) == []


@pytest.mark.parametrize("adapter", ADAPTERS)
def test_options_of_every_adapter_pass_and_unknown_ones_do_not(adapter, tmp_path):
    card = CARD | {"adapter": adapter, "options": DATA_SETS[adapter](tmp_path)}
    assert OPTIONS.keys() == ADAPTERS.keys()
    assert faults("card", json.loads(json.dumps(card))) == []
    card["options"] = card["options"] | {"cameraz": []}
    assert faults("card", card) == ["$.options"]
    del card["adapter"]
    assert faults("card", card) == ["$"]  # while it is being written


def example(schema):
    return copy.deepcopy(next(content for kind, _, content in files() if kind == schema))


@pytest.mark.parametrize(
    ("schema", "place", "value", "path"),
    [
        ("card", "adapter", None, "$"),
        ("card", "spilts", {"all": "*"}, "$"),
        ("card", "options.evaluated_size_px", [640], "$.options.evaluated_size_px"),
        ("rig", "lidar.time_unit", "minutes", "$.lidar"),
        ("protocol", "reference.min_points", 0, "$.reference.min_points"),
        ("protocol", "based_on", "paper-v9", "$.based_on"),
        ("tolerances", "metrics", {"iou": {"absolut": 0.1}}, "$.metrics.iou"),
        ("summary", "all_moving.iou.value", "high", "$.all_moving.iou.value"),
        ("manifest", "code.version", None, "$.code"),
        ("recording", "cameras.front.image_size", None, "$.cameras.front"),
    ],
)
def test_damaged_files_do_not_pass(schema, place, value, path):
    content = example(schema)
    *parents, key = place.split(".")
    part = content
    for name in parents:
        part = part.setdefault(name, {})
    if value is None:
        del part[key]
    else:
        part[key] = value
    assert path in {fault.removesuffix("[0]") for fault in faults(schema, content)}


def test_fields_are_explained_by_what_the_models_say_of_them():
    rig = json_schema("rig")
    assert rig["$defs"]["LidarRig"]["properties"]["topic"]["description"].startswith("of point clouds")
    assert "in /tf_static, which" in rig["$defs"]["LidarRig"]["properties"]["frame"]["description"]  # of its base
    rules = json_schema("protocol")["$defs"]
    assert "slower than this" in rules["MotionSettings"]["properties"]["object_static_mps"]["description"]
    bare = {
        (name, field)
        for schema in ("card", "recording", "rig")
        for name, part in json_schema(schema)["$defs"].items()
        for field, content in part.get("properties", {}).items()
        if "description" not in content
    }
    assert not bare
