"""Ports: their declarations, and their bindings to literals and blackboard entries.

A `Port` is the declaration. A `Binding` is the result of parsing the text of a port. An `Input` is the
binding of an input port to a literal or a blackboard, which nodes may share. An `Output` is the binding of an
output port of one node. All are created when the tree is loaded, so that a tick only reads and writes values.
"""

import enum
from types import NoneType
from typing import Final

from mypy_extensions import mypyc_attr

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.errors import BlackboardError, ConversionError
from btcore.values import ANY, NODE_STATUS, STRING, EnumType, ValueType

UNSET: Final = object()
"""The marker for "no default", because None is a possible default."""
UNBOUND_BLACKBOARD: Final = Blackboard()
"""The blackboard of the bindings of plans, and of constants, which read no blackboard."""
_CONSTANTS: Final = (str, int, float, enum.Enum, NoneType)


class Direction(enum.Enum):
    """The direction of a port: the node reads it (IN), writes it (OUT), or both (INOUT)."""

    IN = "input"
    OUT = "output"
    INOUT = "inout"


class PortRole(enum.Enum):
    """The purpose of a port, for static checks.

    A node cannot be created without its SCRIPT, CONDITION, QUEUE or WATCHED_ENTRY.
    """

    VALUE = enum.auto()
    SCRIPT = enum.auto()  # a script
    CONDITION = enum.auto()  # a script whose result determines the node's result
    DURATION = enum.auto()  # milliseconds
    REPETITIONS = enum.auto()  # a number of repetitions; −1 = forever
    SUCCESSES = enum.auto()  # a number of children that succeed; −1 = all
    FAILURES = enum.auto()  # a number of children that fail; −1 = all
    QUEUE = enum.auto()  # values for the node's output port: a literal list, or an entry
    WATCHED_ENTRY = enum.auto()  # the entry that is checked for updates; braces are optional
    REMOVED_ENTRY = enum.auto()  # the text names the entry that is removed
    WRITTEN_ENTRY = enum.auto()  # the text names the entry that is written
    WRITTEN_VALUE = enum.auto()  # the text that is written to the WRITTEN_ENTRY


SCRIPT_ROLES: Final = (PortRole.SCRIPT, PortRole.CONDITION)
KEY_ROLES: Final = (PortRole.WATCHED_ENTRY, PortRole.REMOVED_ENTRY, PortRole.WRITTEN_ENTRY)
"""The roles of ports whose text is a blackboard key even without braces."""
LOAD_TIME_ROLES: Final = (PortRole.SCRIPT, PortRole.CONDITION, PortRole.QUEUE, PortRole.WATCHED_ENTRY)
"""The roles of ports that a node reads when it is created."""


class Port:
    """The declaration of one port.

    Args:
        name: The name of the attribute in the XML.
        direction: Whether the node reads the port, writes it, or both.
        type: The type of the value.
        default: The text that is used if the attribute is absent; None = the port is mandatory.
        description: The description for listings and models.
        default_value: The default as a Python value, if *default* does not determine it; else UNSET.
        role: The purpose of the port, for static checks.
        optional: Whether the attribute may be absent although there is no default.

    Attributes:
        reads: Whether the node reads the port.
        writes: Whether the node writes the port.

    Examples:
        >>> from btcore import Direction, Port, values
        >>> port = Port("speed", Direction.IN, type=values.DOUBLE, default="0.5")
        >>> port.reads, port.writes
        (True, False)
    """

    def __init__(
        self,
        name: str,
        direction: Direction = Direction.IN,
        type: ValueType = ANY,
        default: str | None = None,
        description: str = "",
        default_value: object = UNSET,
        role: PortRole = PortRole.VALUE,
        optional: bool = False,
    ) -> None:
        self.name = name
        self.direction = direction
        self.type = type
        self.default = default
        self.description = description
        self.default_value = default_value
        self.role = role
        self.optional = optional
        self.reads = direction is not Direction.OUT
        self.writes = direction is not Direction.IN

    @property
    def checks_text(self) -> bool:
        """Whether a literal must convert to the type of the port before a tree is loaded.

        BehaviorTree.CPP checks the texts of enums when a node reads them, which would be too late for typos.
        For node statuses its recorded answers are followed: such a tree loads.
        """
        port_type = self.type
        is_user_enum = isinstance(port_type, EnumType) and port_type is not NODE_STATUS
        return port_type.strong and (port_type.converts or (self.reads and is_user_enum))


def braced_key(text: str, format: int = 4) -> str | None:
    """Return the key between the braces of `{key}`, or None for any other text.

    Spaces around the braces are ignored, spaces inside belong to the key. In format 3 `${key}` has the same
    meaning as `{key}`, and spaces around the braces make the text a literal. `=` has no special meaning,
    as in the nodes of BehaviorTree.CPP that read the text of a port themselves, instead of its value.

    Args:
        format: The XML format, 3 or 4.
    """
    if "}" not in text:
        return None
    if format == 3:
        bare = text[1:] if text.startswith("${") else text
    else:
        bare = text.strip(" ")
    if bare[:1] != "{" or bare[-1:] != "}":
        return None
    return bare[1:-1] or None


