"""SQLite files of ROS 2 bags (`.db3`): where their messages lie, also in files that were cut short or damaged."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

from bench.errors import DataError
from bench.recordings.rosbag.storage import (
    HEAD_BYTES,
    LARGEST_MESSAGE_BYTES,
    LARGEST_WHOLE_BYTES,
    NOT_CHUNKED,
    Place,
    ScanReport,
    StoredMessage,
    Topic,
    Wanted,
)

ROWS = "SELECT id, topic_id, timestamp, length(data) FROM messages"
BEYOND = 2**63 - 1


def scan_sqlite(file: Path, expected: Wanted, report: ScanReport) -> Iterator[StoredMessage]:
    """Find the messages of a file, in the order in which they were written.

    A damaged page ends the walk from the front; a second walk from the back then finds what lies behind it.

    Args:
        file: the file.
        expected: which messages are given.
        report: takes the topics, the counts of all messages, and what cannot be read.

    Raises:
        DataError: it cannot be opened, or is no database of messages.
    """
    log = file.with_name(file.name + "-wal")
    if log.is_file() and log.stat().st_size:
        do = f"let SQLite bring them home: sqlite3 {file.name} 'PRAGMA wal_checkpoint(TRUNCATE)'"
        report.losses.append(
            DataError(file, expected="all messages in it", got=f"the last ones still in {log.name}", do=do)
        )
    with closing(_connected(file)) as connection:
        topics = _topics(connection, file)
        for topic in topics.values():
            report.add_topic(topic)
        yield from _Walk(file, connection, topics, expected, report).messages()


def read_sqlite_message(file: Path, place: Place) -> bytes:
    """Read one message.

    Raises:
        DataError: it cannot be read.
    """
    with closing(_connected(file)) as connection:
        try:
            data = _blob(connection, place.offset, place.size)
        except sqlite3.Error as error:
            raise DataError(
                file, field=f"messages, row {place.offset}", expected="a message", got=str(error)
            ) from error
    if len(data) != place.size:
        got = f"{len(data)}; did the file change?"
        raise DataError(
            file, field=f"messages, row {place.offset}", expected=f"a message of {place.size} bytes", got=got
        )
    return data


class _Walk:
    """The rows of a database, from the front and, behind damage, from the back."""

    def __init__(
        self, file: Path, connection: sqlite3.Connection, topics: dict[int, Topic], expected: Wanted, report: ScanReport
    ) -> None:
        self.file, self.connection, self.topics = file, connection, topics
        self.expected, self.report = expected, report
        self.last_row, self.last_ns = -BEYOND, 0
        self.odd: list[str] = []

    def messages(self) -> Iterator[StoredMessage]:
        """Every wanted message that can be read, by its row."""
        try:
            for row in self.connection.execute(f"{ROWS} ORDER BY id"):
                self.last_row = int(row[0])
                yield from self._message(row)
        except sqlite3.Error as error:
            yield from self._behind(str(error))
        if self.odd:
            got = f"{len(self.odd)} others, the first {self.odd[0]}"
            self._lose("messages", f"rows of a known topic, with a time and at most {LARGEST_MESSAGE_BYTES} bytes", got)

    def _behind(self, damage: str) -> Iterator[StoredMessage]:
        rows: list[tuple[int, ...]] = []
        try:
            for row in self.connection.execute(f"{ROWS} WHERE id > ? ORDER BY id DESC", (self.last_row,)):
                rows.append(row)  # noqa: PERF402 - what came before the damage is wanted
        except sqlite3.Error:
            pass
        told = f"; what was recorded after {self.last_ns}" if self.last_ns else "; all"
        if rows:
            told += f" and before {rows[-1][2]}"
        self._lose("messages", "rows that can be read", f"{damage}{told} is lost")
        for row in reversed(rows):
            yield from self._message(row)

    def _message(self, row: tuple[object, ...]) -> Iterator[StoredMessage]:
        number, topic_id, log_ns, size = row
        topic = self.topics.get(topic_id) if isinstance(topic_id, int) else None
        sound = isinstance(number, int) and isinstance(log_ns, int) and isinstance(size, int)
        if topic is None or not sound or not 0 <= size <= LARGEST_MESSAGE_BYTES:  # type: ignore[operator]
            self.odd.append(repr(row)[:100])
            return
        assert isinstance(number, int)
        assert isinstance(log_ns, int)
        assert isinstance(size, int)
        payload = b""
        if topic.name in self.expected.whole or topic.name in self.expected.heads:
            most = LARGEST_WHOLE_BYTES if topic.name in self.expected.whole else HEAD_BYTES
            try:
                payload = _blob(self.connection, number, min(size, most))
            except sqlite3.Error as error:
                self._lose(f"messages, row {number}", "a message", f"{error}; the one of {log_ns} is lost")
                return
        self.last_ns = log_ns
        self.report.count(topic.name)
        if payload:
            yield StoredMessage(topic.name, log_ns, Place(NOT_CHUNKED, number, size), payload)

    def _lose(self, field: str, expected: str, got: str) -> None:
        self.report.losses.append(DataError(self.file, field=field, expected=expected, got=got))


def _connected(file: Path) -> sqlite3.Connection:
    """Open for reading only; nothing is written beside the file, and its schema is not trusted."""
    try:
        with file.open("rb") as stream:
            start = stream.read(15)
        if start != b"SQLite format 3":
            got = f"one that begins with {start.hex(' ')}" if start else "an empty file"
            raise DataError(file, expected="an SQLite database", got=got)
        connection = sqlite3.connect(f"file:{quote(str(file.resolve()))}?mode=ro&immutable=1", uri=True)
        connection.execute("PRAGMA trusted_schema = OFF")
        # With it SQLite takes a database that is shorter than its head says, as one that was cut short is.
        connection.execute("PRAGMA writable_schema = ON")
    except OSError as error:
        raise DataError(file, expected="a readable file", got=error.strerror or str(error)) from error
    except sqlite3.Error as error:
        raise DataError(file, expected="an SQLite database", got=str(error)) from error
    return connection


def _topics(connection: sqlite3.Connection, file: Path) -> dict[int, Topic]:
    try:
        tables = {
            name
            for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table' AND rootpage > 0")
        }
        if not {"topics", "messages"} <= tables:
            got = ", ".join(sorted(map(str, tables)))[:200] or "no tables"
            raise DataError(file, expected="the tables topics and messages, as in a bag of ROS 2", got=got)
        definitions: dict[object, str] = {}
        if "message_definitions" in tables:
            query = "SELECT topic_type, encoded_message_definition FROM message_definitions WHERE encoding = 'ros2msg'"
            definitions = {kind: str(text) for kind, text in connection.execute(query)}
        return {
            int(number): Topic(
                name=str(name), message_type=str(kind), encoding=str(encoding), definition=definitions.get(kind, "")
            )
            for number, name, kind, encoding in connection.execute(
                "SELECT id, name, type, serialization_format FROM topics"
            )
        }
    except (sqlite3.Error, ValueError) as error:
        raise DataError(file, field="topics", expected="topics that can be read", got=str(error)) from error


def _blob(connection: sqlite3.Connection, row: int, size: int) -> bytes:
    """The first bytes of a message, without reading the rest of it."""
    if size == 0:
        return b""
    with connection.blobopen("messages", "data", row, readonly=True) as blob:
        return blob.read(size)
