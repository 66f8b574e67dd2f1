"""Values that mock leaves write to their output ports, drawn from the types of the ports."""

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from random import Random
from typing import Any, Final, get_type_hints

from btcore.values import (
    BOOL,
    STRING,
    EnumType,
    IntegerType,
    RealType,
    TypeRegistry,
    UserType,
    ValueType,
    VectorType,
)

_LARGEST: Final = 100
_LETTERS: Final = "abc 12"
_MAX_DEPTH: Final = 4
"""The maximum number of classes and lists inside each other; a class may contain itself."""


def draw_value(kind: ValueType, source: Random, depth: int = _MAX_DEPTH) -> object:
    """Return a random value of a type, or None if values of the type cannot be drawn.

    Values can be drawn for bool, numbers, texts, enums, and for lists, dataclasses and named tuples of these.

    Args:
        kind: The type.
        source: The source of random numbers.
        depth: The maximum number of classes and lists inside each other.
    """
    if kind is BOOL:
        return source.random() < 0.5
    if isinstance(kind, IntegerType):
        return source.randint(max(kind.low, -_LARGEST), min(kind.high, _LARGEST))
    if isinstance(kind, RealType):
        return round(source.uniform(-_LARGEST, _LARGEST), 3)
    if kind is STRING:
        return "".join(source.choices(_LETTERS, k=source.randint(0, 5)))
    if isinstance(kind, EnumType):
        return source.choice(kind.members) if kind.members else None
    if depth and isinstance(kind, VectorType):
        items = [draw_value(kind.item, source, depth - 1) for _ in range(source.randint(0, 3))]
        return None if None in items else items
    if depth and isinstance(kind, UserType):
        return _record(kind.python_type, source, depth - 1)
    return None


def _record(cls: type[Any], source: Random, depth: int) -> object:
    """Return a dataclass or a named tuple with random values, or None."""
    if is_dataclass(cls):
        required = {
            field.name: field.default is MISSING and field.default_factory is MISSING
            for field in fields(cls)
            if field.init
        }
    elif names := getattr(cls, "_fields", ()):  # a named tuple
        defaults: Mapping[str, object] = getattr(cls, "_field_defaults", {})
        required = {name: name not in defaults for name in names}
    else:
        return None
    types = TypeRegistry()
    try:
        hints = get_type_hints(cls, include_extras=True)
        values = {name: draw_value(types.of(hints[name]), source, depth) for name in required}
        if any(values[name] is None for name in required if required[name]):
            return None
        return cls(**{name: value for name, value in values.items() if value is not None})
    except Exception:
        return None  # the class rejects the values
