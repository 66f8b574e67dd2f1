"""The lines of a recording: rows of a word and its values, which the forms of files write and read.

The lines of the head describe the tree, up to `head`. A step is what happened before it, then `tick` or
`halt`, its inputs, the `transitions` if they are recorded, and `end`. A `segment` begins with the state of
the tree, up to `state_end`; its value says why steps are missing before it.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache, partial
from types import UnionType
from typing import Any, Final, Protocol, cast, get_args, get_origin, get_type_hints

from btcore.engine.recorded_events import (
    ChildHalted,
    ChildTicked,
    ExternalHaltBegan,
    ExternalHaltEnded,
    MessageLogged,
    Paused,
    Raised,
    RecordedEntry,
    Removed,
    Replaced,
    ScriptRun,
    StatusForced,
    StatusSet,
    TimeRead,
    Written,
)
from btcore.json_text import load_json
from btcore.logs.files import LogError
from btcore.status import NodeType, Status
from btcore_recorder.inputs import (
    Facts,
    Head,
    Input,
    NodeState,
    RecordedClass,
    Result,
    RunRecording,
    Segment,
    Step,
    TreeState,
)

FORMAT: Final = 1
END_WORDS: Final = ("head", "end", "state_end")
"""The words of the last lines of the head, of a step, and of the state of a segment."""

Line = list[Any]
"""A word, and its values as data of JSON."""
Results = tuple[tuple[str, int, str], ...]
"""The lines of results. Many ticks have the same as the tick before: forms of files keep their text."""
WrittenLine = Line | Results
"""What a form of files writes: a line, or the lines of results."""

_INPUTS: Final[dict[str, Any]] = {
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
_STATUSES: Final = dict(Status.__members__)
_KINDS: Final = ("leaf", "control", "decorator", "built-in")
_DIRECTIONS: Final = {"IN", "OUT", "INOUT"}


# --- writing


def encode_text(text: str) -> bytes:
    """Return the bytes of *text*, which may have lone surrogates, in a file."""
    return text.encode("utf-8", "surrogatepass")


def head_lines(head: Head) -> Iterator[Line]:
    """Yield the lines of the head."""
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
    for uid, path in enumerate(head.paths, start=1):
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


def recording_lines(recording: RunRecording) -> Iterator[list[Line]]:
    """Yield the lines of a recording: those of the head, and of each segment and step, together."""
    yield list(head_lines(recording.head))
    segments = {segment.position: segment for segment in recording.segments}
    for position, step in enumerate(recording.steps):
        if position in segments:
            yield list(segment_lines(segments[position].gap, segments[position].state))
        yield list(step_lines(step))


def result_lines(uid: int) -> list[tuple[str, int, str]]:
    """Return the lines of the results of a node, by the number of the status."""
    return [("result", uid, status.name) for status in Status]


class ResultTexts:
    """The texts of results in a form of files.

    Args:
        encode: Returns the text of a line.
        separator: The text between two lines.
    """

    def __init__(self, encode: Callable[[Sequence[Any]], str], separator: str) -> None:
        self._encode = cache(encode)
        self._separator = separator
        self._last: tuple[Results, str] = (), ""

    def get(self, results: Results) -> str:
        """Return the text of *results*, which are not empty."""
        if results != self._last[0]:  # usually the same objects, which Python compares at once
            self._last = results, self._separator.join(map(self._encode, results))
        return self._last[1]


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
        paths: list[str] = []
        state = _StateReader()
        outer: list[tuple[bool, Mapping[str, str]]] = []
        while True:
            match self._next():
                case "tree", [str(id), int(format)] if format in (3, 4):
                    tree = id, format
                case "clock", [int(time), int(wall_time)]:
                    clock = time, wall_time
                case "versions", [named]:
                    versions = _converter(Mapping[str, str])(named)
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
                case "node", [int(), str(path)]:
                    paths.append(path)
                case "outer", values:
                    outer.append(_converter(tuple[bool, Mapping[str, str]])(values))
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
            tuple(paths),
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
                case "tick", [int(number), int(at), *rest] if before is None and number > 0 and len(rest) < 2:
                    before, inputs, tick, time = inputs, [], number, at
                    woken_by = _check(rest[0], int) if rest else None
                case "transitions", [list(pairs)] if before is not None and transitions is None:
                    transitions = _converter(tuple[tuple[int, Status], ...])(pairs)
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
                    inputs.append(_converter(_INPUTS[word])(values))
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
                self._entries.append(_converter(RecordedEntry)(values))
            case "scope", [dict(keys)] if all(_is_index(index, self._entries) for index in keys.values()):
                self._scopes.append(keys)
            case "state", _:
                self._nodes.append(_converter(NodeState)(values))
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


def _facts(values: dict[str, Any]) -> Facts:
    fields = get_type_hints(Facts)
    known = {name: value for name, value in values.items() if name in fields}
    return Facts(**{name: _converter(fields[name])(value) for name, value in known.items()})


def _class(values: list[Any]) -> RecordedClass:
    recorded = cast(RecordedClass, _converter(RecordedClass)(values))
    directions = {port[1] for port in recorded.ports}
    if recorded.kind in _KINDS and recorded.node_type in NodeType.__members__ and directions <= _DIRECTIONS:
        return recorded
    raise DamageError("a class is invalid")


@cache
def _converter(form: Any) -> Callable[[Any], Any]:
    """Return a function that returns data of JSON as a value of the type *form*, or raises `DamageError`."""
    if form is Any:
        return lambda data: data
    if form is Status:
        return _status
    items = [_converter(item) for item in get_args(form) if item is not ...]
    origin = get_origin(form) or form
    if origin is UnionType:  # X | None
        return lambda data: None if data is None else items[0](data)
    if origin is Mapping:
        return lambda data: {key: items[1](item) for key, item in _check(data, dict).items()}
    if origin is tuple and ... in get_args(form):
        return lambda data: tuple([items[0](item) for item in _check(data, list)])
    if issubclass(origin, tuple):  # also the named tuples of `inputs`
        make = tuple if origin is tuple else partial(tuple.__new__, origin)
        items = items or [_converter(field) for field in get_type_hints(origin).values()]
        return lambda data: make([item(value) for item, value in _pairs(items, data)])
    return lambda data: _check(data, origin)


def _check(data: Any, cls: type) -> Any:
    if not isinstance(data, cls):
        raise DamageError(f"a value of the type {cls.__name__} is expected here")
    return data


def _pairs(items: list[Callable[[Any], Any]], data: Any) -> Iterator[tuple[Callable[[Any], Any], Any]]:
    if len(_check(data, list)) != len(items):
        raise DamageError(f"{len(items)} values are expected here")
    return zip(items, data, strict=True)


def _status(name: Any) -> Status:
    try:
        return _STATUSES[name]
    except (KeyError, TypeError):
        raise DamageError(f"'{name}' is not a status") from None
