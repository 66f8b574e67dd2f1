"""Reading messages from bags of ROS 2 with the package rosbags.

Bags may come from elsewhere, so a damaged or hostile file raises a LogError, and needs little memory. A bag
contains the definitions of its messages. They are used, because a few differ between releases of ROS 2, but
only after a check that each field is the known one.
"""

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from btcore.logs.files import LogError, read_bytes

MAX_CHUNK: Final = 1 << 28
"""The greatest size (bytes) of a chunk of a bag after decompression."""

OPTIONAL: Final = (
    ("nav2_msgs/msg/BehaviorTreeStatusChange", "uid"),
    ("sensor_msgs/msg/Range", "variance"),
)
"""The fields that older releases of ROS 2 lack, as (type, field)."""

_BIG_ENDIAN, _LITTLE_ENDIAN = b"\x00\x00", b"\x00\x01"

_MAX_REASON: Final = 200
"""The greatest length of an error message of rosbags that is quoted."""


class BagReader:
    """The messages of a bag in the format MCAP. Close it after use, or use it as a context.

    Args:
        path: The file.
        definitions: The definitions of message types that are not in the common packages of ROS 2, by type.

    Attributes:
        path: The file.
        topics: The type of each topic, for example `sensor_msgs/msg/LaserScan`.

    Raises:
        LogError: The file cannot be read, or the package rosbags is not installed.
    """

    def __init__(self, path: Path, definitions: Mapping[str, str] | None = None) -> None:
        self.path = path
        read_bytes(path, 1)  # explains why a file cannot be read
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_types_from_msg, get_typestore
        except ModuleNotFoundError as missing:
            raise LogError(
                f"{path}: reading a bag needs the package {missing.name}: pip install 'btcore[bags]'"
            ) from None
        _limit_chunks()
        known = get_typestore(Stores.ROS2_KILTED)
        for name, definition in (definitions or {}).items():
            known.register(get_types_from_msg(definition, name))
        self._known = known.fielddefs
        self._checked: set[str] = set()
        with self._explained():
            self._reader = AnyReader([path], default_typestore=known)
            self._reader.open()
        self.topics: dict[str, str] = {}
        for connection in self._reader.connections:
            kind = self.topics.setdefault(connection.topic, connection.msgtype)
            if kind != connection.msgtype:
                types = f"{kind} and {connection.msgtype}"
                raise LogError(f"{path}: the topic {connection.topic} has two types: {types}")

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """Yield the messages on *topics* in the order of their stamps: topic, stamp (ns), and content.

        Args:
            topics: The topics; those that the bag does not contain are ignored.

        Raises:
            LogError: The file is damaged.
        """
        connections = [each for each in self._reader.connections if each.topic in topics]
        if not connections:
            return
        with self._explained():
            for connection, stamp, data in self._reader.messages(connections=connections):
                yield connection.topic, stamp, data

    def decode(self, topic: str, data: bytes) -> Any:
        """Return a message.

        Args:
            topic: The topic of the message.
            data: The content of the message.

        Raises:
            LogError: The message is damaged, or its definition is not that of ROS 2.
        """
        kind = self.topics[topic]
        with self._explained():
            self._check_definition(kind)
            types = self._reader.typestore
            if data[:2] not in (_BIG_ENDIAN, _LITTLE_ENDIAN):
                raise LogError(f"{self.path}: a message on {topic} is not in the encoding CDR")
            # Typestore.deserialize_cdr refuses the bytes that rclpy's serialize_message may add at the end.
            definition = types.get_msgdef(kind)
            is_little = data[:2] == _LITTLE_ENDIAN
            read = definition.deserialize_cdr_le if is_little else definition.deserialize_cdr_be
            message, _ = read(data[4:], 0, definition.cls, types)
            return message

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    def __enter__(self) -> "BagReader":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Return a context in which an error of rosbags becomes a LogError."""
        try:
            yield
        except LogError:
            raise
        except Exception as error:  # for a damaged file, rosbags raises exceptions of many classes
            reason = (str(error) or type(error).__name__).splitlines()[0][:_MAX_REASON]
            raise LogError(f"{self.path}: not a complete bag of ROS 2: {reason}") from None

    def _check_definition(self, kind: str) -> None:
        """Check that a message type, and the types within, have the known fields with the known types."""
        if kind in self._checked:
            return
        self._checked.add(kind)
        if kind not in self._known:
            raise LogError(f"{self.path}: unknown message type {kind}")
        known, found = dict(self._known[kind][1]), dict(self._reader.typestore.fielddefs[kind][1])
        for field in (*known, *found):
            is_absent = field not in found and (kind, field) in OPTIONAL
            if known.get(field) != found.get(field) and not is_absent:
                raise LogError(
                    f"{self.path}: the field '{field}' of {kind} is defined otherwise than in ROS 2"
                )
        for description in found.values():
            for name in _types_within(description):
                self._check_definition(name)


def _types_within(description: Any) -> Iterator[str]:
    """Yield the message types in the description of a field."""
    from rosbags.interfaces import Nodetype

    kind, content = description
    if kind == Nodetype.NAME:
        yield content
    elif kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        yield from _types_within(content[0])


def _limit_chunks() -> None:
    """Let rosbags decompress a chunk only up to the size that the file declares, and up to `MAX_CHUNK`.

    rosbags 0.11 compares the sizes afterwards, when a small chunk may already fill the memory.
    """
    from rosbags.rosbag2 import storage_mcap

    zstd: Any = vars(storage_mcap)["zstd"]  # of the standard library from Python 3.14

    def decompress(data: bytes, size: int) -> bytes:
        if size > MAX_CHUNK:
            raise ValueError(f"a chunk of {size} bytes is larger than {MAX_CHUNK}")
        return bytes(zstd.ZstdDecompressor().decompress(data, max_length=size))

    storage_mcap.DECOMPRESSORS["zstd"] = decompress
