"""Recorded answers of the C++ engine about values: one script case, one conversion case.

Each function says what differs, as a sentence, or None where nothing does.
"""

import math
from collections.abc import Mapping
from enum import Enum, IntEnum
from typing import Any, Final

from btcore.blackboard.blackboard import Blackboard
from btcore.errors import BtcoreError
from btcore.script.program import compile_script
from btcore.values import (
    BOOL,
    DOUBLE,
    FLOAT,
    INT,
    INT8,
    INT16,
    INT64,
    NODE_STATUS,
    PORT_DIRECTION,
    STRING,
    UINT,
    UINT8,
    UINT16,
    UINT64,
    VECTOR_BOOL,
    VECTOR_DOUBLE,
    VECTOR_INT,
    VECTOR_STRING,
    ValueType,
    number_of,
    to_text,
)

ENUMS: Final[Mapping[str, int]] = {"RED": 1, "GREEN": 2, "BLUE": 3}
"""The enums that every recorded script knows."""

RECORDED_TYPES: Final[Mapping[str, ValueType]] = {
    "bool": BOOL,
    "string": STRING,
    "int": INT,
    "int8": INT8,
    "int16": INT16,
    "int32": INT,
    "int64": INT64,
    "unsigned": UINT,
    "uint8": UINT8,
    "uint16": UINT16,
    "uint32": UINT,
    "uint64": UINT64,
    "float": FLOAT,
    "double": DOUBLE,
    "NodeStatus": NODE_STATUS,
    "PortDirection": PORT_DIRECTION,
    "vector<bool>": VECTOR_BOOL,
    "vector<int>": VECTOR_INT,
    "vector<double>": VECTOR_DOUBLE,
    "vector<string>": VECTOR_STRING,
}
"""The names that conversion cases use for types."""


def recorded_value(value: object) -> object:
    """*value* as the recordings show one: numbers as doubles, a text, None for none, "?" for the rest.

    JSON holds no infinity and no NaN; the recordings have null for them too.
    """
    if value is None or isinstance(value, str):
        return value
    number = number_of(value)
    if number is None:
        return "?"
    return float(number) if math.isfinite(number) else None


def recorded_blackboard(board: Blackboard) -> dict[str, object]:
    """The entries stored in *board*, as the recordings show them: by what each key leads to.

    So an entry that is itself called ``@x`` shows what the root's ``x`` holds.
    """
    shown: dict[str, object] = {}
    for key in sorted(board.local_entries()):
        entry = board.find(key)
        shown[key] = None if entry is None else recorded_value(entry.value)
    return shown


def compare_script_case(case: Mapping[str, Any]) -> str | None:
    """What differs when the script of *case* runs, in value, error or blackboard."""
    board = Blackboard()
    for key, value in case["bb"].items():
        board.set(key, value)
    expected: Mapping[str, Any] = case["expect"]
    try:
        value = recorded_value(compile_script(case["script"], ENUMS).run(board))
    except BtcoreError as fault:
        if "error" not in expected:
            return f"raised ({fault}), where the original gave {expected.get('value')!r}"
    else:
        if "error" in expected:
            return f"gave {value!r}, where the original raised: {expected['error']}"
        if not _equal(value, expected.get("value")):
            return f"gave {value!r}, where the original gave {expected.get('value')!r}"
    found = recorded_blackboard(board)
    wanted: Mapping[str, Any] = expected["bb"]
    if found.keys() != wanted.keys() or not all(_equal(found[key], wanted[key]) for key in wanted):
        return f"left {found} on the blackboard, where the original left {dict(wanted)}"
    return None


def compare_conversion_case(case: Mapping[str, Any]) -> str | None:
    """What differs when the text of *case* is converted to its type."""
    kind = RECORDED_TYPES.get(case["convert"])
    if kind is None:
        return f"there is no type called {case['convert']}"
    expected: Mapping[str, Any] = case["expect"]
    try:
        value = kind.from_text(case["text"])
    except BtcoreError as fault:
        if "error" not in expected:
            return f"raised ({fault}), where the original gave {expected['value']!r}"
        return None
    if "error" in expected:
        return f"gave {value!r}, where the original raised: {expected['error']}"
    shown = int(value) if isinstance(value, IntEnum) and isinstance(expected["value"], int) else _named(value)
    if not _equal(shown, expected["value"]):
        return f"gave {value!r}, where the original gave {expected['value']!r}"
    return None


def _named(value: object) -> object:
    """*value* as a conversion case shows it: what JSON can't hold by its name."""
    if isinstance(value, list):
        return [_named(one) for one in value]
    if isinstance(value, Enum):
        return to_text(value)
    if isinstance(value, float) and not math.isfinite(value):
        return "nan" if math.isnan(value) else ("inf" if value > 0 else "-inf")
    return value


def _equal(found: object, wanted: object) -> bool:
    """Whether both are the same value of the same kind: True is not 1, and 1 is not 1.0."""
    if isinstance(found, list) and isinstance(wanted, list):
        return len(found) == len(wanted) and all(map(_equal, found, wanted))
    return type(found) is type(wanted) and found == wanted
