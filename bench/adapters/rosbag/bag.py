"""A bag: the files that make it up, what its `metadata.yaml` says, and where its messages are.

A bag of ROS 2 is a folder with `metadata.yaml` and one or more files of messages. One file alone is read too.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from bench.adapters.rosbag.messages import (
    HEADER_BYTES,
    SUFFIXES,
    Position,
    Topic,
    has_header,
    header_stamp_ns,
    stored_messages,
)
from bench.atomic import path_inside, refuse_escape
from bench.errors import DataError
from bench.plain_yaml import parse_yaml
from bench.recordings.files import read_text
from bench.recordings.validation import LATEST_NS, ForeignModel, validated
from bench.times import SECOND_NS

METADATA = "metadata.yaml"
ROS1_SUFFIX = ".bag"
LARGEST_METADATA_BYTES = 4_000_000  # qualities of service of a thousand topics
LARGEST_READ_BYTES = 1 << 22  # of a message that is read while the bag is walked through: speeds, poses, frames
LONGEST_JUMP_S = 10.0  # a delay from stamp to recording that differs by more is of another clock

Clock = Literal["header", "bag"]


class _Information(ForeignModel):
    relative_file_paths: tuple[str, ...] = Field(min_length=1)
    compression_mode: str | None = None


class _Metadata(ForeignModel):
    rosbag2_bagfile_information: _Information


@dataclass(frozen=True, slots=True)
class BagMessage:
    """A message that a walk through a bag finds.

    Attributes:
        topic: that it was sent on.
        log_ns: when it was recorded.
        stamp_ns: the time in its header; `NO_TIME` where that has none, `log_ns` where its type has no header.
        file_number: of the file that holds it.
        file: the same.
        position: where in the file.
        start: its first bytes in CDR.
    """

    topic: Topic
    log_ns: int
    stamp_ns: int
    file_number: int
    file: Path
    position: Position
    start: bytes


class TimedRows:
    """Numbers of a topic's messages and the messages' times, in the order of the file."""

    def __init__(self) -> None:
        self.topic: Topic | None = None  # of the messages; None without any
        self._times_ns: list[tuple[int, int]] = []
        self._numbers: list[tuple[float, ...]] = []

    def add(self, message: BagMessage, numbers: tuple[float, ...]) -> None:
        """Add the numbers of a message, as many as of every other."""
        self.topic = message.topic
        self._times_ns.append((message.log_ns, message.stamp_ns))
        self._numbers.append(numbers)

    def usable(self, clock: Clock, *, file: Path, losses: list[DataError]) -> tuple[NDArray[np.int64], NDArray[Any]]:
        """The rows whose times can be used, by time, and whose numbers are finite.

        Args:
            clock: whether the time of the recording or that of the header counts.
            file: for errors.
            losses: gets an error for each kind of row that is left out.

        Returns:
            times_ns: (N,) int64, increasing.
            numbers: (N, columns).
        """
        log_ns, stamp_ns = np.array(self._times_ns, dtype=np.int64).T
        numbers = np.array(self._numbers)
        times_ns = log_ns if clock == "bag" else stamp_ns
        valid = np.ones(len(times_ns), dtype=bool)

        def keep(good: NDArray[np.bool_], expected: str, got: str, hint: str = "") -> None:
            bad = valid & ~good
            if bad.any():
                first = f"the first recorded at {log_ns[bad].min()} ns"
                got = f"{got} in {bad.sum()} of {len(bad)} messages, {first}"
                field = self.topic.name if self.topic else None
                losses.append(DataError(file, field=field, expected=expected, got=got, hint=hint))
            valid[bad] = False

        hint = "set the card's option clock: bag where the driver sets no stamps"
        keep((times_ns > 0) & (times_ns < LATEST_NS), "a time in the header", "none", hint)
        keep(~_jumps(times_ns, log_ns, valid), "stamps of one clock", "jumps")
        order = np.lexsort((log_ns, times_ns))
        again = np.zeros(len(order), dtype=bool)
        again[order[1:]] = np.diff(times_ns[order]) == 0
        same = np.zeros(len(order), dtype=bool)
        same[order[1:]] = (numbers[order[1:]] == numbers[order[:-1]]).all(axis=1)
        valid[again & same] = False  # a message that was recorded twice
        keep(~again, "one message for each time", "others at the time of one before")
        keep(np.isfinite(numbers).all(axis=1), "finite numbers", "NaN or infinity")
        order = order[valid[order]]
        return times_ns[order], numbers[order]


def _jumps(times_ns: NDArray[np.int64], log_ns: NDArray[np.int64], valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) bool, stamps of another clock than most.

    By the time of recording a clock goes on evenly; one of a simulation faster or slower than the recorder's, which
    counts where it explains more stamps.
    """
    rows = np.flatnonzero(valid)[np.argsort(log_ns[valid], kind="stable")]
    if not len(rows):
        return np.zeros(len(times_ns), dtype=bool)
    log_s, time_s = ((values - values[rows[0]]) / SECOND_NS for values in (log_ns, times_ns))
    half = len(rows) // 2
    with np.errstate(divide="ignore", invalid="ignore"):
        rates = (time_s[rows[half:]] - time_s[rows[: len(rows) - half]]) / (
            log_s[rows[half:]] - log_s[rows[: len(rows) - half]]
        )
    fitted = float(np.median(rates[np.isfinite(rates)])) if half and np.isfinite(rates).any() else 1.0
    jumps = []
    for rate in (1.0, fitted):
        delay_s = time_s - rate * log_s
        jumps.append(valid & (np.abs(delay_s - np.median(delay_s[rows])) > LONGEST_JUMP_S))
    return min(jumps, key=np.count_nonzero)


