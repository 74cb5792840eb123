"""Croissant: a description of a data set in the native format, for catalogues and loaders of data sets.

It says which files there are and what they hold, and lists images and annotated objects as records. Digests are those
of `recording.json` and, for rendered recordings, of `synthesis.json`, which has the digest of each file.

Source:
    MLCommons, Croissant Format Specification, version 1.1.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from bench.errors import UsageError
from bench.recordings import DatasetCard
from bench.recordings.catalogue import open_dataset
from bench.recordings.native import HEAD, IMAGE_SUFFIXES, SWEEP_SUFFIXES
from bench.synthesis.production import MANIFEST

FILE = "croissant.json"
VERSION = "http://mlcommons.org/croissant/1.1"
DEMANDED = ("url", "creator", "datePublished")  # by the specification; the card says nothing of them
CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "dct": "http://purl.org/dc/terms/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    **{name: {"@container": "@language"} for name in ("name", "description")},
    **{
        name: f"cr:{name}"
        for name in (
            *("arrayShape", "citeAs", "column", "containedIn", "equivalentProperty", "extract", "field", "fileObject"),
            *("fileProperty", "fileSet", "format", "includes", "isArray", "isLiveDataset", "jsonPath", "key", "md5"),
            *("parentField", "path", "recordSet", "references", "regex", "repeated", "replace", "samplingRate"),
            *("separator", "source", "subField", "transform"),
        )
    },
}  # fmt: skip

# Name -> patterns in each recording, description.
FILE_SETS = {
    "images": ([f"images/*/*{suffix}" for suffix in IMAGE_SUFFIXES], "Images by camera, named by their time in ns."),
    "sweeps": ([f"lidar/*{suffix}" for suffix in SWEEP_SUFFIXES], "Lidar sweeps, named by their time in ns."),
    "annotations": (["annotations.json"], "Annotated objects as OpenLABEL, boxes in the vehicle frame."),
    "bus_signals": (["egomotion.csv"], "Speed and yaw rate that the vehicle reports."),
    "poses": (["poses.csv", "truth/poses.csv"], "Poses of the vehicle, TUM format."),
    "instances": (["truth/*/*.png"], "Exact instance ids of the images of the same names, 16 bit."),
    "ego_bodies": (["ego_body/*.png"], "Pixels that are not 0 where a camera sees its own vehicle."),
}
JSON = "application/json"
MEDIA_TYPES = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".json": JSON, ".csv": "text/csv"}
ANY = "application/octet-stream"


def croissant(card: DatasetCard, more: Mapping[str, Any]) -> dict[str, Any]:
    """Describe a data set, as JSON-LD; paths are relative to the root of the data.

    Args:
        card: of a data set in the native format.
        more: properties of schema.org's `Dataset` to add.

    Raises:
        UsageError: another format, or a root that is itself a recording.
        DataError: the data are not there.
    """
    content = card.content
    if content.adapter != "native":
        raise UsageError(f"{card.file}: expected a data set in the native format")
    folders = [card.root / recording.name for recording in open_dataset(card)]
    if (card.root / HEAD).is_file():
        raise UsageError(f"{card.root}: expected a folder of recordings, got one recording")
    file_sets = [*_file_sets(folders)]
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": VERSION,
        "name": card.name,
        "description": " ".join(f"{content.title}. {content.caveats}".split()),
        "license": content.licence,
        **more,
        "distribution": [*_digested(folders), *file_sets],
        "recordSet": [*_record_sets({one["@id"] for one in file_sets})],
    }


def _digested(folders: list[Path]) -> Iterator[dict[str, Any]]:
    """The head of each recording and, of rendered ones, the list of all files with their digests."""
    for file in (folder / name for folder in folders for name in (HEAD, MANIFEST)):
        if file.is_file():
            name = f"{file.parent.name}/{file.name}"
            digest = hashlib.sha256(file.read_bytes()).hexdigest()
            yield {
                "@type": "cr:FileObject", "@id": name, "name": name, "contentUrl": name, "encodingFormat": JSON,
                "sha256": digest,
            }  # fmt: skip


def _file_sets(folders: list[Path]) -> Iterator[dict[str, Any]]:
    """Kinds of files that the recordings have."""
    for name, (patterns, description) in FILE_SETS.items():
        found = [pattern for pattern in patterns if any(any(folder.glob(pattern)) for folder in folders)]
        kinds = sorted({MEDIA_TYPES.get(Path(pattern).suffix, ANY) for pattern in found})
        if found:
            yield {
                "@type": "cr:FileSet", "@id": name, "name": name, "description": description, "encodingFormat": kinds,
                "includes": [f"*/{pattern}" for pattern in found],
            }  # fmt: skip


def _record_sets(file_sets: set[str]) -> Iterator[dict[str, Any]]:
    path = {"fileProperty": "fullpath"}
    yield _record_set(
        "images",
        "Each image of each camera.",
        ("recording", "sc:Text", path, r"^([^/]+)/images/"),
        ("camera", "sc:Text", path, r"^[^/]+/images/([^/]+)/"),
        ("timestamp_ns", "sc:Integer", path, r"^[^/]+/images/[^/]+/(-?\d+)\."),
        ("image", "sc:ImageObject", {"fileProperty": "content"}, None),
    )
    if "annotations" in file_sets:
        ids = {"jsonPath": "$.openlabel.objects.*.object_data.num[0].val"}
        yield _record_set(
            "objects",
            "Each annotated object of each recording.",
            ("recording", "sc:Text", path, r"^([^/]+)/"),
            ("id", "sc:Text", {"jsonPath": "$.openlabel.objects.*.name"}, None),
            ("object_class", "sc:Text", {"jsonPath": "$.openlabel.objects.*.type"}, None),
            *([("instance_id", "sc:Integer", ids, None)] if "instances" in file_sets else []),
            file_set="annotations",
        )


def _record_set(
    name: str, description: str, *fields: tuple[str, str, dict[str, str], str | None], file_set: str = ""
) -> dict[str, Any]:
    """Records of the files of a file set.

    Args:
        name: of the records.
        description: of a record.
        fields: name, type, what is taken of a file, and the expression whose group is the value; None for all of it.
        file_set: that holds them; "" for the one of the same name.
    """
    made = []
    for field, kind, extract, expression in fields:
        source: dict[str, Any] = {"fileSet": {"@id": file_set or name}, "extract": extract}
        if expression is not None:
            source["transform"] = {"regex": expression}
        place = f"{name}/{field}"
        made.append({"@type": "cr:Field", "@id": place, "name": field, "dataType": kind, "source": source})
    return {"@type": "cr:RecordSet", "@id": f"{name}_records", "name": name, "description": description, "field": made}


def as_json(description: Mapping[str, Any]) -> str:
    """The text of a file; dates, as YAML reads them, in ISO 8601."""
    return json.dumps(description, indent=1, ensure_ascii=False, default=str) + "\n"
