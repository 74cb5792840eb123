"""Messages in the files of a bag, MCAP (`.mcap`) and SQLite (`.db3`): found in one walk, read one by one, decoded.

The packages `mcap` and `rosbags` and SQLite read what is stored. They allocate what a file asks for, so the sizes of
records, chunks and values are compared with the file and with limits first. A file that they cannot read to its end is
not repaired here: the error names the tool that does it.
"""

from __future__ import annotations

import re
import sqlite3
import struct
import sys
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from functools import cache, lru_cache
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO
from urllib.parse import quote

import lz4.frame
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import breakup_chunk

from bench.errors import DataError
from bench.times import SECOND_NS

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

IMAGE, COMPRESSED_IMAGE = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
ODOMETRY = "nav_msgs/msg/Odometry"
POSES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped")
TRANSFORMS = "tf2_msgs/msg/TFMessage"
HEADER = "std_msgs/msg/Header"
HEADER_BYTES = 64  # of a message: enough for the time in its header
NO_TIME = -1
LONGEST_DEFINITION = 100_000  # blank lines of this length take two seconds to parse
TYPE_NAME = re.compile(r"[A-Za-z]\w{0,99}(/[A-Za-z]\w{0,99}){1,2}", re.ASCII)
SUFFIXES = (".mcap", ".db3")
LARGEST_MESSAGE_BYTES = LARGEST_RECORD_BYTES = 1 << 28  # an image of 8192 x 8192 px in four channels
LARGEST_DEFINITIONS_BYTES = 1 << 25  # of all topics and message types
LATEST_LOG_NS = 2**63
NO_CHUNK = -1
RECORD_HEAD = struct.Struct("<BQ")  # opcode, bytes of the content
DECOMPRESSORS = {"zstd": zstd.ZstdDecompressor, "lz4": lz4.frame.LZ4FrameDecompressor}
# Beside their own errors the libraries raise those of unpacking numbers and of text, and lz4 raises RuntimeError.
LIBRARY_ERRORS = (McapError, zstd.ZstdError, sqlite3.Error, struct.error, ValueError, OverflowError, RuntimeError)


def full_name(topic: str) -> str:
    """The name of a topic with the slash that ROS puts before it."""
    return f"/{topic.lstrip('/')}"


@dataclass(frozen=True, slots=True)
class Topic:
    """Description of a topic in a bag.

    Attributes:
        name: such as "/camera/front".
        stored_type: the message type as stored, such as "sensor_msgs/msg/Image" or "sensor_msgs/Image".
        encoding: of its messages; ROS 2 has "cdr".
        definition: of the message type, in ROS's .msg form; empty where the file has none.
    """

    name: str
    stored_type: str
    encoding: str = "cdr"
    definition: str = ""

    @property
    def message_type(self) -> str:
        """The message type in the form "package/msg/Name"."""
        words = self.stored_type.split("/")
        return self.stored_type if len(words) == 3 else f"{words[0]}/msg/{words[-1]}"

    def refuse_others(self, *types: str, file: Path) -> None:
        """Raise a `DataError` unless the messages have one of these types."""
        if self.message_type not in types:
            expected = f"messages {' or '.join(types)}"
            raise DataError(file, field=self.name, expected=expected, got=self.stored_type[:80])


def decode(topic: Topic, payload: bytes, *, file: Path) -> Any:
    """Decode a message.

    Args:
        topic: that it was sent on.
        payload: its bytes in CDR.
        file: for errors.

    Returns:
        An object with the fields of the message type; arrays of numbers are numpy arrays.

    Raises:
        DataError: an unknown type or encoding, or bytes that are no such message.
    """
    types = _types(topic, file)
    try:
        return types.deserialize_cdr(payload, topic.message_type)
    except Exception as error:  # the decoder raises what its reading of wrong bytes happens to raise
        got = f"{len(payload)} bytes that are none ({type(error).__name__})"
        raise DataError(file, field=topic.name, expected=f"a message {topic.stored_type}", got=got) from error


def field_value(message: Any, path: str, *, file: Path, topic: str) -> Any:
    """A field of a message by its path, such as "twist.linear.x" or "wheels.0".

    Raises:
        DataError: no such field.
    """
    value = message
    for word in path.split("."):
        try:
            value = value[int(word)] if word.isdigit() else getattr(value, word)
        except (AttributeError, IndexError, TypeError, KeyError):
            known = ", ".join(name for name in getattr(value, "__dataclass_fields__", ()) if not name.startswith("_"))
            got = f"none called {word!r}" + (f"; there are {known}" if known else "")
            raise DataError(file, field=topic, expected=f"the field {path}", got=got) from None
    return value


