"""Ports: what a node declares, and what is bound to it in one tree.

A :class:`Port` is the declaration. An :class:`Input` or :class:`Output` belongs to one node of one
tree: what the XML says is looked at once, at load, and a tick only reads or writes.
"""

import enum
from typing import Final

from mypy_extensions import mypyc_attr

from btcore.blackboard import Blackboard, Entry
from btcore.errors import BlackboardFault, ConversionFault
from btcore.values import ANY, STRING, ValueType

UNSET: Final = object()
"""Stands for "no default", where None is a value."""


class Direction(enum.Enum):
    """Which way a port's value goes."""

    IN = "input"
    OUT = "output"
    INOUT = "inout"


class Port:
    """One declared port: name, direction, type, default and description.

    *default* is the text that stands for an absent attribute (None = the port is mandatory),
    *value* the same as a Python value where the text can't tell it (UNSET = the text tells).
    """

    def __init__(
        self,
        name: str,
        direction: Direction = Direction.IN,
        type: ValueType = ANY,
        default: str | None = None,
        description: str = "",
        value: object = UNSET,
    ) -> None:
        self.name = name
        self.direction = direction
        self.type = type
        self.default = default
        self.description = description
        self.value = value

    @property
    def reads(self) -> bool:
        """Whether the node reads it."""
        return self.direction is not Direction.OUT

    @property
    def writes(self) -> bool:
        """Whether the node writes it."""
        return self.direction is not Direction.IN


def pointer(text: str, name: str, format: int = 4) -> str | None:
    """The blackboard key that the port text *text* points to, or None for a literal.

    ``{key}`` points to *key* (spaces around the braces don't count, those inside do), ``=`` and
    ``{=}`` to the key called as the port itself. Format 3 also knows ``${key}``, and no spaces
    around (nodes.md §7, §9.1).
    """
    if format == 3:
        if text == "=":
            return name
        bare = text[1:] if text.startswith("${") else text
    else:
        bare = text.strip(" ")
        if text == "=":
            return name
    if len(bare) >= 3 and bare[0] == "{" and bare[-1] == "}":
        key = bare[1:-1]
        return name if key == "=" and format != 3 else key
    return None


@mypyc_attr(allow_interpreted_subclasses=True)
class Input:
    """An input port of one node, bound to a literal or to a blackboard key.

    *key* is None for a literal, whose value is converted at once; if it doesn't convert, reading
    raises, as the original does.
    """

    def __init__(self, port: Port, text: str, blackboard: Blackboard, format: int = 4) -> None:
        self.name: str = port.name
        self.type: ValueType = port.type
        self.text: str = text
        self.blackboard: Blackboard = blackboard
        self.format: int = format
        self.key: str | None = pointer(text, port.name, format)
        self.fault: str = ""
        self.literal: object = None
        if self.key is None:
            if port.value is not UNSET and text == port.default:
                self.literal = port.value
            else:
                try:
                    self.literal = port.type.from_text(text, format)
                except ConversionFault as fault:
                    self.fault = str(fault)

    def read(self) -> object:
        """The value, of the port's type.

        Raises BlackboardFault when the entry is missing or empty, ConversionFault when the value
        is of another type.
        """
        key = self.key
        if key is None:
            if self.fault:
                raise ConversionFault(f"port [{self.name}] = '{self.text}': {self.fault}")
            value = self.literal
            return list(value) if isinstance(value, list) else value
        entry = self.blackboard.find(key)
        if entry is None or entry.value is None:
            raise self._unreadable(entry)
        value = entry.value
        wanted = self.type
        if not wanted.strong:
            return value
        try:
            if isinstance(value, str) and wanted is not STRING:
                return wanted.from_text(value, self.format)
            return wanted.cast(value)
        except ConversionFault as fault:
            raise ConversionFault(
                f"port [{self.name}] reads {{{key}}} as {wanted.name}, but it holds {value!r}: {fault}"
            ) from None

    def _unreadable(self, entry: Entry | None) -> BlackboardFault:
        what = "is not on the blackboard" if entry is None else "has never been written"
        return BlackboardFault(f"port [{self.name}] reads {{{self.key}}}, which {what}")


class Output:
    """An output port of one node, bound to a blackboard key."""

    def __init__(self, port: Port, text: str, blackboard: Blackboard, format: int = 4) -> None:
        self.name: str = port.name
        self.type: ValueType = port.type
        self.text: str = text
        self.blackboard: Blackboard = blackboard
        key = pointer(text, port.name, format)
        if key is None and format == 3 and text:
            key = text
        self.key: str | None = key

    def write(self, value: object) -> None:
        """Write *value* to the entry.

        Raises BlackboardFault when the port isn't bound to a key, or the entry's type refuses, and
        ConversionFault when the value isn't of the port's own type.
        """
        key = self.key
        if key is None:
            raise BlackboardFault(
                f"port [{self.name}] is to be written, but '{self.text}' is no blackboard entry: "
                "name one in braces, {like_this}"
            )
        wanted = self.type
        if wanted.strong and not isinstance(value, str):
            try:
                value = wanted.cast(value)
            except ConversionFault as fault:
                raise ConversionFault(f"port [{self.name}] takes {wanted.name}: {fault}") from None
        self.blackboard.set(key, value)

    def __call__(self, value: object) -> None:
        """The same as :meth:`write`, for a leaf that takes the port as a callable."""
        self.write(value)
