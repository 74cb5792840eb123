"""JSON Schemas of the files that people write and programs read, made from the models that read them.

Editors complete and check a file by its schema. What a schema cannot say, such as values that have to fit together, is
said when the file is read.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, Literal

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, models_json_schema
from pydantic_core import core_schema

from bench.adapters.aimotive import AimotiveOptions
from bench.adapters.kitti360 import Kitti360Options
from bench.adapters.kitti_raw import KittiRawOptions
from bench.adapters.log123d import LogOptions
from bench.adapters.rosbag.rig import Rig, RosbagOptions
from bench.adapters.woodscape import WoodscapeOptions
from bench.cameras.model import RollingShutter
from bench.errors import UnknownNameError
from bench.evaluation.protocol import Protocol, known_protocols
from bench.gate.tolerances import Tolerances, known_tolerances
from bench.harness.manifest import Manifest
from bench.harness.stored import RunSummary
from bench.recordings.annotations import AnnotationFile
from bench.recordings.cards import CardFile
from bench.recordings.mounting import RollingShutterHead
from bench.recordings.native import NativeOptions, RecordingHead

Schema = dict[str, Any]

OPTIONS: dict[str, type[BaseModel]] = {  # of cards, by adapter
    "native": NativeOptions,
    "aimotive": AimotiveOptions,
    "kitti-raw": KittiRawOptions,
    "kitti360": Kitti360Options,
    "woodscape": WoodscapeOptions,
    "rosbag": RosbagOptions,
    "123d": LogOptions,
}
DOCUMENTED_BY: dict[type[BaseModel], type] = {  # records that say what fields of the same names mean
    RollingShutterHead: RollingShutter,
}


class _Generator(GenerateJsonSchema):
    """Schemas with what the docstrings say of a model's fields, without titles that repeat their names."""

    def field_title_should_be_set(self, schema: Any) -> bool:  # noqa: ARG002 - the base class names it
        return False

    def model_schema(self, schema: core_schema.ModelSchema) -> Schema:
        made = super().model_schema(schema)
        text, attributes = _documented(schema["cls"])
        for name, field in made.get("properties", {}).items():
            if name in attributes:
                field.setdefault("description", attributes[name])
        return made | {"description": text}


def _documented(model: type[BaseModel]) -> tuple[str, dict[str, str]]:
    """A docstring before its attributes, and each attribute's text, those of base classes among them."""
    sources = (DOCUMENTED_BY.get(model, object), *model.__mro__[::-1])
    texts = [inspect.cleandoc(one.__doc__ or "").partition("\n\nAttributes:\n") for one in sources]
    attributes = [re.findall(r"^    (\w+): (.+(?:\n {8}.+)*)", text, re.MULTILINE) for _, _, text in texts]
    return texts[-1][0], {name: " ".join(text.split()) for found in attributes for name, text in found}


def _file(model: type[BaseModel], mode: Literal["validation", "serialization"] = "validation") -> Schema:
    """Of a file that is read, or that this program writes."""
    return model.model_json_schema(schema_generator=_Generator, mode=mode)


def _card() -> Schema:
    """Of a card, with the options of its adapter; those of adapters that others add may be any."""
    models = {name: (model, "validation") for name, model in {"": CardFile, **OPTIONS}.items()}
    references, made = models_json_schema(list(models.values()), schema_generator=_Generator)  # type: ignore[arg-type]
    definitions = made["$defs"]
    card: Schema = definitions.pop("CardFile")
    card["properties"]["adapter"]["examples"] = list(OPTIONS)
    card["allOf"] = [
        {
            "if": {"required": ["adapter"], "properties": {"adapter": {"const": name}}},
            "then": {"properties": {"options": references[models[name]]}},  # type: ignore[index]
        }
        for name in OPTIONS
    ]
    return card | {"$defs": definitions}


def _rules(model: type[BaseModel], known: Callable[[], Iterable[str]]) -> Schema:
    """Of a file of rules, which may say only what it changes of those that it is `based_on`."""
    rules = _file(model)
    for part in (rules, *rules["$defs"].values()):
        part.pop("required", None)
    description = "The rules of the package that hold where this file says nothing."
    rules["properties"]["based_on"] = {"enum": list(known()), "description": description}
    return rules


SCHEMAS: dict[str, Callable[[], Schema]] = {
    "card": _card,
    "recording": partial(_file, RecordingHead),
    "annotations": partial(_file, AnnotationFile),
    "rig": partial(_file, Rig),
    "protocol": partial(_rules, Protocol, known_protocols),
    "tolerances": partial(_rules, Tolerances, known_tolerances),
    "summary": partial(_file, RunSummary, "serialization"),
    "manifest": partial(_file, Manifest, "serialization"),
}


def json_schema(name: str) -> Schema:
    """The JSON Schema of a kind of file, draft 2020-12.

    Args:
        name: of `SCHEMAS`.

    Raises:
        UnknownNameError: there is none of this name.
    """
    if name not in SCHEMAS:
        raise UnknownNameError("schema", name, SCHEMAS)
    return {"$schema": _Generator.schema_dialect} | SCHEMAS[name]()
