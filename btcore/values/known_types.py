"""Text ⇄ values by BehaviorTree.CPP's rules, and the types that a registry knows.

The types themselves live in :mod:`btcore.values.types`, ``enums`` and ``vectors``; here a
Python annotation, or a value, finds its type.

Python's ``int`` is C++'s ``int`` of 32 bits, as in the ports of the trees that come from there: a
text or an entry beyond 32 bits doesn't fit an ``In[int]``, but an ``In[Int64]``. The type of an
integer that user code writes is ``int`` where 32 bits hold it, else ``long``, else ``unsigned long``;
an ``In[float]`` or ``In[Int64]`` may still claim such an entry when the tree is made.
"""

import types
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from numbers import Integral, Real
from typing import Annotated, Any, Final, Union, get_args, get_origin

from btcore.errors import BlackboardError, ConversionError, RegistrationError
from btcore.status import Status
from btcore.values.enums import NODE_STATUS, PORT_DIRECTION, EnumType, PortDirection
from btcore.values.numbers import MAX_UINT64, MIN_INT64, read_json, whole_float, whole_int
from btcore.values.types import (
    ANY,
    ANY_VALUE,
    BOOL,
    DOUBLE,
    FLOAT,
    INT,
    INT8,
    INT16,
    INT64,
    STRING,
    UINT,
    UINT8,
    UINT16,
    UINT64,
    ValueType,
)
from btcore.values.vectors import VECTOR_BOOL, VECTOR_DOUBLE, VECTOR_INT, VECTOR_STRING, VectorType

Int64 = Annotated[int, INT64]
"""An annotation for integers of 64 bits."""
UInt32 = Annotated[int, UINT]
"""An annotation for C++'s ``unsigned``."""
UInt64 = Annotated[int, UINT64]
"""An annotation for C++'s ``uint64_t``."""
Float32 = Annotated[float, FLOAT]
"""An annotation for C++'s ``float``."""

_BUILT_IN: Final[tuple[ValueType, ...]] = (
    ANY, ANY_VALUE, STRING, BOOL, INT, INT8, INT16, INT64, UINT, UINT8, UINT16, UINT64, FLOAT, DOUBLE,
    NODE_STATUS, PORT_DIRECTION, VECTOR_INT, VECTOR_DOUBLE, VECTOR_BOOL, VECTOR_STRING,
)  # fmt: skip

_OF_CLASS: Final[dict[object, ValueType]] = {
    bool: BOOL,
    int: INT,
    float: DOUBLE,
    str: STRING,
    Status: NODE_STATUS,
    PortDirection: PORT_DIRECTION,
    object: ANY,
    Any: ANY,
}


class UserType(ValueType):
    """A class of the user's, with the converters that it was registered with, if any.

    A dataclass without converters reads and writes ``json:{…}``, field by field.
    """

    def __init__(
        self,
        python_type: type,
        name: str,
        from_text: Callable[[str], object] | None = None,
        to_text: Callable[[Any], str] | None = None,
    ) -> None:
        super().__init__(name, python_type)
        self._from_text = from_text
        self._to_text = to_text

    @property
    def has_converters(self) -> bool:
        """Whether a text stands for its values."""
        return self._from_text is not None

    def set_converters(
        self, from_text: Callable[[str], object] | None, to_text: Callable[[Any], str] | None
    ) -> None:
        """Have these from now on."""
        self._from_text = from_text
        self._to_text = to_text

    def from_text(self, text: str, format: int = 4) -> object:
        """What the converter makes of *text*. Raises ConversionError, whatever the converter raises."""
        if format != 3 and text.startswith("json:") and is_dataclass(self.python_type):
            return self._from_json(text[5:])
        if self._from_text is None:
            return super().from_text(text, format)
        try:
            return self._from_text(text)
        except Exception as fault:
            raise ConversionError(f"'{text}' is no {self.name}: {fault}") from fault

    def to_text(self, value: object) -> str:
        """What the converter makes of *value*."""
        if self._to_text is not None:
            return self._to_text(value)
        if is_dataclass(value) and not isinstance(value, type):
            try:
                import json

                return "json:" + json.dumps(_record(value), ensure_ascii=False)
            except TypeError:
                pass
        return super().to_text(value)

    def _from_json(self, text: str) -> object:
        record = read_json(text)
        if not isinstance(record, dict):
            raise ConversionError(f"'json:{text}' is no JSON object")
        given = {str(key): value for key, value in record.items() if key != "__type"}
        try:
            return self.python_type(**given)
        except Exception as fault:
            raise ConversionError(f"'json:{text}' is no {self.name}: {fault}") from fault


