"""The lines of a recording: rows of a word and its values, which the forms of files write and read.

The lines of the head describe the tree, up to `head`. A step is what happened before it, then `tick` or
`halt`, its inputs, the `transitions` if they are recorded, and `end`. A `segment` begins with the state of
the tree, up to `state_end`; its value says why steps are missing before it.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final, Protocol

from btcore.engine.journal import (
    ChildHalted,
    ChildTicked,
    ExternalHaltBegan,
    MessageLogged,
    Paused,
    StatusForced,
    StatusSet,
    TimeRead,
)
from btcore.json_text import load_json
from btcore.logs.files import LogError
from btcore.status import NodeType, Status
from btcore_recorder.inputs import (
    ExternalHaltEnded,
    Facts,
    Head,
    Input,
    LeafCode,
    NodeState,
    Raised,
    RecordedClass,
    RecordedEntry,
    RecordedError,
    Removed,
    Replaced,
    Result,
    RunRecording,
    ScriptRun,
    Segment,
    Step,
    TreeState,
    Written,
)

FORMAT: Final = 1
END_WORDS: Final = ("head", "end", "state_end")
"""The words of the last lines of the head, of a step, and of the state of a segment."""

Line = list[Any]
"""A word, and its values as data of JSON."""

_INPUTS: Final[dict[str, type[Input]]] = {
    "result": Result,
    "raised": Raised,
    "halt_began": ExternalHaltBegan,
    "halt_ended": ExternalHaltEnded,
    "child_ticked": ChildTicked,
    "child_halted": ChildHalted,
    "status_set": StatusSet,
    "status_forced": StatusForced,
    "paused": Paused,
    "time": TimeRead,
    "message": MessageLogged,
    "written": Written,
    "removed": Removed,
    "replaced": Replaced,
    "script": ScriptRun,
}
_WORDS: Final = {cls: word for word, cls in _INPUTS.items()}


# --- writing


def encode_text(text: str) -> bytes:
    """Return the bytes of *text*, which may have lone surrogates, in a file."""
    return text.encode("utf-8", "surrogatepass")


def head_lines(head: Head, paths: Iterable[str]) -> Iterator[Line]:
    """Yield the lines of the head; *paths* are the paths of the nodes, for readers."""
    yield ["btrec", FORMAT]
    yield ["tree", head.tree_id, head.format]
    yield ["clock", head.time, head.wall_time]
    yield ["versions", head.versions]
    if head.facts != Facts():
        yield ["facts", head.facts._asdict()]
    for document in head.documents:
        yield ["document", *document]
    for name, number in head.enums.items():
        yield ["enum", name, number]
    for name, description in head.types.items():
        yield ["type", name, description]
    for recorded in head.classes:
        yield ["class", *recorded]
    for uid, recorded in head.replaced.items():
        yield ["replaced", uid, *recorded]
    for uid, path in enumerate(paths, start=1):
        yield ["node", uid, path]
    for outer in head.outer:
        yield ["outer", *outer]
    yield from _state_lines(head.state)
    yield ["head"]


def segment_lines(gap: str, state: TreeState) -> Iterator[Line]:
    """Yield the lines with which a segment begins; *gap* says why steps are missing before it."""
    yield ["segment", gap]
    yield from _state_lines(state)
    yield ["state_end"]


def step_lines(step: Step) -> Iterator[Line]:
    """Yield the lines of a step."""
    for event in step.before:
        yield input_line(event)
    if step.tick:
        yield ["tick", step.tick, step.time, *(() if step.woken_by is None else (step.woken_by,))]
    else:
        yield ["halt"]
    for event in step.inputs:
        yield input_line(event)
    if step.transitions is not None:
        yield transitions_line(step.transitions)
    yield ["end", step.status.name, step.checksum]


def recording_lines(recording: RunRecording, paths: Iterable[str] = ()) -> Iterator[list[Line]]:
    """Yield the lines of a recording: those of the head, and of each segment and step, together."""
    yield list(head_lines(recording.head, paths))
    segments = {segment.position: segment for segment in recording.segments}
    for position, step in enumerate(recording.steps):
        if position in segments:
            yield list(segment_lines(segments[position].gap, segments[position].state))
        yield list(step_lines(step))


def input_line(event: Input) -> Line:
    """Return the line of an input."""
    return [_WORDS[type(event)], *_names(event)]


def transitions_line(transitions: Iterable[tuple[int, Status]]) -> Line:
    """Return the line of the transitions of a step."""
    return ["transitions", [[uid, status.name] for uid, status in transitions]]


def _state_lines(state: TreeState) -> Iterator[Line]:
    for entry in state.entries:
        yield ["entry", *entry]
    for keys in state.scopes:
        yield ["scope", keys]
    for node in state.nodes:
        yield ["state", *_names(node)]
    yield ["ticks", state.ticks]


def _names(values: Iterable[object]) -> list[object]:
    """Return *values* with names in place of statuses."""
    return [value.name if isinstance(value, Status) else value for value in values]


# --- reading


class DamageError(Exception):
    """A part of a file that is not a part of a recording."""


def load_data(text: str) -> Any:
    """Return the data of a JSON text, in which `NaN` and infinities are errors.

    Raises:
        ValueError: The text is not JSON.
    """
    return load_json(text, parse_constant=_refuse)


def _refuse(constant: str) -> Any:
    raise ValueError(constant)


class LineSource(Protocol):
    """The lines of a file."""

    @property
    def place(self) -> str:
        """The place of the last line, such as "line 3"."""

    def next(self) -> tuple[str, list[Any]] | None:
        """Return the word and the values of the next line, or None at the end of the file.

        Raises:
            DamageError: The file is truncated or damaged at this place.
        """


def read_lines(source: LineSource, name: str) -> RunRecording:
    """Return the recording that *source* contains. A truncated or damaged one is read up to the damage.

    Args:
        name: The name of the file, for errors.

    Raises:
        LogError: The head is damaged, or has another format.
    """
    return _Reader(source, name).read()


class _Reader:
    def __init__(self, source: LineSource, name: str) -> None:
        self._source = source
        self._next = source.next
        self._name = name

    def read(self) -> RunRecording:
        try:
            head = self._head()
        except DamageError as error:
            raise LogError(
                f"{self._name}: {self._source.place}: the head of this recording is damaged: {error}"
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
        except DamageError as error:
            damage = f"{self._source.place}: {error}; {len(steps)} steps before it are read"
        return RunRecording(head._replace(types=types), tuple(steps), tuple(segments), damage)

    def _head(self) -> Head:
        match self._next():
            case "btrec", [int(version)]:
                if version != FORMAT:
                    raise LogError(
                        f"{self._name}: this recording has format {version}; btcore supports format {FORMAT}"
                    )
            case None:
                raise LogError(f"{self._name}: there is no recording in this file")
            case _:
                raise DamageError("expected 'btrec [1]'")
        tree: tuple[str, int] | None = None
        clock, versions = (0, 0), {}
        documents: list[tuple[str, str, bool]] = []
        facts = Facts()
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
                case "facts", [dict(values)]:
                    facts = _facts(values)
                case "document", [str(file), str(text), bool(is_shared)]:
                    documents.append((file, text, is_shared))
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
                case "head", []:
                    break
                case None:
                    raise DamageError("the head does not end")
                case word, values if state.take(word, values):
                    pass
                case word, _:
                    raise DamageError(f"'{word}' does not belong here, or its values are invalid")
        if tree is None or not documents or not outer:
            raise DamageError("the tree, its documents or its scope are missing")
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
            facts,
        )

    def _segment(self, gap: str) -> Segment:
        state = _StateReader()
        while True:
            match self._next():
                case "state_end", []:
                    return Segment(0, gap, state.state())
                case None:
                    raise DamageError("the file is truncated within a state")
                case word, values if not state.take(word, values):
                    raise DamageError(f"'{word}' does not belong here, or its values are invalid")

    def _step(self, types: dict[str, Any]) -> Step | Segment | None:
        """Read the next step or the begin of a segment; return None at the end."""
        before: list[Input] | None = None
        inputs: list[Input] = []
        tick, time = 0, -1
        woken_by: int | None = None
        transitions: tuple[tuple[int, Status], ...] | None = None
        while True:
            match self._next():
                case "type", [str(name), dict(description)]:
                    types[name] = description
                case "tick", [int(number), int(at), *rest] if before is None and number > 0:
                    before, inputs, tick, time = inputs, [], number, at
                    woken_by = _woken_by(rest)
                case "transitions", [list(pairs)] if before is not None and transitions is None:
                    transitions = tuple(map(_transition, pairs))
                case "segment", [str(gap)] if before is None and not inputs:
                    return self._segment(gap)
                case "halt", [] if before is None:
                    before, inputs = inputs, []
                case "end", [str(status), int(checksum)] if before is not None:
                    return Step(
                        tick,
                        time,
                        tuple(before),
                        tuple(inputs),
                        _status(status),
                        checksum,
                        woken_by,
                        transitions,
                    )
                case None:
                    if inputs or before is not None:
                        raise DamageError("the file is truncated within a step")
                    return None
                case word, values if word in _INPUTS:
                    inputs.append(_input(word, values))
                case word, _:
                    raise DamageError(f"'{word}' does not belong here, or its values are invalid")


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
    raise DamageError("an entry is invalid")


def _facts(values: dict[str, Any]) -> Facts:
    match {**Facts()._asdict(), **values}:
        case {
            "run": str(run),
            "tree": str(tree),
            "code": dict(code),
            "libraries": dict(libraries),
            "resources": list(resources) | tuple(resources),
        } if all(isinstance(text, str) for text in (*libraries.values(), *resources)):
            return Facts(run, tree, _codes(code), libraries, tuple(resources))
    raise DamageError("the facts are invalid")


def _codes(values: dict[str, Any]) -> dict[str, LeafCode]:
    codes = {}
    for id, code in values.items():
        match code:
            case [str(place), str(hash)]:
                codes[id] = LeafCode(place, hash)
            case _:
                raise DamageError("the facts are invalid")
    return codes


def _woken_by(values: list[Any]) -> int | None:
    match values:
        case []:
            return None
        case [int(uid)]:
            return uid
    raise DamageError("the values of 'tick' are invalid")


def _transition(values: object) -> tuple[int, Status]:
    match values:
        case [int(uid), str(status)]:
            return uid, _status(status)
    raise DamageError("a transition is invalid")


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
    raise DamageError("a class is invalid")


def _port(values: object) -> tuple[str, str, str, str | None]:
    match values:
        case [str(name), ("IN" | "OUT" | "INOUT") as direction, str(type_name), None | str() as default]:
            return name, direction, type_name, default
    raise DamageError("a port is invalid")


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
        case "paused", [int(uid), int(count)]:
            return Paused(uid, count)
        case "time", [int(time), int(repeats)]:
            return TimeRead(time, repeats)
        case "message", [str(level), str(text)]:
            return MessageLogged(level, text)
        case "written", [int(scope), str(key), value, None | str() as declared]:
            return Written(scope, key, value, declared)
        case "script", [int(scope), str(text), dict(enums)] if all(
            isinstance(number, int) for number in enums.values()
        ):
            return ScriptRun(scope, text, enums)
        case "removed", [int(scope), str(key)]:
            return Removed(scope, key)
        case "replaced", [int(scope), dict(entries)]:
            return Replaced(scope, {key: _entry(entry) for key, entry in entries.items()})
    raise DamageError(f"the values of '{word}' are invalid")


def _status(name: str) -> Status:
    try:
        return Status[name]
    except KeyError:
        raise DamageError(f"'{name}' is not a status") from None
