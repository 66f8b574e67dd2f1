"""Numbers in scripts behave like the doubles of BehaviorTree.CPP in every implementation of the operators."""

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
    """A user-defined subclass of float."""


EDGES = [0, -0.0, 0.0, 1, -1, 2**31 - 1, 2**31, -(2**31), -(2**31) - 1, 2**53 - 1, 2**53, 2**53 + 1, 2**63]
EDGES += [2.0**31, -(2.0**31), 2.0**53, 2.0**63, 0.5, math.inf, -math.inf, math.nan, 5e-324, 1.7e308]
OTHERS = [True, False, Level.HIGH, Colour.RED, Status.SUCCESS, Real(0.25), "2", "", [1]]
INTEGERS = st.integers(MIN_INT64, 2**64 - 1)
VALUES = st.one_of(st.sampled_from([*EDGES, *OTHERS]), INTEGERS, st.floats())


def outcome(compute: Any) -> tuple[str, object]:
    """Return the exact result of *compute*, including the sign of zero, or that it raises."""
    try:
        value = compute()
    except (ConversionError, ScriptError):
        return ("raised", None)
    return (type(value).__name__, repr(value))


@given(VALUES, VALUES, st.sampled_from("+-*/"))
def test_operator_chain_gives_the_same_result_as_its_operator(left: object, right: object, sign: str) -> None:
    board = Blackboard()
    board["left"], board["right"] = left, right
    program = compile_script(f"left {sign} right")
    by_rule = outcome(lambda: operate(OPERATORS[sign], left, right))
    assert outcome(lambda: program.run(board)) == by_rule


@pytest.mark.parametrize("value", EDGES)
def test_quick_double_is_exact_or_nan(value: Any) -> None:
    quick = quick_double(value)
    assert math.isnan(quick) or (quick == value and math.copysign(1, quick) == math.copysign(1, value))
    if isinstance(value, float) or abs(value) < 2**31:
        assert math.isnan(quick) == (value != value)


def test_quick_double_accepts_bools_and_enums_and_gives_nan_otherwise() -> None:
    assert [quick_double(value) for value in (True, False, Level.HIGH, Real(0.25))] == [1.0, 0.0, 3.0, 0.25]
    assert all(math.isnan(quick_double(value)) for value in ("2", "", None, [1], Colour.RED))


LIMITS = [(MIN_INT64, MAX_INT64), (-128, 127), (0, 255), (0, 1), (-(2**31), 2**31 - 1), (0, 2**64 - 1)]


@given(st.one_of(st.sampled_from(EDGES), st.integers(), st.floats()), st.sampled_from(LIMITS))
def test_as_int_accepts_whole_numbers_within_the_limits(number: Any, limits: tuple[int, int]) -> None:
    low, high = limits
    whole = isinstance(number, int) or (math.isfinite(number) and number == math.floor(number))
    if whole and low <= int(number) <= high:
        value = as_int(number, low, high)
        assert (type(value), value) == (int, int(number))
    else:
        with pytest.raises(ConversionError):
            as_int(number, low, high)
