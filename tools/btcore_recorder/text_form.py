"""The text form of a recording, `.btrec.txt`: a line for each input, in the order of the run.

A line is a word and its values as a JSON array; a line of a document is `|` and the line. The head describes
the tree. A step is what happened before it, then `tick` or `halt`, its inputs, and `end`. A `segment` begins
with the state of the tree, up to `state_end`; its value says why steps are missing before it. The last value
of `head`, `end` and `state_end` is a CRC-32 of the lines since the previous one and of the other values, so
that damage is found; in a hand-written file it may be null.
"""

import json
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from btcore.engine.journal import (
    ChildHalted,
    ChildTicked,
    ExternalHaltBegan,
    RepetitionEnded,
    StatusForced,
    StatusSet,
    TimeRead,
)
from btcore.json_text import load_json
from btcore.logs.files import LogError, read_bytes
from btcore.status import NodeType, Status
from btcore_recorder.inputs import (
    ExternalHaltEnded,
    Head,
    Input,
    NodeState,
    Raised,
    RecordedClass,
    RecordedEntry,
    RecordedError,
    Removed,
    Replaced,
    Result,
    RunRecording,
    Segment,
    Step,
    TreeState,
    Written,
)

EXTENSION: Final = ".btrec.txt"
FORMAT: Final = 1

_INPUTS: Final[dict[str, type[Input]]] = {
    "result": Result,
    "raised": Raised,
    "halt_began": ExternalHaltBegan,
    "halt_ended": ExternalHaltEnded,
    "child_ticked": ChildTicked,
    "child_halted": ChildHalted,
    "status_set": StatusSet,
    "status_forced": StatusForced,
    "repetition_ended": RepetitionEnded,
    "time": TimeRead,
    "written": Written,
    "removed": Removed,
    "replaced": Replaced,
}
_WORDS: Final = {cls: word for word, cls in _INPUTS.items()}


# --- writing


class TextWriter:
    """Converts a recording to lines of text.

    Args:
        write: Called with each piece of text.

    Attributes:
        crc: The CRC of the lines since the last that contains one.
    """

    def __init__(self, write: Callable[[str], object]) -> None:
        self._write = write
        self.crc = 0

    def head(self, head: Head, paths: Iterable[str]) -> None:
        """Write the head; *paths* are the paths of the nodes, for readers."""
        self._line("btrec", FORMAT)
        self._line("tree", head.tree_id, head.format)
        self._line("clock", head.time, head.wall_time)
        self._line("versions", head.versions)
        for file, text, is_shared in head.documents:
            self._line("document", file, is_shared)
            self._add("".join(f"|{line}\n" for line in text.split("\n")))
        for name, number in head.enums.items():
            self._line("enum", name, number)
        for name, description in head.types.items():
            self.type(name, description)
        for recorded in head.classes:
            self._line("class", *recorded)
        for uid, recorded in head.replaced.items():
            self._line("replaced", uid, *recorded)
        for uid, path in enumerate(paths, start=1):
            self._line("node", uid, path)
        for autoremap, remaps in head.outer:
            self._line("outer", autoremap, remaps)
        self._state(head.state)
        self._end("head")

    def _state(self, state: TreeState) -> None:
        for entry in state.entries:
            self._line("entry", *entry)
        for keys in state.scopes:
            self._line("scope", keys)
        for node in state.nodes:
            self._line("state", *_names(node))
        self._line("ticks", state.ticks)

    def type(self, name: str, description: Any) -> None:
        """Write the description of a user's type."""
        self._line("type", name, description)

    def segment(self, gap: str, state: TreeState) -> None:
        """Write the begin of a segment; *gap* says why steps are missing before it."""
        self._line("segment", gap)
        self._state(state)
        self._end("state_end")

    def step(self, step: Step) -> None:
        """Write a step."""
        for event in step.before:
            self._input(event)
        if step.tick:
            self._line("tick", step.tick, step.time)
        else:
            self._line("halt")
        for event in step.inputs:
            self._input(event)
        self._end("end", step.status.name, step.checksum)

    def _input(self, event: Input) -> None:
        self._line(_WORDS[type(event)], *_names(event))

    def _end(self, word: str, *values: object) -> None:
        self._line(word, *values, zlib.crc32(_json(values).encode(), self.crc))
        self.crc = 0

    def _line(self, word: str, *values: object) -> None:
        self._add(f"{word} {_json(values)}\n")

    def _add(self, text: str) -> None:
        self.crc = zlib.crc32(text.encode("utf-8", "surrogatepass"), self.crc)
        self._write(text)