def bags_below(root: Path) -> tuple[Path, ...]:
    """Files and folders of `root` that are bags; `root` alone where it is one itself."""
    if (root / METADATA).is_file():
        return (root,)
    return tuple(path for path in sorted(root.glob("[!.]*")) if _is_bag(path))


def bag_files(root: Path, path: Path) -> tuple[Path, ...]:
    """The files of messages that make up a bag, in the order in which they were recorded.

    Args:
        root: folder of the data set, which no file may leave.
        path: a file or folder in it, or the root itself.

    Raises:
        DataError: metadata that is missing, cannot be used or names files that are missing or elsewhere.
    """
    refuse_escape(root, path, file=path)
    if path.suffix == ROS1_SUFFIX:
        hint = f"convert it: rosbags-convert --src {path.name} --dst {path.stem}"
        raise DataError(path, expected="a bag of ROS 2", got="one of ROS 1", hint=hint)
    if path.is_file():
        return (path,)
    file = path / METADATA
    refuse_escape(root, file, file=file)
    if not file.is_file():
        expected, hint = "the metadata that a recorder writes last", f"write it again: ros2 bag reindex {path.name}"
        raise DataError(file, expected=expected, got="no such file", hint=hint)
    content = parse_yaml(read_text(file, largest_bytes=LARGEST_METADATA_BYTES), file=file)
    files = _described_files(path, validated(_Metadata, content, file=file).rosbag2_bagfile_information)
    for entry in files:
        refuse_escape(root, entry, file=entry)
    return files


def bag_messages(
    files: Sequence[Path], *, listed: Collection[str], read: Collection[str], counts: Counter[str]
) -> Iterator[BagMessage]:
    """Walk through a bag once, without decoding an image or a point cloud.

    Args:
        files: of the bag.
        listed: topics of which the start of each message is read.
        read: topics whose messages are read whole.
        counts: takes the number of messages of every topic, these and others.

    Yields:
        The messages of these topics, in the order of the files.

    Raises:
        DataError: a file that cannot be read, or messages of an unknown type.
    """
    start_bytes = dict.fromkeys(listed, HEADER_BYTES) | dict.fromkeys(read, LARGEST_READ_BYTES)
    for number, file in enumerate(files):
        for topic, log_ns, position, start in stored_messages(file, start_bytes):
            counts[topic.name] += 1
            if topic.name in start_bytes:
                stamp_ns = header_stamp_ns(start) if has_header(topic, file=file) else log_ns
                yield BagMessage(topic, log_ns, stamp_ns, number, file, position, start)


def _described_files(path: Path, information: _Information) -> tuple[Path, ...]:
    """The files of a bag as its metadata describes it."""
    file, key = path / METADATA, "rosbag2_bagfile_information"
    mode = (information.compression_mode or "").lower()
    if mode not in ("", "none", "file", "storage"):
        hint = "write it again without: ros2 bag convert"
        raise DataError(file, field=f"{key}.compression_mode", expected="none", got=repr(mode[:20]), hint=hint)
    files: list[Path] = []
    for number, relative in enumerate(information.relative_file_paths):
        where = f"{key}.relative_file_paths.{number}"
        entry = path_inside(path, relative, file=file, field=where)
        if not entry.is_file():  # early recorders wrote the folder's name in front
            entry = path / PurePosixPath(relative).name
        if entry.suffix not in SUFFIXES or entry in files:
            expected, got = f"another file {' or '.join(SUFFIXES)}", repr(relative[:80])
            hint = f"unpack it: unzstd {path.name}/*.zstd, then ros2 bag reindex" if entry.suffix == ".zstd" else ""
            raise DataError(file, field=where, expected=expected, got=got, hint=hint)
        if not entry.is_file():
            expected, hint = f"a file of messages, as {METADATA} says", "fetch it; without it, ros2 bag reindex"
            raise DataError(entry, expected=expected, got="no such file", hint=hint)
        files.append(entry)
    return tuple(files)


def _is_bag(path: Path) -> bool:
    if path.is_file():
        return path.suffix in (*SUFFIXES, ROS1_SUFFIX)
    names = [entry.name for entry in path.iterdir()] if path.is_dir() else []
    return any(name == METADATA or name.endswith(SUFFIXES) for name in names)
