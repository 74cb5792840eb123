"""Which files make up a bag, and what its `metadata.yaml` says of them.

A bag of ROS 2 is a folder with `metadata.yaml` and one or more files of messages; one file alone, or a folder whose
recorder died before it wrote the metadata, is read too.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from bench.errors import DataError
from bench.recordings.atomic import path_inside, refuse_escape
from bench.recordings.rosbag.yaml import read_yaml
from bench.recordings.validation import validated

METADATA = "metadata.yaml"
SUFFIXES = (".mcap", ".db3")
ROS1_SUFFIX = ".bag"
LARGEST_METADATA_BYTES = 4_000_000  # qualities of service of a thousand topics


class _Part(BaseModel):
    """A part of `metadata.yaml`; keys that are not used are passed over."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class _TopicName(_Part):
    name: str


class _TopicCount(_Part):
    topic_metadata: _TopicName
    message_count: Annotated[int, Field(ge=0)]


class _Information(_Part):
    relative_file_paths: tuple[str, ...]
    topics_with_message_count: tuple[_TopicCount, ...] = ()
    compression_format: str | None = None
    compression_mode: str | None = None


class _Metadata(_Part):
    rosbag2_bagfile_information: _Information


@dataclass(frozen=True, slots=True, kw_only=True)
class BagFiles:
    """The files of a bag.

    Attributes:
        place: the folder, or the one file.
        files: of messages, in the order in which they were recorded.
        counts: messages that a topic has, as the metadata says; None without metadata.
        packed_messages: each message is compressed for itself, by zstd.
        losses: files that are missing.
    """

    place: Path
    files: tuple[Path, ...]
    counts: dict[str, int] | None = None
    packed_messages: bool = False
    losses: tuple[DataError, ...] = ()


def bags_below(root: Path) -> tuple[str, ...]:
    """Names of files and folders of `root` that are bags; "." where `root` itself is one."""
    if (root / METADATA).is_file():
        return (".",)
    return tuple(path.name for path in sorted(root.glob("[!.]*")) if _is_bag(path))


def bag_files(root: Path, name: str) -> BagFiles:
    """The files of a bag.

    Args:
        root: folder of the data set, which no file may leave.
        name: of a file or folder in it.

    Raises:
        DataError: metadata that cannot be used or that names files elsewhere, or no file that can be read.
    """
    place = root if name == "." else root / name
    refuse_escape(root, place, file=place)
    if place.suffix == ROS1_SUFFIX:
        do = f"convert it: rosbags-convert --src {place.name} --dst {place.stem}"
        raise DataError(place, expected="a bag of ROS 2", got="one of ROS 1", do=do)
    if place.is_file():
        return BagFiles(place=place, files=(place,))
    file = place / METADATA
    if not file.is_file():
        found = _by_number(path for path in place.iterdir() if path.suffix in SUFFIXES)
        _refuse_packed_files(place)
        for path in found:
            refuse_escape(root, path, file=path)
        missing = DataError(
            file, expected="the metadata that a recorder writes last", got="no such file; its counts cannot be compared"
        )
        return BagFiles(place=place, files=found, losses=(missing,))
    refuse_escape(root, file, file=file)
    content = read_yaml(file, most_bytes=LARGEST_METADATA_BYTES)
    return _listed(root, place, validated(_Metadata, content, file=file).rosbag2_bagfile_information)


def _listed(root: Path, place: Path, told: _Information) -> BagFiles:
    file, field = place / METADATA, "rosbag2_bagfile_information"
    mode = (told.compression_mode or "").lower()
    if mode not in ("", "none", "message", "file", "storage") or (
        mode == "message" and (told.compression_format or "").lower() != "zstd"
    ):
        got = f"{mode[:20]!r} with {(told.compression_format or '')[:20]!r}"
        raise DataError(file, field=f"{field}.compression_mode", expected="none, or message with zstd", got=got)
    if mode == "file":
        _refuse_packed_files(place)
    found, losses = [], []
    for number, relative in enumerate(told.relative_file_paths):
        where = f"{field}.relative_file_paths.{number}"
        path = path_inside(place, relative, file=file, field=where)
        if not path.is_file():  # early recorders wrote the folder's name in front
            path = place / PurePosixPath(relative).name
        if path.suffix not in SUFFIXES:
            raise DataError(file, field=where, expected=f"a file {' or '.join(SUFFIXES)}", got=repr(relative[:80]))
        if path.is_file():
            refuse_escape(root, path, file=path)
            found.append(path)
        else:
            losses.append(DataError(path, expected=f"a file of messages, as {METADATA} says", got="no such file"))
    if not found:
        raise DataError(place, expected=f"files of messages, {' or '.join(SUFFIXES)}", got="none")
    if len(set(found)) < len(found):
        raise DataError(file, field=f"{field}.relative_file_paths", expected="each file once", got="one twice")
    counts: dict[str, int] = {}
    for entry in told.topics_with_message_count:
        counts[entry.topic_metadata.name] = counts.get(entry.topic_metadata.name, 0) + entry.message_count
    return BagFiles(
        place=place, files=tuple(found), counts=counts, packed_messages=mode == "message", losses=tuple(losses)
    )


def _is_bag(path: Path) -> bool:
    if path.is_file():
        return path.suffix in (*SUFFIXES, ROS1_SUFFIX)
    return path.is_dir() and any(
        entry.name == METADATA or entry.suffix in SUFFIXES or _is_packed(entry) for entry in path.iterdir()
    )


def _is_packed(path: Path) -> bool:
    return path.suffix == ".zstd" and path.with_suffix("").suffix in SUFFIXES


def _refuse_packed_files(place: Path) -> None:
    packed = sorted(path for path in place.iterdir() if _is_packed(path))
    if packed:
        do = f"unpack them: unzstd {place.name}/*.zstd, then ros2 bag reindex"
        raise DataError(
            packed[0], expected="a file of messages that can be read at any place", got="a packed one", do=do
        )


def _by_number(paths: Iterable[Path]) -> tuple[Path, ...]:
    """In the order of recording: drive_2 stands before drive_10."""

    def key(path: Path) -> list[tuple[int, str]]:
        return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"([0-9]+)", path.name)]

    return tuple(sorted(paths, key=key))