def _names(values: Iterable[object]) -> list[object]:
    """Return *values* with names in place of statuses."""
    return [value.name if isinstance(value, Status) else value for value in values]


def _json(values: Sequence[object]) -> str:
    return json.dumps(values, ensure_ascii=False, separators=(", ", ":"), allow_nan=False)


def to_text(recording: RunRecording, paths: Iterable[str] = ()) -> str:
    """Return a recording as text; *paths* are the paths of the nodes, for readers."""
    parts: list[str] = []
    writer = TextWriter(parts.append)
    writer.head(recording.head, paths)
    segments = {segment.position: segment for segment in recording.segments}
    for position, step in enumerate(recording.steps):
        if position in segments:
            writer.segment(segments[position].gap, segments[position].state)
        writer.step(step)
    return "".join(parts)


# --- reading


class _DamageError(Exception):
    """A line that is not a line of a recording."""


def read_recording(path: Path) -> RunRecording:
    """Read a recording in the text form. A truncated or damaged file is read up to the damage.

    Raises:
        LogError: The file cannot be read, is not a recording, or is damaged in its head.
    """
    data = read_bytes(path)
    if not data.startswith(b"btrec "):
        raise LogError(f"{path}: this is not a recording: it does not begin with 'btrec'")
    return _Reader(data, str(path)).read()


