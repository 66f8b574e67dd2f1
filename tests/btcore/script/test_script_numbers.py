"""Numbers in scripts are the original's doubles, whichever way the engine computes with them."""

import enum
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from btcore import Blackboard, ConversionError, ScriptError, Status
from btcore.script.operators import OPERATORS, operate
from btcore.script.program import compile_script
from btcore.values.numbers import MAX_INT64, MIN_INT64
from btcore.values.types import as_int, quick_double


class Level(enum.IntEnum):
    LOW = 1
    HIGH = 3


class Colour(enum.Enum):
    RED = 1


class Real(float):
    """A float of somebody else's."""


EDGES = [0, -0.0, 0.0, 1, -1, 2**31 - 1, 2**31, -(2**31), -(2**31) - 1, 2**53 - 1, 2**53, 2**53 + 1, 2**63]
EDGES += [2.0**31, -(2.0**31), 2.0**53, 2.0**63, 0.5, math.inf, -math.inf, math.nan, 5e-324, 1.7e308]
OTHERS = [True, False, Level.HIGH, Colour.RED, Status.SUCCESS, Real(0.25), "2", "", [1]]
INTEGERS = st.integers(MIN_INT64, 2**64 - 1)
VALUES = st.one_of(st.sampled_from([*EDGES, *OTHERS]), INTEGERS, st.floats())


def outcome(compute: Any) -> tuple[str, object]:
    """What *compute* returns, exactly (also the sign of zero), or that it raises."""
    try:
        value = compute()
    except (ConversionError, ScriptError):
        return ("raised", None)
    return (type(value).__name__, repr(value))


@given(VALUES, VALUES, st.sampled_from("+-*/"))
def test_a_chain_computes_what_its_operator_does(left: object, right: object, sign: str) -> None:
    board = Blackboard()
    board["left"], board["right"] = left, right
    program = compile_script(f"left {sign} right")
    by_rule = outcome(lambda: operate(OPERATORS[sign], left, right))
    assert outcome(lambda: program.run(board)) == by_rule


@pytest.mark.parametrize("value", EDGES)
def test_what_is_quick_is_exact_and_what_is_not_says_nothing(value: Any) -> None:
    quick = quick_double(value)
    assert math.isnan(quick) or (quick == value and math.copysign(1, quick) == math.copysign(1, value))
    if isinstance(value, float) or abs(value) < 2**31:
        assert math.isnan(quick) == (value != value)


def test_a_bool_and_an_enum_count_as_numbers_and_all_else_as_nothing() -> None:
    assert [quick_double(one) for one in (True, False, Level.HIGH, Real(0.25))] == [1.0, 0.0, 3.0, 0.25]
    assert all(math.isnan(quick_double(one)) for one in ("2", "", None, [1], Colour.RED))


LIMITS = [(MIN_INT64, MAX_INT64), (-128, 127), (0, 255), (0, 1), (-(2**31), 2**31 - 1), (0, 2**64 - 1)]


@given(st.one_of(st.sampled_from(EDGES), st.integers(), st.floats()), st.sampled_from(LIMITS))
def test_an_integer_is_what_is_whole_and_within_its_limits(number: Any, limits: tuple[int, int]) -> None:
    low, high = limits
    whole = isinstance(number, int) or (math.isfinite(number) and number == math.floor(number))
    if whole and low <= int(number) <= high:
        value = as_int(number, low, high)
        assert (type(value), value) == (int, int(number))
    else:
        with pytest.raises(ConversionError):
            as_int(number, low, high)
