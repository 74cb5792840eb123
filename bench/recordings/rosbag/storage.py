"""Messages as the files of a bag store them, whatever the kind of file."""

from __future__ import annotations

from dataclasses import dataclass, field

from bench.errors import DataError

HEAD_BYTES = 64  # of a message: enough for the time in its header
LARGEST_MESSAGE_BYTES = 1 << 28  # an image of 8192 x 8192 px in four channels
LARGEST_WHOLE_BYTES = 1 << 22  # of a message that is read whole while the index is made: speeds, poses, frames
NOT_CHUNKED = -1


@dataclass(frozen=True, slots=True)
class Place:
    """Where a message lies in its file.

    Attributes:
        chunk: where its chunk begins; `NOT_CHUNKED` where it lies in none.
        offset: of the message's bytes in the unpacked chunk, or in the file; in a database the number of its row.
        size: bytes of the message, as stored.
    """

    chunk: int
    offset: int
    size: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic:
    """What a file says of a topic.

    Attributes:
        name: such as "/camera/front".
        message_type: such as "sensor_msgs/msg/Image".
        encoding: of its messages; ROS 2 has "cdr".
        definition: of the message type, in ROS's .msg form; empty where the file has none.
    """

    name: str
    message_type: str
    encoding: str = "cdr"
    definition: str = ""


@dataclass(frozen=True, slots=True)
class StoredMessage:
    """One message, found but not decoded.

    Attributes:
        topic: its name.
        log_ns: when it was recorded.
        place: where it lies.
        payload: all of it for topics that are read whole, else the first `HEAD_BYTES`.
    """

    topic: str
    log_ns: int
    place: Place
    payload: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """Which messages a scan gives.

    Attributes:
        heads: topics of which only the place and the time are wanted.
        whole: topics whose messages are wanted whole.
    """

    heads: frozenset[str]
    whole: frozenset[str]


@dataclass(slots=True)
class ScanReport:
    """What a scan learns on its way.

    Attributes:
        topics: by name, every topic of the file; one that has two message types is in `mixed`.
        counts: messages found, by topic, wanted or not.
        losses: what could not be read.
        mixed: topics with messages of more than one type.
    """

    topics: dict[str, Topic] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    losses: list[DataError] = field(default_factory=list)
    mixed: dict[str, set[str]] = field(default_factory=dict)

    def add_topic(self, topic: Topic) -> None:
        """Note a topic, once or again."""
        known = self.topics.setdefault(topic.name, topic)
        if known.message_type != topic.message_type:
            self.mixed.setdefault(topic.name, {known.message_type}).add(topic.message_type)

    def count(self, topic: str) -> None:
        """Note a message."""
        self.counts[topic] = self.counts.get(topic, 0) + 1
