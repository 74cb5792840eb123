"""MCAP files: where their messages lie, also in files that were cut short or damaged.

A file is a row of records; chunks are records that hold others, packed. A recorder that is stopped well ends the file
with a summary. The scan does not need it: it walks the records, and uses the summary only to find the next chunk behind
a damaged one.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from bench.errors import DataError
from bench.recordings.rosbag.mcap_records import (
    CHANNEL,
    CHUNK,
    DATA_END,
    FOOTER,
    LARGEST_DEFINITION_BYTES,
    MAGIC,
    MESSAGE,
    MESSAGE_INDEX,
    SCHEMA,
    Chunk,
    DamagedError,
    Definitions,
    Record,
    content_of,
    define,
    exactly,
    read_summary,
    record_at,
    unpacked_chunk,
)
from bench.recordings.rosbag.storage import (
    HEAD_BYTES,
    LARGEST_MESSAGE_BYTES,
    LARGEST_WHOLE_BYTES,
    NOT_CHUNKED,
    Place,
    ScanReport,
    StoredMessage,
    Wanted,
)

MESSAGE_HEAD = struct.Struct("<HIQQ")


def scan_mcap(file: Path, expected: Wanted, report: ScanReport) -> Iterator[StoredMessage]:
    """Find the messages of a file, in the order in which they lie.

    Args:
        file: the file.
        expected: which messages are given.
        report: takes the topics, the counts of all messages, and what cannot be read.

    Raises:
        DataError: it cannot be opened, or is no MCAP file.
    """
    try:
        with file.open("rb") as stream:
            start = stream.read(len(MAGIC))
            if start != MAGIC:
                got = f"one that begins with {start.hex(' ')}" if start else "an empty file"
                raise DataError(file, expected="an MCAP file", got=got)
            yield from _Scan(file, stream, expected, report).messages()
    except OSError as error:
        raise DataError(file, expected="a readable file", got=error.strerror or str(error)) from error


def read_mcap_message(file: Path, place: Place) -> bytes:
    """Read one message.

    Raises:
        DataError: its chunk cannot be unpacked any more, or the file ends before it.
    """
    try:
        state = file.stat()
        if place.chunk == NOT_CHUNKED:
            with file.open("rb") as stream:
                stream.seek(place.offset)
                data = stream.read(place.size)
        else:
            chunk = _cached_chunk(file, (state.st_size, state.st_mtime_ns), place.chunk)
            data = chunk.data[place.offset : place.offset + place.size]
            if len(data) != place.size and chunk.fault is not None:
                field = f"chunk at byte {place.chunk}"
                raise DataError(file, field=field, expected="a chunk that can be unpacked", got=chunk.fault)
    except (OSError, DamagedError) as error:
        raise DataError(file, expected="a readable message", got=str(error)) from error
    if len(data) != place.size:
        raise DataError(file, expected=f"a message of {place.size} bytes", got=f"{len(data)}; did the file change?")
    return data


@lru_cache(maxsize=2)  # the next image lies in the same chunk or the next one, and sweeps are read between
def _cached_chunk(file: Path, state: tuple[int, int], position: int) -> Chunk:
    """A chunk of a file of a size and a time of change, which tell it from another in its place."""
    with file.open("rb") as stream:
        return unpacked_chunk(stream, record_at(stream, position, state[0]))


class _Scan:
    """One walk through a file."""

    def __init__(self, file: Path, stream: BinaryIO, expected: Wanted, report: ScanReport) -> None:
        self.file, self.stream, self.expected, self.report = file, stream, expected, report
        self.size = stream.seek(0, 2)
        self.known = Definitions()
        self.found = 0
        self.last_ns: int | None = None

    def messages(self) -> Iterator[StoredMessage]:
        """Every wanted message that can be read."""
        summary = read_summary(self.stream, self.size, self.known)
        for topic in self.known.channels.values():
            self.report.add_topic(topic)
        position: int | None = len(MAGIC)
        before = len(self.report.losses)
        closed = False
        while position is not None and position < self.size:
            try:
                record = record_at(self.stream, position, self.size)
                if record.kind in (DATA_END, FOOTER):
                    closed = True
                    break
                if record.kind == CHUNK:
                    yield from self._chunk(record, position)
                else:
                    yield from self._plain(self.stream, record, NOT_CHUNKED)
                if record.end > self.size:
                    raise DamagedError(f"the end of the file, {record.end - self.size} bytes too early")
                position = record.end
            except DamagedError as damage:
                resumed = next((place for place in summary.chunks if place > position), None)
                self._lose_rest(position, str(damage), resumed)
                position = resumed
        if not (closed and summary.closed) and len(self.report.losses) == before:
            self._lose_rest(self.size, "the end of the file without the summary that a recorder writes last", None)
        if summary.messages is not None and self.found < summary.messages:
            self._lose("messages", f"{summary.messages}, as the summary says", f"{self.found} that can be read")

    def _chunk(self, record: Record, position: int) -> Iterator[StoredMessage]:
        chunk = unpacked_chunk(self.stream, record)
        if chunk.fault is not None and (not chunk.data or record.end <= self.size):
            missing = self._indexed_messages(record.end)
            told = f", {missing} messages" if missing else ""
            got = f"{chunk.fault}{told} from {chunk.first_ns} to {chunk.last_ns}"
            self._lose(f"chunk at byte {position}", "a whole chunk", got)
        stream, place = BytesIO(chunk.data), 0
        while place < len(chunk.data):
            try:
                inner = record_at(stream, place, len(chunk.data))
                if inner.end > len(chunk.data):
                    raise DamagedError("a record that is longer than its chunk")
                yield from self._plain(stream, inner, position)
            except DamagedError as damage:
                if chunk.fault is None:
                    field = f"chunk at byte {position}, byte {place} of it"
                    self._lose(field, "a row of records", f"{damage}; what follows in the chunk")
                return
            place = inner.end

    def _plain(self, stream: BinaryIO, record: Record, chunk: int) -> Iterator[StoredMessage]:
        """A record that holds no others."""
        if record.kind in (SCHEMA, CHANNEL):
            topic = define(self.known, record.kind, content_of(stream, record, LARGEST_DEFINITION_BYTES))
            if topic is not None:
                self.report.add_topic(topic)
        elif record.kind == CHUNK:
            raise DamagedError("a chunk inside a chunk")
        elif record.kind == MESSAGE:
            size = record.length - MESSAGE_HEAD.size
            if not 0 <= size <= LARGEST_MESSAGE_BYTES:
                raise DamagedError(f"a message of {size} bytes")
            if chunk == NOT_CHUNKED and record.end > self.size:
                return  # cut short: the caller tells
            stream.seek(record.start)
            channel, _, log_ns, _ = MESSAGE_HEAD.unpack(exactly(stream, MESSAGE_HEAD.size))
            topic = self.known.channels.get(channel)
            if topic is None:
                raise DamagedError(f"a message of channel {channel}, which nothing describes")
            if log_ns >= 1 << 63:
                raise DamagedError(f"a message of the time {log_ns}")
            self.found += 1
            self.last_ns = log_ns if self.last_ns is None else max(self.last_ns, log_ns)
            self.report.count(topic.name)
            if topic.name in self.expected.whole or topic.name in self.expected.heads:
                most = LARGEST_WHOLE_BYTES if topic.name in self.expected.whole else HEAD_BYTES
                payload = exactly(stream, min(size, most))
                place = Place(chunk, record.start + MESSAGE_HEAD.size, size)
                yield StoredMessage(topic.name, log_ns, place, payload)

    def _indexed_messages(self, position: int) -> int:
        """How many messages the index records behind a chunk name."""
        count = 0
        try:
            while (record := record_at(self.stream, position, self.size)).kind == MESSAGE_INDEX:
                count += max(record.length - 6, 0) // 16
                position = record.end
        except DamagedError:
            pass
        return count

    def _lose_rest(self, position: int, what: str, resumed: int | None) -> None:
        if resumed is not None:
            rest = f"what lies up to the chunk at byte {resumed}"
        else:
            rest = "all messages" if self.last_ns is None else f"what was recorded after {self.last_ns}"
        self._lose(f"byte {position}", "a whole record", f"{what}; {rest} is lost")

    def _lose(self, field: str, expected: str, got: str) -> None:
        self.report.losses.append(DataError(self.file, field=field, expected=expected, got=got))
