"""Records of MCAP files, read one by one; wrong lengths and hostile chunks never fill the memory.

Little endian, as the MCAP specification 1.0 lays them out: a byte for the kind, eight for the length, the content.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from io import BytesIO
from typing import BinaryIO
from zlib import crc32

from bench.recordings.rosbag.storage import Topic
from bench.recordings.rosbag.unpack import unpack

MAGIC = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(2, 9)
STATISTICS, DATA_END = 0x0B, 0x0F
RECORD_HEAD = 9  # kind and length
CHUNK_HEAD = struct.Struct("<QQQI")
FOOTER_BYTES = RECORD_HEAD + 20 + len(MAGIC)
LARGEST_CHUNK_BYTES = 1 << 28
LARGEST_DEFINITION_BYTES = 1 << 22


class DamagedError(Exception):
    """A record that cannot be read; its text says how."""


@dataclass(frozen=True, slots=True)
class Record:
    """A record's kind, where its content begins, and its length."""

    kind: int
    start: int
    length: int

    @property
    def end(self) -> int:
        """Where the next one begins."""
        return self.start + self.length


@dataclass(frozen=True, slots=True)
class Chunk:
    """An unpacked chunk; `fault` says why it is not whole."""

    first_ns: int
    last_ns: int
    data: bytes
    fault: str | None


@dataclass(slots=True)
class Definitions:
    """Schemas (name, encoding, definition, which is binary in encodings other than ROS's) and channels by number."""

    schemas: dict[int, tuple[str, str, bytes]] = field(default_factory=dict)
    channels: dict[int, Topic] = field(default_factory=dict)


@dataclass(slots=True)
class Summary:
    """What stands at the end of a file that was closed.

    Attributes:
        chunks: where chunks begin.
        messages: how many the file has; None where it does not tell.
        closed: whether the file ends as it should.
    """

    chunks: list[int] = field(default_factory=list)
    messages: int | None = None
    closed: bool = False


def record_at(stream: BinaryIO, position: int, size: int) -> Record:
    """The record that begins at a place; it may be longer than what is there."""
    if position + RECORD_HEAD > size:
        raise DamagedError(f"the end after {size - position} bytes")
    stream.seek(position)
    kind = exactly(stream, 1)[0]
    if kind == 0:
        raise DamagedError("a record of kind 0, as in a file that was not written to the end")
    return Record(kind, position + RECORD_HEAD, _length(stream))


def _length(stream: BinaryIO) -> int:
    length = int.from_bytes(exactly(stream, 8), "little")
    if length >= 1 << 62:
        raise DamagedError(f"a record of {length} bytes")
    return length


def exactly(stream: BinaryIO, count: int) -> bytes:
    """That many bytes, or a `DamagedError`."""
    data = stream.read(count)
    if len(data) != count:
        raise DamagedError(f"the end after {len(data)} of {count} bytes")
    return data


def content_of(stream: BinaryIO, record: Record, most_bytes: int) -> BytesIO:
    """All of a record, unless it is larger than such records are."""
    if record.length > most_bytes:
        raise DamagedError(f"a record of {record.length} bytes, where {most_bytes} are the most")
    stream.seek(record.start)
    return BytesIO(exactly(stream, record.length))


def _bytes(stream: BinaryIO) -> bytes:
    length = int.from_bytes(exactly(stream, 4), "little")
    if length > LARGEST_DEFINITION_BYTES:
        raise DamagedError(f"a text of {length} bytes")
    return exactly(stream, length)


def _text(stream: BinaryIO) -> str:
    try:
        return _bytes(stream).decode()
    except UnicodeDecodeError as error:
        raise DamagedError("text that is not UTF-8") from error


def define(known: Definitions, kind: int, content: BytesIO) -> Topic | None:
    """Take a schema or a channel; the topic of a channel."""
    number = int.from_bytes(exactly(content, 2), "little")
    if kind == SCHEMA:
        known.schemas[number] = _text(content), _text(content), _bytes(content)
        return None
    schema = int.from_bytes(exactly(content, 2), "little")
    name, encoding, definition = known.schemas.get(schema, ("", "", b""))
    topic = Topic(
        name=_text(content),
        message_type=name,
        encoding=_text(content),
        definition=definition.decode(errors="replace") if encoding == "ros2msg" else "",
    )
    known.channels[number] = topic
    return topic


def unpacked_chunk(stream: BinaryIO, record: Record) -> Chunk:
    """Unpack a chunk; of one that is cut short, what there is."""
    stream.seek(record.start)
    first_ns, last_ns, unpacked_size, checksum = CHUNK_HEAD.unpack(exactly(stream, CHUNK_HEAD.size))
    compression = _text(stream)
    packed_size = int.from_bytes(exactly(stream, 8), "little")
    if max(packed_size, unpacked_size) > LARGEST_CHUNK_BYTES:
        fault = f"{packed_size} bytes, {unpacked_size} unpacked, where {LARGEST_CHUNK_BYTES} are the most"
        return Chunk(first_ns, last_ns, b"", fault)
    if stream.tell() + packed_size > record.end:
        return Chunk(first_ns, last_ns, b"", "more data than its record")
    packed = stream.read(packed_size)
    unpacked = unpack(packed, compression, most_bytes=unpacked_size)
    if len(packed) < packed_size:
        return Chunk(first_ns, last_ns, unpacked.data, f"{len(packed)} of {packed_size} bytes")
    if unpacked.fault is not None:
        return Chunk(first_ns, last_ns, b"", unpacked.fault)
    if len(unpacked.data) != unpacked_size:
        fault = f"{len(unpacked.data)} bytes when unpacked, where {unpacked_size} are told"
        return Chunk(first_ns, last_ns, b"", fault)
    if checksum and crc32(unpacked.data) != checksum:
        return Chunk(first_ns, last_ns, b"", "data that does not fit its checksum")
    return Chunk(first_ns, last_ns, unpacked.data, None)


def read_summary(stream: BinaryIO, size: int, known: Definitions) -> Summary:
    """The summary, with its schemas and channels in `known`; an empty one where the file has none that can be read."""
    if size < len(MAGIC) + FOOTER_BYTES:
        return Summary()
    stream.seek(size - FOOTER_BYTES)
    footer = stream.read(FOOTER_BYTES)
    if footer[0] != FOOTER or not footer.endswith(MAGIC):
        return Summary()
    summary = Summary(closed=True)
    position = int.from_bytes(footer[RECORD_HEAD : RECORD_HEAD + 8], "little")
    if position == 0:
        return summary
    try:
        while position < size - FOOTER_BYTES:
            record = record_at(stream, position, size)
            if record.kind in (SCHEMA, CHANNEL):
                define(known, record.kind, content_of(stream, record, LARGEST_DEFINITION_BYTES))
            elif record.kind == CHUNK_INDEX:
                stream.seek(record.start + 16)
                summary.chunks.append(int.from_bytes(exactly(stream, 8), "little"))
            elif record.kind == STATISTICS:
                stream.seek(record.start)
                summary.messages = int.from_bytes(exactly(stream, 8), "little")
            position = record.end
    except DamagedError:
        return Summary()
    summary.chunks.sort()
    return summary