class _Reader:
    def __init__(self, data: bytes, name: str) -> None:
        self._lines = data.split(b"\n")
        self._name = name
        self._number = 0  # of the line, from 1
        self._crc = 0

    def read(self) -> RunRecording:
        try:
            head = self._head()
        except _DamageError as error:
            raise LogError(
                f"{self._name}:{self._number}: the head of this recording is damaged: {error}"
            ) from None
        steps: list[Step] = []
        segments: list[Segment] = []
        types: dict[str, Any] = dict(head.types)
        damage = ""
        try:
            while (item := self._step(types)) is not None:
                if isinstance(item, Step):
                    steps.append(item)
                else:
                    segments.append(item._replace(position=len(steps)))
        except _DamageError as error:
            damage = f"line {self._number}: {error}; {len(steps)} steps before it are read"
        return RunRecording(head._replace(types=types), tuple(steps), tuple(segments), damage)

    def _next(self) -> tuple[str, list[Any]] | None:
        """Return the word and the values of the next line, or None at the end of the file."""
        if self._number >= len(self._lines) - 1:
            if self._lines[-1]:
                self._number = len(self._lines)
                raise _DamageError("the file is truncated within this line")
            return None
        line = self._lines[self._number]
        self._number += 1
        word, _, data = line.partition(b" ")
        if word not in (b"head", b"end", b"state_end"):
            self._crc = zlib.crc32(line + b"\n", self._crc)
        try:
            values = load_json(data.decode("utf-8"), parse_constant=_refuse)
        except (ValueError, RecursionError):
            raise _DamageError("this is not a line of a recording") from None
        if not isinstance(values, list):
            raise _DamageError("the values are not a list")
        return word.decode("ascii", "replace"), values

    def _document(self) -> str:
        lines = []
        while self._number < len(self._lines) and self._lines[self._number].startswith(b"|"):
            line = self._lines[self._number]
            self._number += 1
            self._crc = zlib.crc32(line + b"\n", self._crc)
            lines.append(line[1:])
        try:
            return b"\n".join(lines).decode("utf-8", "surrogatepass")
        except UnicodeDecodeError:
            raise _DamageError("the document is not UTF-8") from None

    def _check_crc(self, crc: object, *values: object) -> None:
        expected, self._crc = zlib.crc32(_json(values).encode(), self._crc), 0
        if crc is not None and crc != expected:
            raise _DamageError("the lines before it were changed: their checksum differs")

    def _head(self) -> Head:
        match self._next():
            case "btrec", [int(version)]:
                if version != FORMAT:
                    raise LogError(
                        f"{self._name}: this recording has format {version}; btcore supports format {FORMAT}"
                    )
            case _:
                raise _DamageError("expected 'btrec [1]'")
        tree: tuple[str, int] | None = None
        clock, versions = (0, 0), {}
        documents: list[tuple[str, str, bool]] = []
        enums: dict[str, int] = {}
        types: dict[str, Any] = {}
        classes: list[RecordedClass] = []
        replaced: dict[int, RecordedClass] = {}
        state = _StateReader()
        outer: list[tuple[bool, Mapping[str, str]]] = []
        while True:
            match self._next():
                case "tree", [str(id), int(format)] if format in (3, 4):
                    tree = id, format
                case "clock", [int(time), int(wall_time)]:
                    clock = time, wall_time
                case "versions", [dict(named)] if all(isinstance(text, str) for text in named.values()):
                    versions = named
                case "document", [str(file), bool(is_shared)]:
                    documents.append((file, self._document(), is_shared))
                case "enum", [str(name), int(number)]:
                    enums[name] = number
                case "type", [str(name), dict(description)]:
                    types[name] = description
                case "class", values:
                    classes.append(_class(values))
                case "replaced", [int(uid), *values]:
                    replaced[uid] = _class(values)
                case "node", [int(), str()]:
                    pass  # for people who read the file
                case "outer", [bool(autoremap), dict(remaps)] if all(
                    isinstance(key, str) for key in remaps.values()
                ):
                    outer.append((autoremap, remaps))
                case "head", [crc]:
                    self._check_crc(crc)
                    break
                case None:
                    raise _DamageError("the head does not end")
                case word, values if state.take(word, values):
                    pass
                case word, _:
                    raise _DamageError(f"'{word}' does not belong here, or its values are invalid")
        if tree is None or not documents or not outer:
            raise _DamageError("the tree, its documents or its scope are missing")
        return Head(
            *tree,
            tuple(documents),
            enums,
            types,
            tuple(classes),
            replaced,
            tuple(outer),
            state.state(),
            *clock,
            versions,
        )

    def _segment(self, gap: str) -> Segment:
        state = _StateReader()
        while True:
            match self._next():
                case "state_end", [crc]:
                    self._check_crc(crc)
                    return Segment(0, gap, state.state())
                case None:
                    raise _DamageError("the file is truncated within a state")
                case word, values if not state.take(word, values):
                    raise _DamageError(f"'{word}' does not belong here, or its values are invalid")

    def _step(self, types: dict[str, Any]) -> Step | Segment | None:
        """Read the next step or the begin of a segment; return None at the end."""
        before: list[Input] | None = None
        inputs: list[Input] = []
        tick, time = 0, -1
        while True:
            match self._next():
                case "type", [str(name), dict(description)]:
                    types[name] = description
                case "tick", [int(number), int(at)] if before is None and number > 0:
                    before, inputs, tick, time = inputs, [], number, at
                case "segment", [str(gap)] if before is None and not inputs:
                    return self._segment(gap)
                case "halt", [] if before is None:
                    before, inputs = inputs, []
                case "end", [str(status), int(checksum), crc] if before is not None:
                    self._check_crc(crc, status, checksum)
                    return Step(tick, time, tuple(before), tuple(inputs), _status(status), checksum)
                case None:
                    if inputs or before is not None:
                        raise _DamageError("the file is truncated within a step")
                    return None
                case word, values if word in _INPUTS:
                    inputs.append(_input(word, values))
                case word, _:
                    raise _DamageError(f"'{word}' does not belong here, or its values are invalid")