def has_header(topic: Topic, *, file: Path) -> bool:
    """Return True where messages of a topic begin with a header, and so with a time.

    Raises:
        DataError: an unknown type or encoding.
    """
    fields = _types(topic, file).fielddefs[topic.message_type][1]
    return bool(fields) and fields[0][1][1] == HEADER


def header_stamp_ns(start: bytes) -> int:
    """The time in the header that a message begins with.

    Args:
        start: the first bytes of the message, in CDR: four that give the byte order, seconds, nanoseconds.

    Returns:
        ns; `NO_TIME` for a time that no clock can show, and for 0, which drivers leave that set none.
    """
    if len(start) < 12 or start[0] != 0 or start[1] not in (0, 1):
        return NO_TIME
    seconds, rest_ns = struct.unpack_from("<iI" if start[1] else ">iI", start, 4)
    return NO_TIME if seconds < 0 or rest_ns >= SECOND_NS else seconds * SECOND_NS + rest_ns or NO_TIME


def _types(topic: Topic, file: Path) -> Typestore:
    """Types that include the topic's, from ROS 2 itself or from the definition in the file."""
    name = topic.message_type
    if topic.encoding != "cdr" or TYPE_NAME.fullmatch(topic.stored_type) is None:
        got = f"{topic.stored_type[:80]!r} in {topic.encoding[:40]!r}"
        raise DataError(file, field=topic.name, expected="messages in CDR, as ROS 2 records them", got=got)
    if name in _typestore().fielddefs:
        return _typestore()
    if not 0 < len(topic.definition) <= LONGEST_DEFINITION:
        hint = "record with MCAP, or with ROS 2 Iron or later, which store the definitions of messages"
        got = f"{len(topic.definition)} characters"
        raise DataError(
            file,
            field=topic.name,
            expected=f"the definition of {name} in at most {LONGEST_DEFINITION} characters of .msg text",
            got=got,
            hint=hint,
        )
    try:
        return _typestore(name, topic.definition)
    except Exception as error:  # as for messages
        got = f"text that is none ({type(error).__name__})"
        raise DataError(file, field=topic.name, expected=f"the definition of {name}", got=got) from error


