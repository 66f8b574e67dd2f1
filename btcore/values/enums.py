"""Types with names for their values: a user's Enum, a node's status, a port's direction."""

from collections.abc import Callable, Mapping
from enum import Enum, IntEnum
from typing import Any, Final

from btcore.errors import ConversionError
from btcore.status import Status
from btcore.values.numbers import MAX_INT64, MIN_INT64, leading_int
from btcore.values.types import ValueType, as_int, mismatch, number_of


class PortDirection(IntEnum):
    """Which way a port's value goes. The numbers are BehaviorTree.CPP's."""

    INPUT = 0
    OUTPUT = 1
    INOUT = 2


class EnumType(ValueType):
    """A Python Enum: by a name that the registry knows (*names*), by the member's own, or by its number.

    A *converter* of the user's, and its way back *to_text*, take the place of the members' own names; it is
    asked for what is neither a registered name nor a member's number.
    """

    def __init__(
        self,
        python_type: type[Enum],
        name: str,
        names: Mapping[str, int] | None = None,
        converter: Callable[[str], object] | None = None,
        to_text: Callable[[Any], str] | None = None,
    ) -> None:
        super().__init__(name, python_type, converts=False)
        self._converter = converter
        self._to_text = to_text
        self._names: Mapping[str, int] = {} if names is None else names
        self._members: dict[str, Enum] = dict(python_type.__members__)
        self._by_number: dict[int, Enum] = {
            int(one.value): one for one in python_type if isinstance(one.value, int)
        }

    @property
    def has_converters(self) -> bool:
        """Whether the user has said which text stands for which member."""
        return self._converter is not None

    def set_converters(
        self, from_text: Callable[[str], object] | None, to_text: Callable[[Any], str] | None
    ) -> None:
        """Have these from now on."""
        self._converter = from_text
        self._to_text = to_text

    def from_text(self, text: str, format: int = 4) -> Enum:
        """The member called *text*, or the one whose number it is. Raises ConversionError."""
        registered = self._names.get(text)
        if registered is not None and registered in self._by_number:
            return self._by_number[registered]
        found = self._members.get(text)
        if found is not None and self._converter is None:
            return found
        try:
            number = leading_int(text, MIN_INT64, MAX_INT64)
        except ConversionError:
            number = -1
        if str(number) == text and number in self._by_number:
            return self._by_number[number]
        if self._converter is not None:
            return self._converted(text, self._converter)
        raise ConversionError(f"'{text}' is no {self.name}: {', '.join(self._members)} are")

    def _converted(self, text: str, converter: Callable[[str], object]) -> Enum:
        try:
            made = converter(text)
        except ConversionError:
            raise
        except Exception as error:
            fault = ConversionError(f"'{text}' is no {self.name}: {error}")
            fault.__cause__ = error
            raise fault from error
        if isinstance(made, Enum) and isinstance(made, self.python_type):
            return made
        raise ConversionError(f"the converter of {self.name} made {made!r} of '{text}', which is none")

    def to_text(self, value: object) -> str:
        """The member's name, or what the user's way back says."""
        member = self.cast(value)
        return member.name if self._to_text is None else self._to_text(member)

    def cast(self, value: object) -> Enum:
        """A member, its number, or a text that stands for it."""
        if isinstance(value, Enum) and isinstance(value, self.python_type):
            return value
        if isinstance(value, str):
            return self.from_text(value)
        number = number_of(value)
        if number is None:
            raise mismatch(value, self)
        found = self._by_number.get(as_int(number, -(2**31), 2**31 - 1, self.name))
        if found is None:
            raise mismatch(value, self)
        return found


class StatusType(EnumType):
    """A node's status, by its upper-case name alone; format 3 has no SKIPPED."""

    def from_text(self, text: str, format: int = 4) -> Enum:
        """The status called *text*. Raises ConversionError."""
        found = self._members.get(text)
        if found is None or (format == 3 and text == "SKIPPED"):
            names = ", ".join(name for name in self._members if format != 3 or name != "SKIPPED")
            raise ConversionError(f"'{text}' is no status: {names} are")
        return found


class DirectionType(EnumType):
    """The direction of a port, as ``Input`` or ``INPUT``; format 3 takes anything else for InOut."""

    def from_text(self, text: str, format: int = 4) -> Enum:
        """The direction called *text*. Raises ConversionError."""
        for member, name in zip(PortDirection, ("Input", "Output", "InOut"), strict=True):
            if text == name or text == name.upper():
                return member
        if format == 3:
            return PortDirection.INOUT
        raise ConversionError(f"'{text}' is no direction of a port: Input, Output and InOut are")

    def to_text(self, value: object) -> str:
        """``Input``, ``Output`` or ``InOut``."""
        return ("Input", "Output", "InOut")[int(as_int(number_of(self.cast(value)) or 0, 0, 2))]


NODE_STATUS: Final = StatusType(Status, "BT::NodeStatus")
PORT_DIRECTION: Final = DirectionType(PortDirection, "BT::PortDirection")
