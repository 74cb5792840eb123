"""Messages of ROS 2, decoded from CDR with the package `rosbags`, and what all of them share."""

from __future__ import annotations

import re
import struct
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.errors import DataError
from bench.recordings.rosbag.storage import Topic

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

IMAGE, COMPRESSED_IMAGE = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
ODOMETRY = "nav_msgs/msg/Odometry"
POSES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped")
TRANSFORMS = "tf2_msgs/msg/TFMessage"
HEADER = "std_msgs/msg/Header"
TYPE_NAME = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*){1,2}", re.ASCII)
SECOND_NS = 1_000_000_000


def decode(topic: Topic, payload: bytes, *, file: Path) -> Any:
    """Decode a message.

    Args:
        topic: that it was sent on.
        payload: its bytes.
        file: for messages.

    Returns:
        An object with the fields of the message type; arrays of numbers are numpy arrays.

    Raises:
        DataError: an unknown type or encoding, or bytes that are no such message.
    """
    types = _types(topic, file)
    try:
        return types.deserialize_cdr(payload, message_type(topic))
    except Exception as error:  # the decoder raises what its reading of wrong bytes happens to raise
        if isinstance(error, MemoryError):
            raise
        got = f"{len(payload)} bytes that are none ({type(error).__name__})"
        raise DataError(file, field=topic.name, expected=f"a message {topic.message_type}", got=got) from error


def message_type(topic: Topic) -> str:
    """The message type in the form "package/msg/Name"."""
    words = topic.message_type.split("/")
    return topic.message_type if len(words) == 3 else f"{words[0]}/msg/{words[-1]}"


def has_header(topic: Topic, *, file: Path) -> bool:
    """Whether messages of a topic begin with a header, and so with a time.

    Raises:
        DataError: an unknown type or encoding.
    """
    fields = _types(topic, file).fielddefs[message_type(topic)][1]
    return bool(fields) and fields[0][1][1] == HEADER


def header_stamp_ns(head: bytes) -> int | None:
    """The time in the header that a message begins with.

    Args:
        head: the first bytes of the message, in CDR: four that tell the order of bytes, seconds, nanoseconds.

    Returns:
        ns; None where there is no time that a clock can show. 0 is the one of a driver that sets none.
    """
    if len(head) < 12 or head[0] != 0 or head[1] not in (0, 1):
        return None
    seconds, rest_ns = struct.unpack_from("<iI" if head[1] else ">iI", head, 4)
    return None if seconds < 0 or rest_ns >= SECOND_NS else seconds * SECOND_NS + rest_ns


def number_at(message: Any, path: str, *, file: Path, topic: str) -> Any:
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
            got = f"none called {word!r}; there are {known}" if known else f"none called {word!r}"
            raise DataError(file, field=topic, expected=f"the field {path}", got=got) from None
    return value


def _types(topic: Topic, file: Path) -> Typestore:
    """Types that know the topic's, from ROS 2 itself or from the definition in the file."""
    if topic.encoding != "cdr":
        got = repr(topic.encoding[:40])
        raise DataError(file, field=topic.name, expected="messages in CDR, as ROS 2 records them", got=got)
    name = message_type(topic)
    if TYPE_NAME.fullmatch(topic.message_type) is None:
        got = repr(topic.message_type[:80])
        raise DataError(file, field=topic.name, expected="the name of a message type", got=got)
    if name in _standard().fielddefs:
        return _standard()
    if not topic.definition:
        do = "record with MCAP, or with ROS 2 Iron or later, which store the definitions of messages"
        raise DataError(
            file, field=topic.name, expected=f"the definition of {name}", got="none that is read here", do=do
        )
    try:
        return _defined(name, topic.definition)
    except Exception as error:
        if isinstance(error, MemoryError):
            raise
        got = f"text that is none ({type(error).__name__})"
        raise DataError(file, field=topic.name, expected=f"the definition of {name}", got=got) from error


@cache
def _standard() -> Typestore:
    from rosbags.typesys import Stores, get_typestore  # 0.3 s, and only bags need it

    return get_typestore(Stores.ROS2_HUMBLE)


@cache
def _defined(name: str, definition: str) -> Typestore:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    parsed = get_types_from_msg(definition, name)
    types.register({key: value for key, value in parsed.items() if key not in types.fielddefs})
    return types
