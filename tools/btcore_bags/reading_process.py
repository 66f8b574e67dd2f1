"""Read a bag of ROS 2 with the package rosbags, in a process with limits of memory and processor time.

rosbags trusts a bag: it decompresses chunks of any size, computes the constants in the definitions of
messages, and runs Python code that it makes of the definitions. The process sends only the bytes of messages;
reader.py decodes them by known definitions.

The file runs as a script, and imports only the standard library and rosbags, so that the process starts fast.
At its standard input it receives lines of JSON: first a `ReadingTask`, then the number and the topics of an
iteration for each batch of messages. It answers at its standard output: first the facts of the bag, then the
batches. An answer is a letter (J: JSON, M: messages), the number of bytes (64 bits), and the bytes.
"""

import json
import math
import struct
import sys
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

MAX_CHUNK = 1 << 28
"""The greatest size (bytes) of a chunk of a bag after decompression."""

MAX_MESSAGE = 1 << 26
"""The greatest size (bytes) of a message."""

MAX_TOPICS = 10_000
"""The greatest number of topics."""

OPTIONAL = (
    ("nav2_msgs/msg/BehaviorTreeStatusChange", "uid"),
    ("sensor_msgs/msg/Range", "variance"),
)
"""The fields that older releases of ROS 2 lack, as (type, field)."""

RECORD = struct.Struct("<IqI")
"""The head of a message in a batch: the position of its topic, its stamp (ns), and its number of bytes."""

ANSWER = struct.Struct("<cQ")
"""The head of an answer."""

_BATCH = 1 << 20  # bytes of messages after which a batch ends
_MAX_REASON = 200  # the greatest length of an error message of rosbags that is quoted

Message = tuple[str, int, bytes]
"""A message: its topic, its stamp (ns), and its content."""


class ReadingTask(NamedTuple):
    """The first message to the process.

    Attributes:
        path: The file.
        definitions: As in `BagSource`.
        memory: The limit of memory (bytes).
        cpu_seconds: The limit of processor time for each batch (s).
    """

    path: str
    definitions: dict[str, str]
    memory: int
    cpu_seconds: int


class BagError(Exception):
    """The bag is damaged, or not supported."""