@cache
def _typestore(name: str = "", definition: str = "") -> Typestore:
    """The types of ROS 2, and one of the user's."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # 0.3 s, and only bags need it

    types = get_typestore(Stores.ROS2_HUMBLE)
    if name:
        parsed = get_types_from_msg(definition, name)
        types.register({key: value for key, value in parsed.items() if key not in types.fielddefs})
    return types


@dataclass(frozen=True, slots=True)
class Position:
    """Position of a message in its file.

    Attributes:
        chunk: byte at which its chunk begins; `NO_CHUNK` in a database.
        offset: number of its record in the chunk; in a database the number of its row.
        size: bytes of the message, as stored.
    """

    chunk: int
    offset: int
    size: int


def stored_messages(file: Path, start_bytes: Mapping[str, int]) -> Iterator[tuple[Topic, int, Position, bytes]]:
    """All messages of a file, in the order in which they are stored.

    Args:
        file: MCAP or SQLite, by its suffix.
        start_bytes: how many bytes of a message are read, by topic; none of other topics.

    Yields:
        The topic, the time of recording (ns), the position, and the first bytes.

    Raises:
        DataError: it cannot be read to its end, or is no such file.
    """
    with _repairable(file, "a whole file"):
        yield from (_mcap_messages if file.suffix == ".mcap" else _sqlite_messages)(file, start_bytes)


def read_message(file: Path, position: Position) -> bytes:
    """Read one message.

    Args:
        file: that holds it.
        position: where.

    Raises:
        DataError: it cannot be read.
    """
    expected = f"a message of {position.size} bytes"
    with _repairable(file, expected):
        data = (_mcap_message if file.suffix == ".mcap" else _sqlite_message)(file, position)
    if len(data) != position.size:
        raise DataError(file, expected=expected, got=f"{len(data)}; did the file change?")
    return data


@dataclass(frozen=True, slots=True)
class StoredMessage:
    """A message in a bag; a `bench.records.recording.StoredPart`. Its `repr` is what decides how it is decoded.

    Attributes:
        container: the file that holds it.
        position: where in the file.
        topic: that it was sent on.
    """

    container: Path = field(repr=False)
    position: Position = field(repr=False)
    topic: Topic

    def payload(self) -> bytes:
        """Its bytes in CDR."""
        return read_message(self.container, self.position)

    def content(self) -> bytes:
        """Bytes of the message, after everything that decides how they are decoded."""
        return repr(self).encode() + self.payload()


@contextmanager
def _repairable(file: Path, expected: str) -> Iterator[None]:
    """Errors of the libraries, as one that names the tool that repairs the file."""
    try:
        yield
    except OSError as error:
        raise DataError(file, expected="a readable file", got=error.strerror or str(error)) from error
    except LIBRARY_ERRORS as error:
        tool, repaired = f"mcap recover {file.name} -o", f"{file.stem}-repaired{file.suffix}"
        if file.suffix != ".mcap":
            tool = f"sqlite3 {file.name} .recover | sqlite3"
        got = " ".join(str(error).split())[:200] or f"the end in the middle of it ({type(error).__name__})"
        raise DataError(
            file, expected=expected, got=got, hint=f"repair it, then replace it by the result: {tool} {repaired}"
        ) from error


# MCAP


def _mcap_messages(file: Path, start_bytes: Mapping[str, int]) -> Iterator[tuple[Topic, int, Position, bytes]]:
    types: dict[int, tuple[str, str]] = {}  # name and definition by schema
    topics: dict[int, Topic] = {}  # by channel
    messages = 0
    with file.open("rb") as stream:
        summary = SeekingReader(stream, record_size_limit=LARGEST_RECORD_BYTES).get_summary()
        if summary is None:
            raise McapError("no summary with an index, which a recorder writes last")
        for chunk in sorted(index.chunk_start_offset for index in summary.chunk_indexes):
            for number, record in enumerate(_chunk_records(stream, chunk)):
                if isinstance(record, Schema):
                    # Definitions in other languages than ROS's may be binary and are not read.
                    text = record.data.decode(errors="replace") if record.encoding == "ros2msg" else ""
                    types[record.id] = record.name, text
                elif isinstance(record, Channel):
                    name, text = types.get(record.schema_id, ("", ""))
                    topic = Topic(full_name(record.topic), name, record.message_encoding, text)
                    if topics.setdefault(record.id, topic) != topic:
                        raise McapError(f"two topics on channel {record.id}")
                elif isinstance(record, Message):
                    if record.channel_id not in topics or record.log_time >= LATEST_LOG_NS:
                        raise McapError(f"a message on channel {record.channel_id} at {record.log_time} ns")
                    messages, topic = messages + 1, topics[record.channel_id]
                    start = record.data[: start_bytes.get(topic.name, 0)]
                    yield topic, record.log_time, Position(chunk, number, len(record.data)), start
    if summary.statistics is not None and messages != summary.statistics.message_count:
        stated = summary.statistics.message_count
        raise McapError(f"{messages} messages in chunks with an index, where its statistics say {stated}")


def _chunk_records(stream: BinaryIO, position: int) -> list[McapRecord]:
    """The records of a chunk, decompressed."""
    stream.seek(position)
    opcode, size = RECORD_HEAD.unpack(stream.read(RECORD_HEAD.size))
    if opcode != Opcode.CHUNK or size > LARGEST_RECORD_BYTES:
        raise McapError(f"a record of kind {opcode} with {size} bytes at byte {position}, where its index has a chunk")
    chunk = Chunk.read(ReadDataStream(BytesIO(stream.read(size))))
    if chunk.uncompressed_size > LARGEST_RECORD_BYTES:
        raise McapError(f"a chunk of {chunk.uncompressed_size} bytes, where {LARGEST_RECORD_BYTES} are the most")
    if chunk.compression:
        chunk.data = _decompressed(chunk.data, chunk.compression, chunk.uncompressed_size)
        chunk.compression = ""
    if len(chunk.data) != chunk.uncompressed_size:
        raise McapError(f"a chunk of {len(chunk.data)} bytes, where it states {chunk.uncompressed_size}")
    return breakup_chunk(chunk, validate_crc=True)


def _decompressed(data: bytes, compression: str, most_bytes: int) -> bytes:
    """Decompress at most so many bytes; the functions that do it in one call would allocate what the data asks for."""
    if compression not in DECOMPRESSORS:
        raise McapError(f"the unknown compression {compression[:20]!r}")
    decompressor = DECOMPRESSORS[compression]()
    result: bytes = decompressor.decompress(data, max_length=most_bytes + 1)
    if len(result) > most_bytes or not decompressor.eof:
        raise McapError(f"{compression} data of more than {most_bytes} bytes or cut short")
    return result


def _mcap_message(file: Path, position: Position) -> bytes:
    state = file.stat()
    records = _cached_chunk(file, (state.st_size, state.st_mtime_ns), position.chunk)
    record = records[position.offset] if position.offset < len(records) else None
    if not isinstance(record, Message):
        raise McapError("another record; did the file change?")
    return record.data


@lru_cache(maxsize=2)  # the next image is in the same chunk or the next one, and sweeps are read between
def _cached_chunk(file: Path, _: tuple[int, int], position: int) -> list[McapRecord]:
    """A chunk of a file of this size and time of change."""
    with file.open("rb") as stream:
        return _chunk_records(stream, position)


# SQLite


def _sqlite_messages(file: Path, start_bytes: Mapping[str, int]) -> Iterator[tuple[Topic, int, Position, bytes]]:
    log = file.with_name(f"{file.name}-wal")
    if log.is_file() and log.stat().st_size:
        hint = f"merge it: sqlite3 {file.name} 'PRAGMA wal_checkpoint(TRUNCATE)'"
        raise DataError(file, expected="all messages in it", got=f"the last ones still in {log.name}", hint=hint)
    with closing(_connected(file)) as connection:
        topics = _sqlite_topics(connection, file)
        query = "SELECT id, topic_id, timestamp, length(data) FROM messages ORDER BY id"
        for row, topic_id, log_ns, size in connection.execute(query):
            topic, numbers = topics.get(topic_id), all(isinstance(value, int) for value in (row, log_ns, size))
            if topic is None or not numbers or size > LARGEST_MESSAGE_BYTES:
                raise sqlite3.DataError(f"the row {(row, topic_id, log_ns, size)!r} of the table messages")
            position = Position(NO_CHUNK, row, size)
            yield topic, log_ns, position, _blob(connection, row, min(size, start_bytes.get(topic.name, 0)))


def _sqlite_message(file: Path, position: Position) -> bytes:
    with closing(_connected(file)) as connection:
        return _blob(connection, position.offset, position.size)


def _connected(file: Path) -> sqlite3.Connection:
    """Open for reading only; nothing is written beside the file, and its schema is not trusted."""
    file.open("rb").close()  # SQLite does not say why it cannot open a file
    connection = sqlite3.connect(f"file:{quote(str(file.resolve()))}?mode=ro&immutable=1", uri=True)
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_MESSAGE_BYTES)
    connection.execute("PRAGMA trusted_schema = OFF")
    return connection


def _sqlite_topics(connection: sqlite3.Connection, file: Path) -> dict[object, Topic]:
    # Views and virtual tables, which have no root page, could compute forever.
    query = "SELECT name FROM sqlite_master WHERE type = 'table' AND rootpage > 0"
    tables = {name for (name,) in connection.execute(query)}
    if not {"topics", "messages"} <= tables:
        got = ", ".join(sorted(map(str, tables)))[:200] or "no tables"
        raise DataError(file, expected="the tables topics and messages, as in a bag of ROS 2", got=got)
    definitions: dict[object, str] = {}
    if "message_definitions" in tables:
        query = "SELECT topic_type, encoded_message_definition FROM message_definitions WHERE encoding = 'ros2msg'"
        definitions = {kind: str(text) for kind, text in _bounded_rows(connection, query)}
    query = "SELECT id, name, type, serialization_format FROM topics"
    return {
        row: Topic(full_name(str(name)), str(kind), str(encoding), definitions.get(kind, ""))
        for row, name, kind, encoding in _bounded_rows(connection, query)
    }


def _bounded_rows(connection: sqlite3.Connection, query: str) -> Iterator[tuple[Any, ...]]:
    """Rows of topics or definitions; generated columns could make more than the file holds."""
    size = 0
    for row in connection.execute(query):
        size += sum(len(str(value)) for value in row)
        if size > LARGEST_DEFINITIONS_BYTES:
            raise sqlite3.DataError(f"topics and definitions of more than {LARGEST_DEFINITIONS_BYTES} bytes")
        yield row


def _blob(connection: sqlite3.Connection, row: int, size: int) -> bytes:
    """The first bytes of a message, without reading the rest of it."""
    if not size:
        return b""
    with connection.blobopen("messages", "data", row, readonly=True) as blob:
        return blob.read(size)