class TypeRegistry:
    """What a registry knows of types: annotations, the user's classes, and enums by name.

    *enums* maps the names that scripts and enum ports may use to their numbers.
    """

    def __init__(self) -> None:
        self.enums: dict[str, int] = {}
        self._by_class: dict[object, ValueType] = dict(_OF_CLASS)
        self._by_name: dict[str, ValueType] = {one.name: one for one in _BUILT_IN}

    def of(self, annotation: object) -> ValueType:
        """The type that *annotation* means.

        Anything that BehaviorTree.CPP has no type for is a type of its own, whose values pass
        through the blackboard as they are, and which no text stands for.
        """
        if isinstance(annotation, ValueType):
            return annotation
        try:
            known = self._by_class.get(annotation)
        except TypeError:
            known = None
        if known is not None:
            return known
        origin = get_origin(annotation)
        if origin is Annotated:
            given = [one for one in get_args(annotation)[1:] if isinstance(one, ValueType)]
            return given[0] if given else self.of(get_args(annotation)[0])
        if origin in (Union, types.UnionType):
            return self._union(get_args(annotation))
        if origin is list and len(get_args(annotation)) == 1:
            item = self.of(get_args(annotation)[0])
            return self._keep(annotation, self.named(f"std::vector<{item.name}>") or VectorType(item))
        if isinstance(origin, type):
            return self.of(origin)
        if not isinstance(annotation, type):
            return ANY
        if issubclass(annotation, Enum):
            return self._keep(annotation, EnumType(annotation, annotation.__qualname__, self.enums))
        return self._keep(annotation, UserType(annotation, annotation.__qualname__))

    def add(
        self,
        python_type: type,
        from_text: Callable[[str], object] | None = None,
        to_text: Callable[[Any], str] | None = None,
        name: str | None = None,
    ) -> ValueType:
        """Register *python_type* with its text form, and a *name* for the wire. Returns its type.

        Raises RegistrationError for a type that has a text form already.
        """
        known = self._by_class.get(python_type)
        if python_type in _OF_CLASS or (known is not None and known.has_converters and from_text is not None):
            raise RegistrationError(f"{python_type.__qualname__} has a text form already")
        wire = name or python_type.__qualname__
        other = self._by_name.get(wire)
        if other is not None and other is not known:
            raise RegistrationError(
                f"a type called {wire} is registered already; give {python_type!r} another name"
            )
        if known is not None and known.name == wire:
            # Leaves that were registered before have ports of this type.
            if from_text is not None or to_text is not None:
                known.set_converters(from_text, to_text)
            return known
        kind: ValueType
        if issubclass(python_type, Enum):
            kind = EnumType(python_type, wire, self.enums, from_text, to_text)
        else:
            kind = UserType(python_type, wire, from_text, to_text)
        self._by_class[python_type] = kind
        self._by_name[wire] = kind
        return kind

    def add_enum(self, enum: type[Enum] | Mapping[str, int]) -> None:
        """Let scripts and ports know an enum, by a class or by names and numbers.

        Raises RegistrationError when a name stands for another number already.
        """
        members: dict[str, object]
        if isinstance(enum, Mapping):
            members = {**enum}
        else:
            members = {name: member.value for name, member in enum.__members__.items()}
            if enum not in self._by_class:
                self._keep(enum, EnumType(enum, enum.__qualname__, self.enums))
        numbers: dict[str, int] = {}
        for name, number in members.items():
            if not isinstance(number, int):
                raise RegistrationError(
                    f"the enum's {name} is {number!r}; BehaviorTree.CPP's enums are integers"
                )
            if self.enums.get(name, number) != number:
                raise RegistrationError(f"the enum name {name} is {self.enums[name]} already, not {number}")
            numbers[name] = int(number)
        self.enums.update(numbers)

    def named(self, cpp_name: str) -> ValueType | None:
        """The type that C++ calls *cpp_name*, or None."""
        return self._by_name.get(cpp_name)

    def _union(self, members: Iterable[object]) -> ValueType:
        """``T | None`` is T, since an entry without a value is none; any other union takes anything."""
        others = [one for one in members if one is not type(None)]
        return self.of(others[0]) if len(others) == 1 else ANY

    def _keep(self, annotation: object, kind: ValueType) -> ValueType:
        self._by_class[annotation] = kind
        self._by_name.setdefault(kind.name, kind)
        return kind


def type_of(value: object) -> ValueType:
    """The type that an entry takes from its first *value*; ANY for an empty list, which tells none.

    Raises BlackboardError for an integer of more than 64 bits.
    """
    kind = type(value)
    if kind is int:
        return _integer_type(value)
    found = _OF_CLASS.get(kind)
    if found is not None:
        return found
    if kind is list:
        return _list_type(value)
    if isinstance(value, str):
        return STRING
    if isinstance(value, Enum):
        members = value.__class__
        return EnumType(members, members.__qualname__)
    if isinstance(value, int):
        return _integer_type(value)
    if isinstance(value, float):
        return DOUBLE
    return UserType(kind, kind.__qualname__)


def to_builtin_number(value: object) -> object:
    """*value*, or the Python number that a foreign one (of numpy, say) stands for."""
    # One by one: compiled, a class of Python's own is told by one comparison.
    if isinstance(value, float) or isinstance(value, str) or isinstance(value, int):  # noqa: SIM101
        return value
    if isinstance(value, (list, Enum)):
        return value
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value)
    return value


def parse_constant(text: str) -> object:
    """What an attribute of a SubTree that is no pointer stands for in format 4.

    A whole integer, a whole real, or else the text itself.
    """
    number = whole_int(text)
    if number is not None:
        return number
    real = whole_float(text)
    return text if real is None else real


def to_text(value: object) -> str:
    """*value* as BehaviorTree.CPP's ``toStr`` writes it.

    Numbers by ``%d`` and ``%f``, bools as ``true`` and ``false``, lists as ``json:[…]``, enums by
    name. Raises ConversionError for what has no text form.
    """
    if value is None:
        raise ConversionError("there is no value, and so no text for it")
    return type_of(value).to_text(value)


def _integer_type(value: object) -> ValueType:
    assert isinstance(value, int)
    if INT.low <= value <= INT.high:
        return INT
    if value < MIN_INT64 or value > MAX_UINT64:
        raise BlackboardError(f"{value} can't be written: an entry holds integers of at most 64 bits")
    return INT64 if value <= INT64.high else UINT64


def _list_type(value: object) -> ValueType:
    assert isinstance(value, list)
    if not value:
        return ANY
    for kind in (VECTOR_INT, VECTOR_DOUBLE, VECTOR_BOOL, VECTOR_STRING):
        if kind.accepts(value):
            return kind
    return UserType(list, "list")


def _record(value: Any) -> dict[str, object]:
    return {"__type": type(value).__qualname__} | {
        one.name: getattr(value, one.name) for one in fields(value)
    }
