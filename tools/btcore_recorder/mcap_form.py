"""A recording in an MCAP file (https://mcap.dev/spec): the head, each segment and each step is a message.

A message is a JSON object with its lines, as `btcore_recorder.lines` describes them, and for a tick its
number and result. The file may also have the channels of a bag. Unlike the reader of the package mcap, this
one reads what is there of a file whose process was killed.
"""

import io
import json
import zlib
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, Final

from lz4.frame import LZ4FrameDecompressor
from mcap.records import Channel, Chunk, Footer, Header, McapRecord, Message, Statistics
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC, Writer
from zstandard import decompress, frame_content_size

from btcore_recorder.lines import DamageError, ResultTexts, WrittenLine, encode_text, load_data

TOPIC: Final = "/btcore/recording"
_LIBRARY: Final = "btcore_recorder"
_SCHEMA: Final = {
    "type": "object",
    "properties": {
        "tick": {"type": "integer", "description": "The number of the tick."},
        "status": {"type": "string", "description": "The result of the tick or halt."},
        "lines": {"type": "array", "items": {"type": "array"}, "description": "A word and its values each."},
    },
    "required": ["lines"],
}
_json: Final = json.JSONEncoder(ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode
MAX_CHUNK: Final = 1 << 28
"""The maximum size (bytes) of a record, and of a chunk after decompression."""


class McapEncoder:
    """Converts lines to an MCAP file."""

    def __init__(self) -> None:
        self._file = _Buffer()
        self._writer = Writer(self._file)
        self._writer.start(library=_LIBRARY)
        schema = self._writer.register_schema("btcore.recording", "jsonschema", json.dumps(_SCHEMA).encode())
        self._channel = self._writer.register_channel(TOPIC, "json", schema)
        self._count = 0
        self._results = ResultTexts(_json, ",")

    def add(self, lines: Iterable[WrittenLine], time: int = 0) -> None:
        """Add a message with *lines*; *time* is in ns since 1970."""
        rows: list[str] = []
        rest = ""
        for line in lines:
            if isinstance(line, tuple):
                rows.append(self._results.get(line))
                continue
            rows.append(_json(line))
            match line:
                case ["tick", number, *_]:
                    rest = f',"tick":{_json(number)}'
                case ["end", status, *_]:
                    rest += f',"status":{_json(status)}'
                case ["document", name, text, *_]:
                    self._writer.add_attachment(time, time, name, "application/xml", encode_text(text))
        text = f'{{"lines":[{",".join(rows)}]{rest}}}'
        self._writer.add_message(self._channel, time, encode_text(text), time, self._count)
        self._count += 1

    def take(self) -> bytes:
        """Return the bytes of the file since the last call."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        return self._file.take()

    def take_end(self) -> bytes:
        """Return the bytes since the last call, and the end of the file."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        return self._file.take()


class _Buffer(io.BytesIO):
    """The end of a file that was not taken yet."""

    _taken = 0

    def tell(self) -> int:
        return self._taken + super().tell()

    def take(self) -> bytes:
        data = self.getvalue()
        self._taken += len(data)
        self.seek(0)
        self.truncate()
        return data


def has_recording(data: bytes) -> bool:
    """Return whether an MCAP file contains a recording, without decompressing its chunks."""
    try:
        records = StreamReader(io.BytesIO(data), emit_chunks=True, record_size_limit=len(data)).records
        return any(
            record.library == _LIBRARY if isinstance(record, Header) else record.topic == TOPIC
            for record in records
            if isinstance(record, Header | Channel)
        )
    except Exception:  # the package raises any exception for damaged data
        return False


class McapLines:
    """The lines of an MCAP file; a `LineSource`."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._stream = io.BytesIO(data)
        self._records = StreamReader(self._stream, emit_chunks=True, record_size_limit=MAX_CHUNK).records
        self._channels: set[int] = set()
        self._messages: list[bytes] = []  # of the present chunk, the last first
        self._rows: list[list[Any]] = []  # of the present message, the last first
        self._count = 0
        self._is_complete = False  # whether there are as many messages as the end of the file says
        self._has_ended = False

    @property
    def place(self) -> str:
        """The position in the file up to which it was read."""
        return f"byte {self._stream.tell()}"

    def next(self) -> tuple[str, list[Any]] | None:
        """Return the word and the values of the next line, or None at the end of the file.

        Raises:
            DamageError: The file is truncated or damaged.
        """
        while not self._rows:
            while not self._messages:
                if self._has_ended or not self._read_record():
                    return None
            self._rows = _parse(self._messages.pop())
        word, *values = self._rows.pop()
        return word, values

    def _read_record(self) -> bool:
        """Read a record; return False at the end of the file."""
        start = self._stream.tell()
        if start == len(self._data) and not self._data.endswith(MCAP0_MAGIC):
            return False  # its process was killed between two records
        try:
            if start >= len(MCAP0_MAGIC):
                self._check_length(start)
            record = next(self._records)
            self._add_records(_break_up(record) if isinstance(record, Chunk) else [record])
        except DamageError:
            raise
        except Exception as error:  # the package raises any exception for damaged data
            raise DamageError(f"the file is damaged: {str(error) or type(error).__name__}") from None
        if isinstance(record, Footer):
            self._has_ended = True
            if not self._is_complete:
                raise DamageError("messages are missing")
        return not self._has_ended

    def _check_length(self, start: int) -> None:
        head = self._data[start : start + 9]
        if len(head) < 9 or start + 9 + int.from_bytes(head[1:], "little") > len(self._data):
            raise DamageError("the file is truncated within a record")

    def _add_records(self, records: Iterable[object]) -> None:
        messages = []
        for record in records:
            if isinstance(record, Channel) and record.topic == TOPIC and record.message_encoding == "json":
                self._channels.add(record.id)
            elif isinstance(record, Message) and record.channel_id in self._channels:
                if record.sequence != self._count:
                    raise DamageError(f"message {self._count} is missing")
                self._count += 1
                messages.append(record.data)
            elif isinstance(record, Statistics):  # at the end of a complete file
                counts = record.channel_message_counts
                self._is_complete = sum(counts.get(id, 0) for id in self._channels) == self._count
        self._messages = messages[::-1]


def _break_up(chunk: Chunk) -> list[McapRecord]:
    """Return the records of a chunk, whose size is limited."""
    data, size = chunk.data, chunk.uncompressed_size
    if chunk.compression == "zstd":
        if max(size, frame_content_size(data)) > MAX_CHUNK:
            raise DamageError(f"a chunk has more than {MAX_CHUNK:,} bytes")
        data = decompress(data, size)
    elif chunk.compression == "lz4":
        data = LZ4FrameDecompressor().decompress(data, MAX_CHUNK)
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise DamageError("a chunk was changed: its checksum differs")
    return breakup_chunk(replace(chunk, compression="", data=data))


def _parse(message: bytes) -> list[list[Any]]:
    """Return the lines of a message, the last first."""
    try:
        data = load_data(message.decode("utf-8", "surrogatepass"))
        rows = data["lines"]
        if all(isinstance(row, list) and row and isinstance(row[0], str) for row in rows):
            return list(reversed(rows))
    except (ValueError, RecursionError, TypeError, KeyError):
        pass
    raise DamageError("a message has no lines of a recording")
