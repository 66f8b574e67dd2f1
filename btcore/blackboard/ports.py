"""Ports: what a node declares, and what is bound to it in one tree.

A :class:`Port` is the declaration, and a :class:`Binding` what one text makes of it, looked at once, at
load, for all nodes that say the same. An :class:`Input` is the binding of a port that is read, on a
blackboard; an :class:`Output` belongs to one node. A tick only reads or writes.
"""

import enum
from types import NoneType
from typing import Final

from mypy_extensions import mypyc_attr

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.errors import BlackboardError, ConversionError
from btcore.values import ANY, STRING, ValueType

UNSET: Final = object()
"""Stands for "no default", where None is a value."""
UNBOUND_BLACKBOARD: Final = Blackboard()
"""Where the ports of a plan are."""
_CONSTANTS: Final = (str, int, float, enum.Enum, NoneType)


class Direction(enum.Enum):
    """Which way a port's value goes."""

    IN = "input"
    OUT = "output"
    INOUT = "inout"


class PortRole(enum.Enum):
    """What a node does with a port, for checks that look at a tree without ticking it.

    The node cannot be made without a SCRIPT, CONDITION, QUEUE or WATCHED_ENTRY.
    """

    VALUE = enum.auto()
    SCRIPT = enum.auto()  # it is run
    CONDITION = enum.auto()  # a script whose result decides
    DURATION = enum.auto()  # milliseconds
    REPETITIONS = enum.auto()  # −1 = for ever
    SUCCESSES = enum.auto()  # of the children; −1 = all
    FAILURES = enum.auto()  # of the children; −1 = all
    QUEUE = enum.auto()  # values for the node's output port: a list, or the entry of one
    WATCHED_ENTRY = enum.auto()  # without braces too, the entry that is looked at
    REMOVED_ENTRY = enum.auto()  # the text names the entry that is removed
    WRITTEN_ENTRY = enum.auto()  # the text names the entry that is written …
    WRITTEN_VALUE = enum.auto()  # … with this text


SCRIPT_ROLES: Final = (PortRole.SCRIPT, PortRole.CONDITION)
KEY_ROLES: Final = (PortRole.WATCHED_ENTRY, PortRole.REMOVED_ENTRY, PortRole.WRITTEN_ENTRY)
"""The roles in which a text without braces is a key of the blackboard."""
LOAD_TIME_ROLES: Final = (PortRole.SCRIPT, PortRole.CONDITION, PortRole.QUEUE, PortRole.WATCHED_ENTRY)
"""The roles of ports that a node looks at when it is made."""


class Port:
    """One declared port: name, direction, type, default and description.

    *default* is the text that stands for an absent attribute (None = the port is mandatory),
    *value* the same as a Python value where the text can't tell it (UNSET = the text tells). *reads*
    and *writes* tell what the node does with it. An *optional* port may be absent though it has no default.
    """

    def __init__(
        self,
        name: str,
        direction: Direction = Direction.IN,
        type: ValueType = ANY,
        default: str | None = None,
        description: str = "",
        value: object = UNSET,
        role: PortRole = PortRole.VALUE,
        optional: bool = False,
    ) -> None:
        self.name = name
        self.direction = direction
        self.type = type
        self.default = default
        self.description = description
        self.value = value
        self.role = role
        self.optional = optional
        self.reads = direction is not Direction.OUT
        self.writes = direction is not Direction.IN


def remapped_key(text: str, name: str, format: int = 4) -> str | None:
    """The blackboard key that the port text *text* points to, or None for a literal.

    ``{key}`` points to *key* (spaces around the braces don't count, those inside do), ``=`` and
    ``{=}`` to the key called as the port itself. Format 3 also knows ``${key}``, and no spaces
    around (nodes.md §7, §9.1).
    """
    if text == "=":
        return name
    if format == 3:
        bare = text[1:] if text.startswith("${") else text
    else:
        bare = text.strip(" ")
    if bare[:1] != "{" or bare[-1:] != "}":
        return None
    key = bare[1:-1]
    if key == "=" and format != 3:
        return name
    return key or None