class BagSource:
    """The messages of a bag, read in this process.

    A bag contains the definitions of its messages. A message type can be read if each field is the known one,
    except that older releases of ROS 2 lack some fields.

    Args:
        path: The file.
        definitions: The definitions of message types that are not in the common packages of ROS 2, by type.

    Attributes:
        topics: The type of each topic, for example `sensor_msgs/msg/LaserScan`.
        problems: Why the messages of a type cannot be read, by type.
        absent: The known fields that the bag's definitions lack, as (type, field).

    Raises:
        BagError: The file cannot be read.
    """

    def __init__(self, path: Path, definitions: Mapping[str, str]) -> None:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        _limit_chunks()
        _accept_other_schemas()
        known = get_typestore(Stores.ROS2_KILTED)
        for name, definition in definitions.items():
            known.register(get_types_from_msg(definition, name))
        self._known = known.fielddefs
        self.topics: dict[str, str] = {}
        self.problems: dict[str, str] = {}
        self.absent: set[tuple[str, str]] = set()
        try:
            self._reader = AnyReader([path], default_typestore=known)
            self._reader.open()
            for connection in self._reader.connections:
                message_type = self.topics.setdefault(connection.topic, connection.msgtype)
                if message_type != connection.msgtype:
                    types = f"{message_type} and {connection.msgtype}"
                    raise BagError(f"the topic {connection.topic} has two types: {types}")
                if len(self.topics) > MAX_TOPICS:
                    raise BagError(f"more than {MAX_TOPICS} topics")
        except Exception as error:
            raise explain(error) from None
        checked: set[str] = set()
        for message_type in set(self.topics.values()):
            try:
                self._check_definition(message_type, checked)
            except Exception as error:
                self.problems[message_type] = str(explain(error))

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Yield the messages on *topics* in the order of their stamps.

        Raises:
            BagError: The file is damaged.
        """
        connections = [each for each in self._reader.connections if each.topic in topics]
        if not connections:
            return
        try:
            for connection, stamp, data in self._reader.messages(connections=connections):
                if len(data) > MAX_MESSAGE:
                    raise BagError(f"a message of {len(data)} bytes is larger than {MAX_MESSAGE}")
                yield connection.topic, stamp, bytes(data)
        except Exception as error:
            raise explain(error) from None

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    def _check_definition(self, message_type: str, checked: set[str]) -> None:
        """Check that a message type, and the types within, have the known fields with the known types."""
        if message_type in checked:
            if message_type in self.problems:
                raise BagError(self.problems[message_type])
            return
        checked.add(message_type)
        if message_type not in self._known:
            raise BagError(f"unknown message type {message_type}")
        expected = dict(self._known[message_type][1])
        own = dict(self._reader.typestore.fielddefs[message_type][1])
        for field in (*expected, *own):
            if field not in own and (message_type, field) in OPTIONAL:
                self.absent.add((message_type, field))
            elif expected.get(field) != own.get(field):
                raise BagError(f"the field '{field}' of {message_type} is defined otherwise than in ROS 2")
        for description in own.values():
            for name in _types_within(description):
                self._check_definition(name, checked)


def explain(error: Exception) -> BagError:
    """Return the error of a file for an error of rosbags, which raises exceptions of many classes."""
    if isinstance(error, BagError):
        return error
    if isinstance(error, MemoryError):
        return BagError("reading this bag needs too much memory")
    reason = (str(error) or type(error).__name__).splitlines()[0][:_MAX_REASON]
    return BagError(f"not a complete bag of ROS 2: {reason}")


def _types_within(description: Any) -> Iterator[str]:
    """Yield the message types in the description of a field."""
    from rosbags.interfaces import Nodetype

    node_type, content = description
    if node_type == Nodetype.NAME:
        yield content
    elif node_type in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        yield from _types_within(content[0])


def _limit_chunks() -> None:
    """Let rosbags decompress a chunk only up to the size that the file declares, and up to `MAX_CHUNK`.

    rosbags 0.11 compares the sizes afterwards, when a small chunk may already fill the memory.
    """
    from lz4.frame import LZ4FrameDecompressor
    from rosbags.rosbag2 import storage_mcap

    zstd: Any = vars(storage_mcap)["zstd"]  # of the standard library from Python 3.14

    for name, decompressor in (("lz4", LZ4FrameDecompressor), ("zstd", zstd.ZstdDecompressor)):
        # A variable of a loop would be that of the last format.
        def decompress(data: bytes, size: int, decompressor: Any = decompressor) -> bytes:
            if size > MAX_CHUNK:
                raise ValueError(f"a chunk of {size} bytes is larger than {MAX_CHUNK}")
            return bytes(decompressor().decompress(data, max_length=size))

        storage_mcap.DECOMPRESSORS[name] = decompress


def _accept_other_schemas() -> None:
    """Let rosbags read a bag that also has channels of other encodings, such as a recording of btcore."""
    from rosbags.rosbag2 import storage_mcap

    get_definition = storage_mcap.get_msgdef

    def get_known_definition(schema: Any) -> Any:
        is_known = schema is not None and schema.encoding in ("ros2msg", "ros2idl", "omgidl", "")
        return get_definition(schema if is_known else None)

    storage_mcap.get_msgdef = get_known_definition


def _serve(requests: Iterator[bytes], cpu_seconds: int, source: BagSource) -> None:
    """Answer *requests* with batches of messages."""
    numbers = {topic: number for number, topic in enumerate(source.topics)}
    iterations: dict[int, Iterator[Message]] = {}
    for line in requests:
        _limit_time(cpu_seconds)
        iteration, topics = json.loads(line)
        messages = iterations.setdefault(iteration, source.messages(topics))
        batch = bytearray()
        for topic, stamp, data in messages:
            batch += RECORD.pack(numbers[topic], stamp, len(data)) + data
            if len(batch) >= _BATCH:
                break
        _answer(b"M", bytes(batch))


def _answer(format: bytes, data: bytes) -> None:
    sys.stdout.buffer.write(ANSWER.pack(format, len(data)) + data)
    sys.stdout.buffer.flush()


def _limit_time(cpu_seconds: int) -> None:
    """End this process after *cpu_seconds* s of processor time from now on."""
    if sys.platform != "win32":
        import resource

        used = resource.getrusage(resource.RUSAGE_SELF)
        limit = math.ceil(used.ru_utime + used.ru_stime) + cpu_seconds
        resource.setrlimit(resource.RLIMIT_CPU, (limit, resource.getrlimit(resource.RLIMIT_CPU)[1]))


def _main() -> None:
    requests = iter(sys.stdin.buffer.readline, b"")
    task = ReadingTask(**json.loads(next(requests)))
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_DATA, (task.memory, task.memory))
    _limit_time(task.cpu_seconds)
    try:
        source = BagSource(Path(task.path), task.definitions)
        facts = {"topics": source.topics, "problems": source.problems, "absent": sorted(source.absent)}
        _answer(b"J", json.dumps(facts).encode())
        _serve(requests, task.cpu_seconds, source)
    except ModuleNotFoundError as error:
        _answer(b"J", json.dumps({"missing": error.name}).encode())
    except Exception as error:
        _answer(b"J", json.dumps({"error": str(explain(error))}).encode())


if __name__ == "__main__":
    _main()
