"""Switches: the value of an entry selects the child."""

import math
import re
from typing import ClassVar, Final

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Input, Port
from btcore.engine.control import ControlNode
from btcore.engine.node import execute_tick
from btcore.errors import BlackboardError, ConversionError, NodeError
from btcore.status import RUNNING, SKIPPED, Status
from btcore.values import STRING

# The syntax of std::from_chars, applied to the whole text: no leading space and no plus sign. Python refuses
# to convert more than 4,300 digits. Compiled on first use, because most trees have no switch.
_INTEGER: Final = r"-?[0-9]{1,4000}"
_REAL: Final = r"(?i)-?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?|inf(?:inity)?|nan)"
FLOAT_EPSILON: Final = 1.1920928955078125e-07
"""Real numbers that differ by no more than this are equal: C's FLT_EPSILON."""


def _integer(text: str, enums: dict[str, int]) -> int | None:
    if text in enums:
        return enums[text]
    if re.fullmatch(_INTEGER, text):
        value = int(text)
        if -(2**31) <= value < 2**31:
            return value
    return None


def _real(text: str, enums: dict[str, int]) -> float | None:
    if text in enums:
        return float(enums[text])
    return float(text) if re.fullmatch(_REAL, text) else None


def values_equal(left: str, right: str, enums: dict[str, int]) -> bool:
    """Return whether two texts are equal as texts, as integers, or as real numbers.

    Real numbers are equal if they differ by at most FLOAT_EPSILON (BehaviorTree.CPP,
    include/behaviortree_cpp/controls/switch_node.h).

    Args:
        left: A text.
        right: Another text.
        enums: The integers that names stand for.
    """
    if left == right:
        return True
    left_integer = _integer(left, enums)
    if left_integer is not None and left_integer == _integer(right, enums):
        return True
    left_real = _real(left, enums)
    right_real = _real(right, enums)
    if left_real is None or right_real is None or math.isnan(left_real) or math.isnan(right_real):
        return False
    return left_real == right_real or abs(left_real - right_real) <= FLOAT_EPSILON


@mypyc_attr(allow_interpreted_subclasses=True)
class SwitchNode(ControlNode):
    """Ticks the child whose `case_N` equals `variable`, else the last child.

    Two values are equal if they are the same text, the same integer (or enum name), or the same real number.
    The node returns the child's result. When another child is selected, the child that was RUNNING is halted.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = ()
    node_symbol: ClassVar[str] = "⋔"
    skips_alone: ClassVar[bool] = False
    state_fields: ClassVar[tuple[str, ...] | None] = ("_running",)
    child_roles: ClassVar[str] = "one for each case, and a default"

    _running: int = -1
    _variable: Input | None = None
    _cases: list[Input | None]

    @classmethod
    def provided_ports(cls) -> list[Port]:
        """Return the ports: `variable`, and a case for each child except the last."""
        count = cls.child_count[0]
        cases = [Port(f"case_{number}", type=STRING, optional=True) for number in range(1, count)]
        return [Port("variable", type=STRING), *cases]

    def prepare(self) -> None:
        """Look up the ports."""
        self._running = -1
        inputs = self.config.inputs
        self._variable = inputs.get("variable")
        self._cases = [inputs.get(f"case_{number}") for number in range(1, self.child_count[0])]

    def choose(self) -> int:
        """Return the index of the selected child."""
        variable = self.text(self._variable)
        if variable is not None:
            for index in range(len(self._cases)):
                case = self.text(self._cases[index])
                if case is not None and self.equal(variable, case):
                    return index
        return len(self._cases)

    def equal(self, variable: str, case: str) -> bool:
        """Return whether *variable* equals *case*."""
        return values_equal(variable, case, self.config.enums)

    def text(self, port: Input | None) -> str | None:
        """Return the text of *port*, or None if it cannot be read."""
        if port is None:
            return None
        try:
            return str(port.read())
        except (BlackboardError, ConversionError):
            return None

    def tick(self) -> Status:
        """Tick the selected child."""
        count, cases = len(self._children), len(self._cases)
        if count != cases + 1:
            raise NodeError(f"<{self.id}> takes {cases} cases and a default, not {count} children")
        chosen = self.choose()
        if self._running != -1 and self._running != chosen:
            self.halt_child(self._running)
        status = execute_tick(self._children[chosen])
        if status is SKIPPED:
            self._running = -1
        elif status is RUNNING:
            self._running = chosen
        else:
            self._running = -1
            self.reset_children()
        return status

    def halt(self) -> None:
        """Halt the children."""
        self._running = -1
        self.reset_children()
        self.reset_status()


@mypyc_attr(allow_interpreted_subclasses=True)
class Switch2(SwitchNode):
    """Ticks the child whose case (of two) equals `variable`, else the last child."""

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    batch_class: ClassVar[str] = "btcore.batch.branch:Switch"
    child_count: ClassVar[tuple[int, int | None]] = (3, 3)


@mypyc_attr(allow_interpreted_subclasses=True)
class Switch3(SwitchNode):
    """Ticks the child whose case (of three) equals `variable`, else the last child."""

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    batch_class: ClassVar[str] = "btcore.batch.branch:Switch"
    child_count: ClassVar[tuple[int, int | None]] = (4, 4)


@mypyc_attr(allow_interpreted_subclasses=True)
class Switch4(SwitchNode):
    """Ticks the child whose case (of four) equals `variable`, else the last child."""

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    batch_class: ClassVar[str] = "btcore.batch.branch:Switch"
    child_count: ClassVar[tuple[int, int | None]] = (5, 5)


@mypyc_attr(allow_interpreted_subclasses=True)
class Switch5(SwitchNode):
    """Ticks the child whose case (of five) equals `variable`, else the last child."""

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    batch_class: ClassVar[str] = "btcore.batch.branch:Switch"
    child_count: ClassVar[tuple[int, int | None]] = (6, 6)


@mypyc_attr(allow_interpreted_subclasses=True)
class Switch6(SwitchNode):
    """Ticks the child whose case (of six) equals `variable`, else the last child."""

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    batch_class: ClassVar[str] = "btcore.batch.branch:Switch"
    child_count: ClassVar[tuple[int, int | None]] = (7, 7)