@mypyc_attr(allow_interpreted_subclasses=True)
class Binding:
    """What the text of a port means: a blackboard *key*, or else a literal, converted at once.

    *written* tells that the document says it, and not the port's default. *fault* is why a literal
    doesn't convert, and *shared* whether several nodes may have it.
    """

    __slots__ = ("blackboard", "fault", "format", "is_explicit", "key", "literal", "port", "shared", "text")

    def __init__(self, port: Port, text: str, format: int = 4, written: bool = True) -> None:
        self.port: Port = port
        self.text: str = text
        self.format: int = format
        self.is_explicit: bool = written
        self.blackboard: Blackboard = UNBOUND_BLACKBOARD
        if text[:1] == "{" and text[-1:] == "}" and len(text) > 3:
            key: str | None = text[1:-1]  # what pointer() says of most
        else:
            key = remapped_key(text, port.name, format) if "}" in text or text == "=" else None
        self.key = key
        self.fault: str = ""
        self.literal: object = None
        self.shared: bool = True
        if key is None:
            if port.value is not UNSET and text == port.default:
                self.literal = port.value
            else:
                try:
                    self.literal = port.type.from_text(text, format)
                except ConversionError as fault:
                    self.fault = str(fault)
                self.shared = isinstance(self.literal, _CONSTANTS)

    @property
    def name(self) -> str:
        """The port's name."""
        return self.port.name


@mypyc_attr(allow_interpreted_subclasses=True)
class Input(Binding):
    """An input port, bound to a literal or to a key of its *blackboard*.

    One of a plan is on no blackboard yet. Nodes of one scope that say the same have the same one, but
    for a literal that a leaf could alter. *key* is None for a literal; if that doesn't convert, reading
    raises, as the original does.
    """

    __slots__ = ()

    def bind_to(self, blackboard: Blackboard) -> "Input":
        """The same on *blackboard*: this very one, if no other blackboard was first."""
        if self.shared and self.blackboard is UNBOUND_BLACKBOARD:
            self.blackboard = blackboard
            return self
        if not self.shared:
            own = Input(self.port, self.text, self.format, self.is_explicit)
        else:
            own = Input.__new__(Input)
            own.port, own.text, own.format, own.is_explicit = (
                self.port,
                self.text,
                self.format,
                self.is_explicit,
            )
            own.key, own.literal, own.fault, own.shared = self.key, self.literal, self.fault, True
        own.blackboard = blackboard
        return own

    def read(self) -> object:
        """The value, of the port's type.

        Raises BlackboardError when the entry is missing or empty, ConversionError when the value
        is of another type.
        """
        key = self.key
        if key is None:
            value = self.literal
            if value is None and self.fault:
                raise ConversionError(f"port [{self.name}] = '{self.text}': {self.fault}")
            return list(value) if isinstance(value, list) else value
        entry = self.blackboard.find(key)
        if entry is None or entry.value is None:
            raise self._unreadable(entry)
        value = entry.value
        wanted = self.port.type
        if not wanted.strong:
            return value
        try:
            if isinstance(value, str) and wanted is not STRING:
                return wanted.from_text(value, self.format)
            return wanted.cast(value)
        except ConversionError as fault:
            raise ConversionError(
                f"port [{self.name}] reads {{{key}}} as {wanted.name}, but it holds {value!r}: {fault}"
            ) from None

    def _unreadable(self, entry: Entry | None) -> BlackboardError:
        what = "is not on the blackboard" if entry is None else "has never been written"
        return BlackboardError(f"port [{self.name}] reads {{{self.key}}}, which {what}")


class Output:
    """An output port of one node, bound to a blackboard key."""

    __slots__ = ("binding", "blackboard", "key", "type")

    def __init__(self, binding: Binding, blackboard: Blackboard) -> None:
        self.binding: Binding = binding
        self.type: ValueType = binding.port.type
        self.blackboard: Blackboard = blackboard
        key = binding.key
        if key is None and binding.format == 3 and binding.text:
            key = binding.text
        self.key: str | None = key

    @property
    def name(self) -> str:
        """The port's name."""
        return self.binding.port.name

    @property
    def text(self) -> str:
        """What it is bound to, as written."""
        return self.binding.text

    def write(self, value: object) -> None:
        """Write *value* to the entry.

        Raises BlackboardError when the port isn't bound to a key, or the entry's type refuses, and
        ConversionError when the value isn't of the port's own type.
        """
        key = self.key
        if key is None:
            raise BlackboardError(
                f"port [{self.name}] is to be written, but '{self.text}' is no blackboard entry: "
                "name one in braces, {like_this}"
            )
        wanted = self.type
        if wanted.strong and not isinstance(value, str):
            try:
                value = wanted.cast(value)
            except ConversionError as fault:
                raise ConversionError(f"port [{self.name}] takes {wanted.name}: {fault}") from None
        self.blackboard.set(key, value)

    def __call__(self, value: object) -> None:
        """The same as :meth:`write`, for a leaf that takes the port as a callable."""
        self.write(value)