class _StateReader:
    """Reads the lines of a state."""

    def __init__(self) -> None:
        self._entries: list[RecordedEntry] = []
        self._scopes: list[Mapping[str, int]] = []
        self._nodes: list[NodeState] = []
        self._ticks = 0

    def take(self, word: str, values: list[Any]) -> bool:
        """Take a line; return False if it is not a line of a state."""
        match word, values:
            case "entry", _:
                self._entries.append(_entry(values))
            case "scope", [dict(keys)] if all(_is_index(index, self._entries) for index in keys.values()):
                self._scopes.append(keys)
            case "state", [int(uid), str(status), str(before), dict(fields)]:
                self._nodes.append(NodeState(uid, _status(status), _status(before), fields))
            case "ticks", [int(count)] if count >= 0:
                self._ticks = count
            case _:
                return False
        return True

    def state(self) -> TreeState:
        """Return the state."""
        return TreeState(tuple(self._entries), tuple(self._scopes), tuple(self._nodes), self._ticks)


def _is_index(index: object, entries: list[RecordedEntry]) -> bool:
    return isinstance(index, int) and 0 <= index < len(entries)


def _entry(values: object) -> RecordedEntry:
    match values:
        case [value, str(declared), bool(inferred), None | str() as value_type, int(sequence_id)]:
            return RecordedEntry(value, declared, inferred, value_type, sequence_id)
    raise _DamageError("an entry is invalid")


def _class(values: object) -> RecordedClass:
    match values:
        case [
            str(id),
            ("leaf" | "control" | "decorator" | "built-in") as kind,
            str(node_type),
            bool(must_complete),
            list(ports),
        ] if node_type in NodeType.__members__:
            return RecordedClass(id, kind, node_type, must_complete, tuple(map(_port, ports)))
    raise _DamageError("a class is invalid")


def _port(values: object) -> tuple[str, str, str, str | None]:
    match values:
        case [str(name), ("IN" | "OUT" | "INOUT") as direction, str(type_name), None | str() as default]:
            return name, direction, type_name, default
    raise _DamageError("a port is invalid")


def _input(word: str, values: list[Any]) -> Input:
    match word, values:
        case "result", [int(uid), str(status)]:
            return Result(uid, _status(status))
        case "raised", [int(uid), [str(name), str(text)]]:
            return Raised(uid, RecordedError(name, text))
        case "halt_began", [int(uid)]:
            return ExternalHaltBegan(uid)
        case "halt_ended", [int(uid), None]:
            return ExternalHaltEnded(uid, None)
        case "halt_ended", [int(uid), [str(name), str(text)]]:
            return ExternalHaltEnded(uid, RecordedError(name, text))
        case "child_ticked", [int(uid)]:
            return ChildTicked(uid)
        case "child_halted", [int(uid)]:
            return ChildHalted(uid)
        case "status_set", [int(uid), str(status)]:
            return StatusSet(uid, _status(status))
        case "status_forced", [int(uid), bool(is_pre_tick), str(status)]:
            return StatusForced(uid, is_pre_tick, _status(status))
        case "repetition_ended", [int(uid), int(count)]:
            return RepetitionEnded(uid, count)
        case "time", [int(time), int(repeats)]:
            return TimeRead(time, repeats)
        case "written", [int(scope), str(key), value, None | str() as declared]:
            return Written(scope, key, value, declared)
        case "removed", [int(scope), str(key)]:
            return Removed(scope, key)
        case "replaced", [int(scope), dict(entries)]:
            return Replaced(scope, {key: _entry(entry) for key, entry in entries.items()})
    raise _DamageError(f"the values of '{word}' are invalid")


def _status(name: str) -> Status:
    try:
        return Status[name]
    except KeyError:
        raise _DamageError(f"'{name}' is not a status") from None


def _refuse(constant: str) -> Any:
    raise ValueError(constant)
