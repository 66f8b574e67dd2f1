"""Reading messages from bags of ROS 2 with the package rosbags.

Bags may come from elsewhere, so a damaged or hostile file raises a LogError. The file is read in a process
with limits (reading_process.py), unless this process has limits itself. A bag contains the definitions of its
messages; the messages are decoded by the known definitions of ROS 2, if both agree.
"""

import json
import os
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from btcore.extras import install_command
from btcore.logs.files import LogError, read_bytes
from btcore.signals import NEW_PROCESS_GROUP
from btcore_bags import reading_process
from btcore_bags.reading_process import ANSWER, RECORD, BagError, BagSource, Message, ReadingTask

MAX_MEMORY: Final = 1 << 30
"""The greatest size (bytes) of the data of the process that reads a bag."""

MAX_CPU_S: Final = 60
"""The longest processor time (s) of that process for opening the bag, and then for 1 MB of messages."""

_BIG_ENDIAN, _LITTLE_ENDIAN = b"\x00\x00", b"\x00\x01"


class BagReader:
    """The messages of a bag in the format MCAP. Close it after use, or use it as a context.

    Args:
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
        definitions = definitions or {}
        try:
            from rosbags.typesys import Stores, get_types_from_msg, get_typestore

            self._source = _open(path, definitions)
            self._types: Any = get_typestore(Stores.ROS2_KILTED)
        except ModuleNotFoundError as missing:
            raise LogError(
                f"{path}: reading a bag needs the package {missing.name}: {install_command('rosbags')}"
            ) from None
        except BagError as error:
            raise LogError(f"{path}: {error}") from None
        added = {}
        for name, definition in definitions.items():
            added.update(get_types_from_msg(definition, name))
        # Types of older releases are registered without the fields that they lack.
        for message_type in {message_type for message_type, _ in self._source.absent}:
            constants, fields = added.get(message_type) or self._types.fielddefs.pop(message_type)
            present = [field for field in fields if (message_type, field[0]) not in self._source.absent]
            added[message_type] = (constants, present)
        self._types.register(added)
        self.topics = self._source.topics

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Yield the messages on *topics* in the order of their stamps: topic, stamp (ns), and content.

        Args:
            topics: The topics; those that the bag does not contain are ignored.

        Raises:
            LogError: The file is damaged.
        """
        try:
            yield from self._source.messages(topics)
        except BagError as error:
            raise LogError(f"{self.path}: {error}") from None

    def decode(self, topic: str, data: bytes) -> Any:
        """Return a message.

        Args:
            topic: The topic of the message.
            data: The content of the message.

        Raises:
            LogError: The message is damaged, or its definition is not that of ROS 2.
        """
        message_type = self.topics[topic]
        if message_type in self._source.problems:
            raise LogError(f"{self.path}: {self._source.problems[message_type]}")
        if data[:2] not in (_BIG_ENDIAN, _LITTLE_ENDIAN):
            raise LogError(f"{self.path}: a message on {topic} is not in the encoding CDR")
        try:
            # Typestore.deserialize_cdr refuses the bytes that rclpy's serialize_message may add at the end.
            definition = self._types.get_msgdef(message_type)
            is_little = data[:2] == _LITTLE_ENDIAN
            read = definition.deserialize_cdr_le if is_little else definition.deserialize_cdr_be
            message, _ = read(data[4:], 0, definition.cls, self._types)
        except Exception as error:  # for a damaged message, rosbags raises exceptions of many classes
            raise LogError(f"{self.path}: {reading_process.explain(error)}") from None
        return message

    def close(self) -> None:
        """Close the file."""
        self._source.close()

    def __enter__(self) -> "BagReader":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _BagProcess:
    """A `BagSource` in a process with limits."""

    def __init__(self, path: Path, definitions: Mapping[str, str]) -> None:
        self._iterations = 0
        self._process = subprocess.Popen(
            # -P: a module beside the script must not replace one of the standard library.
            [sys.executable, "-P", reading_process.__file__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            creationflags=NEW_PROCESS_GROUP,
            # The threads of OpenBLAS would need memory.
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        )
        task = ReadingTask(str(path.absolute()), dict(definitions), MAX_MEMORY, MAX_CPU_S)
        try:
            facts = json.loads(self._request(task._asdict()))
        except BaseException:
            self.close()
            raise
        self.topics: dict[str, str] = facts["topics"]
        self.problems: dict[str, str] = facts["problems"]
        self.absent = {(message_type, field) for message_type, field in facts["absent"]}

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        self._iterations += 1
        request = [self._iterations, list(topics)]
        names = list(self.topics)
        while batch := self._request(request):
            at = 0
            while at < len(batch):
                number, stamp, size = RECORD.unpack_from(batch, at)
                at += RECORD.size + size
                yield names[number], stamp, batch[at - size : at]

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            pipe.close()

    def _request(self, request: object) -> bytes:
        """Send a request, and return the answer."""
        requests, answers = self._process.stdin, self._process.stdout
        assert requests is not None
        assert answers is not None
        # Windows cannot limit the processor time of a process.
        timer = threading.Timer(MAX_CPU_S, self._process.kill)
        if sys.platform == "win32":
            timer.start()
        try:
            requests.write(json.dumps(request).encode() + b"\n")
            requests.flush()
            format, size = ANSWER.unpack(answers.read(ANSWER.size))
            data = answers.read(size)
        except (OSError, struct.error):
            raise BagError(self._end_reason()) from None
        finally:
            timer.cancel()
        if len(data) < size:
            raise BagError(self._end_reason())
        if format == b"J":
            reply = json.loads(data)
            if "missing" in reply:
                raise ModuleNotFoundError(name=reply["missing"])
            if "error" in reply:
                raise BagError(reply["error"])
        return data

    def _end_reason(self) -> str:
        """Return the reason why the process has ended."""
        code = self._process.wait()
        if code == -getattr(signal, "SIGXCPU", 0) or (sys.platform == "win32" and code == 1):
            return f"reading this bag needs more than {MAX_CPU_S} s of processor time"
        return f"the process that reads this bag ended with code {code}"


def is_limited() -> bool:
    """Return whether the memory of this process is limited."""
    if sys.platform == "win32":
        return False
    import resource

    return resource.getrlimit(resource.RLIMIT_DATA)[1] != resource.RLIM_INFINITY


def _open(path: Path, definitions: Mapping[str, str]) -> BagSource | _BagProcess:
    """Open a bag in a process with limits."""
    # A program that contains Python cannot start its interpreter.
    if is_limited() or getattr(sys, "frozen", False):
        return BagSource(path, definitions)
    return _BagProcess(path, definitions)
