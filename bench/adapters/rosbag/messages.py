"""Messages of ROS 2: decoded from CDR by the package `rosbags`, and the times that they carry."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.errors import DataError
from bench.times import SECOND_NS

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

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
