"""Switches: the value of an entry selects the child."""

from typing import ClassVar, Final

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Input, Port
from btcore.engine.control import ControlNode
from btcore.engine.node import execute_tick
from btcore.engine.node_spec import NodeSpec
from btcore.errors import BlackboardError, ConversionError, NodeError, UndecidedOperandError
from btcore.status import RUNNING, SKIPPED, Status
from btcore.values import STRING, number_of, parse_constant

FLOAT_EPSILON: Final = 1.1920928955078125e-07
"""Real numbers are equal if they differ by at most C's FLT_EPSILON, as in BehaviorTree.CPP."""


def values_equal(left: str, right: str, enums: dict[str, int]) -> bool:
    """Return whether two texts are equal as texts or as numbers, which may be names of *enums*.

    The rules are those of BehaviorTree.CPP (src/controls/switch_node.cpp). Infinite numbers are equal only if
    their texts are equal.
    """
    if left == right:
        return True
    # BehaviorTree.CPP compares integers first, but two integers that are equal are also equal as reals.
    first = number_of(enums.get(left, parse_constant(left)))
    second = number_of(enums.get(right, parse_constant(right)))
    if first is None or second is None:
        return False
    return abs(float(first) - float(second)) <= FLOAT_EPSILON


@mypyc_attr(allow_interpreted_subclasses=True)
class SwitchNode(ControlNode):
    """Ticks the child whose `case_N` equals `variable`, else the last child.

    Two values are equal if they are the same text or, in format 4, the same integer (or enum name) or the
    same real number. The node returns the child's result. When another child is selected, the child that was
    RUNNING is halted.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(
        symbol="⋔",
        state_fields=("_running_index",),
        skips_alone=False,
        child_roles="one for each case, and a default",
    )

    _running_index: int = -1  # of the child that is RUNNING; -1 = none
    _variable: Input | None = None
    _cases: list[Input | None]

    @classmethod
    def provided_ports(cls) -> list[Port]:
        """Return the ports: `variable`, and a case for each child except the last."""
        count = cls.spec.child_count[0]
        cases = [Port(f"case_{number}", type=STRING, optional=True) for number in range(1, count)]
        return [Port("variable", type=STRING), *cases]

    def prepare(self) -> None:
        """Look up the ports."""
        self._running_index = -1
        inputs = self.config.inputs
        self._variable = inputs.get("variable")
        self._cases = [inputs.get(f"case_{number}") for number in range(1, self.spec.child_count[0])]

    def choose(self) -> int:
        """Return the index of the selected child."""
        # Read in every tick, and without an error: an unreadable variable selects the last child.
        try:
            variable = self.text(self._variable)
        except UndecidedOperandError as undecided:
            return self._choose_undecided(undecided)
        if variable is not None:
            only_texts = self.config.format == 3
            for index in range(len(self._cases)):
                case = self.text(self._cases[index])
                if case == variable:
                    return index
                if case is not None and not only_texts and values_equal(variable, case, self.config.enums):
                    return index
        return len(self._cases)

    def _choose_undecided(self, undecided: UndecidedOperandError) -> int:
        for index in range(len(self._cases)):
            case = self.text(self._cases[index])
            if case is not None and undecided.decide("==", undecided.operand, case):
                return index
        return len(self._cases)

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
            raise NodeError(f"<{self.config.id}> takes {cases} cases and a default, not {count} children")
        chosen = self.choose()
        if self._running_index != -1 and self._running_index != chosen:
            self.halt_child(self._running_index)
        status = execute_tick(self._children[chosen])
        if status is SKIPPED:
            # The default child is not ticked instead, and no child is reset, as in BehaviorTree.CPP.
            self._running_index = -1
        elif status is RUNNING:
            self._running_index = chosen
        else:
            self._running_index = -1
            self.reset_children()
        return status

    def halt(self) -> None:
        """Halt the children."""
        self._running_index = -1
        super().halt()


@mypyc_attr(allow_interpreted_subclasses=True)
class Switch2(SwitchNode):
    """Ticks the child whose case (`case_1` or `case_2`) equals `variable`, else the last child."""

    spec: ClassVar[NodeSpec] = NodeSpec(child_count=(3, 3), formats=(3, 4))


@mypyc_attr(allow_interpreted_subclasses=True)
class Switch3(SwitchNode):
    """Ticks the child whose case (`case_1` to `case_3`) equals `variable`, else the last child."""

    spec: ClassVar[NodeSpec] = NodeSpec(child_count=(4, 4), formats=(3, 4))


@mypyc_attr(allow_interpreted_subclasses=True)
class Switch4(SwitchNode):
    """Ticks the child whose case (`case_1` to `case_4`) equals `variable`, else the last child."""

    spec: ClassVar[NodeSpec] = NodeSpec(child_count=(5, 5), formats=(3, 4))


@mypyc_attr(allow_interpreted_subclasses=True)
class Switch5(SwitchNode):
    """Ticks the child whose case (`case_1` to `case_5`) equals `variable`, else the last child."""

    spec: ClassVar[NodeSpec] = NodeSpec(child_count=(6, 6), formats=(3, 4))


@mypyc_attr(allow_interpreted_subclasses=True)
class Switch6(SwitchNode):
    """Ticks the child whose case (`case_1` to `case_6`) equals `variable`, else the last child."""

    spec: ClassVar[NodeSpec] = NodeSpec(child_count=(7, 7), formats=(3, 4))