def remapped_key(text: str, name: str, format: int = 4) -> str | None:
    """Return the blackboard key to which the text of a port points, or None for a literal.

    This is the key in braces. `=` and, except in format 3, `{=}` point to the key with the port's name.

    Args:
        name: The name of the port.
        format: The XML format, 3 or 4.
    """
    if text == "=":
        return name
    key = braced_key(text, format)
    return name if key == "=" and format != 3 else key


@mypyc_attr(allow_interpreted_subclasses=True)
class Binding:
    """The parsed text of a port: a blackboard *key*, or a converted *literal*.

    Attributes:
        is_explicit: Whether the text is from the document, and not the port's default.
        key: The blackboard key; None for a literal.
        literal: The value of a literal; None if it does not convert.
        error: Why the literal does not convert, or "".
        is_shareable: Whether several nodes may use the binding: False for a literal that a leaf could modify.
    """

    __slots__ = (
        "blackboard", "error", "format", "is_explicit", "is_shareable", "key", "literal", "port", "text",
    )  # fmt: skip

    def __init__(self, port: Port, text: str, format: int = 4, is_explicit: bool = True) -> None:
        self.port: Port = port
        self.text: str = text
        self.format: int = format
        self.is_explicit: bool = is_explicit
        self.blackboard: Blackboard = UNBOUND_BLACKBOARD
        if text[:1] == "{" and text[-1:] == "}" and len(text) > 3:
            # The result of remapped_key() for most texts, without the call; the shorter {=} is another key.
            key: str | None = text[1:-1]
        else:
            key = remapped_key(text, port.name, format) if "}" in text or text == "=" else None
        self.key = key
        self.error: str = ""
        self.literal: object = None
        self.is_shareable: bool = True
        if key is None:
            if port.default_value is not UNSET and text == port.default:
                self.literal = port.default_value
            elif port.type is STRING:
                self.literal = text
            else:
                try:
                    self.literal = port.type.from_text(text, format)
                except ConversionError as error:
                    self.error = str(error)
                self.is_shareable = isinstance(self.literal, _CONSTANTS)

    @property
    def name(self) -> str:
        """The port's name."""
        return self.port.name


@mypyc_attr(allow_interpreted_subclasses=True)
class Input(Binding):
    """An input port, bound to a literal or to a key of its *blackboard*.

    If a literal does not convert, reading it raises, as in BehaviorTree.CPP.

    In a plan, an input has the UNBOUND_BLACKBOARD; `bind` returns the input of a node. It is a `Binding`, and
    does not have one as an `Output` has, because `read` would look up an attribute more in each tick.
    """

    __slots__ = ()

    def bind(self, blackboard: Blackboard) -> "Input":
        """Return the input for a node whose scope is *blackboard*: a copy, or this object for a constant."""
        if self.key is None and self.is_shareable:
            return self
        own = Input(self.port, self.text, self.format, self.is_explicit)
        own.blackboard = blackboard
        return own

    def read(self) -> object:
        """Return the value, converted to the port's type."""
        key = self.key
        if key is None:
            value = self.literal
            if value is None and self.error:
                raise ConversionError(f"port [{self.name}] = '{self.text}': {self.error}")
            # A copy of a list, because the leaf may change it.
            return list(value) if isinstance(value, list) else value
        entry = self.blackboard.find(key)
        if entry is None or entry.value is None:
            raise self._unreadable_error(entry)
        value = entry.value
        port_type = self.port.type
        if not port_type.strong:
            return value
        try:
            if isinstance(value, str) and port_type is not STRING:
                return port_type.from_text(value, self.format)
            return port_type.cast(value)
        except ConversionError as error:
            raise ConversionError(
                f"port [{self.name}] reads {{{key}}} as {port_type.name}, but it holds {value!r}: {error}"
            ) from None

    def _unreadable_error(self, entry: Entry | None) -> BlackboardError:
        problem = "is not on the blackboard" if entry is None else "has never been written"
        error = BlackboardError(f"port [{self.name}] reads {{{self.key}}}, which {problem}")
        error.unwritten_key = self.key or ""
        return error


class Output:
    """An output port of one node, bound to a blackboard key. Plans have its *binding* alone."""

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
        """The text of the port, as written."""
        return self.binding.text

    def write(self, value: object) -> None:
        """Write *value* to the entry."""
        key = self.key
        if key is None:
            raise BlackboardError(
                f"port [{self.name}] is an output, but '{self.text}' is not a blackboard entry: "
                "write the key in braces, {like_this}"
            )
        port_type = self.type
        if port_type.strong and not isinstance(value, str):
            try:
                value = port_type.cast(value)
            except ConversionError as error:
                raise ConversionError(f"port [{self.name}] takes {port_type.name}: {error}") from None
        # A port of any type may write a value of another type later, like a port of type BT::Any.
        self.blackboard.set(key, value, None if port_type.strong else port_type)

    def __call__(self, value: object) -> None:
        """Call `write`: a function leaf gets the port as a callable."""
        self.write(value)
