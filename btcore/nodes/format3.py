"""The nodes of format 3 that differ from those of format 4, or have no counterpart there."""

from typing import ClassVar, cast

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port, PortRole
from btcore.engine.control import ControlNode, DecoratorNode
from btcore.engine.node import execute_tick
from btcore.errors import BlackboardError, ConversionError, NodeError
from btcore.nodes.blackboard_actions import SetBlackboard
from btcore.nodes.branch import BranchNode
from btcore.nodes.ordered_control import OrderedNode
from btcore.nodes.parallel import threshold
from btcore.nodes.repeat import Repeat, RetryUntilSuccessful
from btcore.nodes.subtree import SubTree
from btcore.nodes.switch import FLOAT_EPSILON, SwitchNode
from btcore.nodes.timing import Delay
from btcore.status import (
    FAILURE,
    RUNNING,
    SUCCESS,
    Status,
)
from btcore.values import (
    ANY,
    BOOL,
    DOUBLE,
    INT,
    NODE_STATUS,
    STRING,
    ValueType,
)


@mypyc_attr(allow_interpreted_subclasses=True)
class SequenceStar(OrderedNode):
    """A Sequence that goes on at the child that failed; a halt starts it anew."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
    node_symbol: ClassVar[str] = "→"
    remembers: ClassVar[bool] = True
    continue_on: ClassVar[Status] = SUCCESS

    def finish_early(self) -> None:
        """Reset from the child that failed on, and remember it."""
        for index in range(self._next, len(self._children)):
            self.halt_child(index)


@mypyc_attr(allow_interpreted_subclasses=True)
class Parallel3(ControlNode):
    """Ticks the children that haven't completed, in order, and counts results as it goes.

    SUCCESS as soon as `success_threshold` succeeded; FAILURE as soon as `failure_threshold` failed, or
    too many for a success. Negative thresholds are from the end: −1 = all.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
    builtin_id: ClassVar[str] = "Parallel"
    node_symbol: ClassVar[str] = "⇉"
    skips_alone: ClassVar[bool] = False
    state_fields: ClassVar[tuple[str, ...] | None] = ("_completed",)

    _completed: set[int]

    @staticmethod
    def provided_ports() -> list[Port]:
        """The ports."""
        return [
            Port(
                "success_threshold",
                type=INT,
                description="successes needed, −1 = all",
                role=PortRole.SUCCESSES,
            ),
            Port(
                "failure_threshold",
                type=INT,
                default="1",
                description="failures that end it",
                role=PortRole.FAILURES,
            ),
        ]

    def prepare(self) -> None:
        """Nothing is completed."""
        self._completed = set()

    def tick(self) -> Status:
        """Tick the children that haven't completed, until the result is known."""
        count = len(self._children)
        needed = threshold(cast(int, self.get_input("success_threshold")), count)
        allowed = threshold(cast(int, self.get_input("failure_threshold")), count)
        if count < needed:
            raise NodeError(f"{count} children can never give {needed} successes")
        if count < allowed:
            raise NodeError(f"{count} children can never give {allowed} failures")
        successes = 0
        failures = 0
        for index in range(count):
            child = self._children[index]
            status = child._status if index in self._completed else execute_tick(child)
            if status is SUCCESS:
                self._completed.add(index)
                successes += 1
                if successes == needed:
                    return self._end(SUCCESS)
            elif status is FAILURE:
                self._completed.add(index)
                failures += 1
                if failures > count - needed or failures == allowed:
                    return self._end(FAILURE)
            elif status is not RUNNING:
                raise self.idle_child(index)
        return RUNNING

    def _end(self, status: Status) -> Status:
        self._completed = set()
        self.reset_children()
        return status

    def halt(self) -> None:
        """Halt the children; nothing is completed."""
        self._completed = set()
        self.reset_children()
        self.reset_status()


@mypyc_attr(allow_interpreted_subclasses=True)
class WhileDoElse3(BranchNode):
    """Ticks the condition on every tick, and the second child while it succeeds, the third while it fails.

    It has exactly three children.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
    builtin_id: ClassVar[str] = "WhileDoElse"
    child_count: ClassVar[tuple[int, int | None]] = (3, 3)
    child_roles: ClassVar[str] = "a condition, and two branches"

    def tick(self) -> Status:
        """Tick the condition, and the branch it asks for."""
        if len(self._children) != 3:
            raise NodeError(
                f"<WhileDoElse> takes a condition and two branches, not {len(self._children)} children"
            )
        self.set_status(RUNNING)
        condition = execute_tick(self._children[0])
        if condition is RUNNING:
            return RUNNING
        chosen = 1 if condition is SUCCESS else 2
        self.halt_child(3 - chosen)
        status = execute_tick(self._children[chosen])
        if status is not RUNNING:
            self.reset_children()
        return status


@mypyc_attr(allow_interpreted_subclasses=True)
class Repeat3(Repeat):
    """Ticks its child until it succeeded `num_cycles` times (−1 = for ever), within one tick if it can."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
    builtin_id: ClassVar[str] = "Repeat"
    yields: ClassVar[bool] = False


@mypyc_attr(allow_interpreted_subclasses=True)
class RetryUntilSuccessful3(RetryUntilSuccessful):
    """Ticks its child until it failed `num_attempts` times (−1 = for ever), all within one tick if it can."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
    builtin_id: ClassVar[str] = "RetryUntilSuccessful"
    yields: ClassVar[bool] = False

    def limit_after(self, limit: int) -> int:
        """The limit; format 3 doesn't read it again within a tick."""
        return limit


@mypyc_attr(allow_interpreted_subclasses=True)
class Delay3(Delay):
    """Ticks its child only when `delay_msec` milliseconds have passed since the start; RUNNING until then."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
    builtin_id: ClassVar[str] = "Delay"

    def ends_with(self, status: Status) -> bool:
        """Whether the next tick starts a new delay."""
        return status is not RUNNING


@mypyc_attr(allow_interpreted_subclasses=True)
class SetBlackboard3(SetBlackboard):
    """Writes `value` to the entry whose name `output_key` gives; `value="{key}"` copies that entry."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
    builtin_id: ClassVar[str] = "SetBlackboard"

    def nothing_to_copy(self, key: str) -> Status:
        """An empty entry is copied too."""
        entry = self._blackboard.find(key)
        if entry is not None:
            entry.value = None
        return SUCCESS

    def write(self, key: str, value: object) -> None:
        """Write *value* as it is."""
        self._blackboard.set(key, value)


@mypyc_attr(allow_interpreted_subclasses=True)
class SwitchNode3(SwitchNode):
    """Ticks the child whose `case_N` is the same text as `variable`, else the last child."""

    builtin_formats: ClassVar[tuple[int, ...]] = ()

    def equal(self, variable: str, case: str) -> bool:
        """Whether the texts are the same."""
        return variable == case


@mypyc_attr(allow_interpreted_subclasses=True)
class Switch2v3(SwitchNode3):
    """Ticks the child whose case (of two) equals `variable`, as a text, else the last child."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
    builtin_id: ClassVar[str] = "Switch2"
    child_count: ClassVar[tuple[int, int | None]] = (3, 3)


@mypyc_attr(allow_interpreted_subclasses=True)
class Switch3v3(SwitchNode3):
    """Ticks the child whose case (of three) equals `variable`, as a text, else the last child."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
    builtin_id: ClassVar[str] = "Switch3"
    child_count: ClassVar[tuple[int, int | None]] = (4, 4)


@mypyc_attr(allow_interpreted_subclasses=True)
class Switch4v3(SwitchNode3):
    """Ticks the child whose case (of four) equals `variable`, as a text, else the last child."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
    builtin_id: ClassVar[str] = "Switch4"
    child_count: ClassVar[tuple[int, int | None]] = (5, 5)


@mypyc_attr(allow_interpreted_subclasses=True)
class Switch5v3(SwitchNode3):
    """Ticks the child whose case (of five) equals `variable`, as a text, else the last child."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
    builtin_id: ClassVar[str] = "Switch5"
    child_count: ClassVar[tuple[int, int | None]] = (6, 6)


@mypyc_attr(allow_interpreted_subclasses=True)
class Switch6v3(SwitchNode3):
    """Ticks the child whose case (of six) equals `variable`, as a text, else the last child."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
    builtin_id: ClassVar[str] = "Switch6"
    child_count: ClassVar[tuple[int, int | None]] = (7, 7)


@mypyc_attr(allow_interpreted_subclasses=True)
class BlackboardCheck(DecoratorNode):
    """Ticks its child while `value_A` equals `value_B`, else gives `return_on_mismatch` (FAILURE if absent).

    Both are read as *element* on every tick, also while the child runs, which a mismatch halts. What
    can't be read is a mismatch; reals are equal within the precision of a float.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = ()
    element: ClassVar[ValueType] = STRING

    @staticmethod
    def provided_ports() -> list[Port]:
        """The ports."""
        return [
            Port("value_A", type=ANY, description="one value", optional=True),
            Port("value_B", type=ANY, description="the other", optional=True),
            Port(
                "return_on_mismatch",
                type=NODE_STATUS,
                description="the result if they differ",
                optional=True,
            ),
        ]

    def tick(self) -> Status:
        """Compare, then tick the child."""
        self.set_status(RUNNING)
        if self._match():
            return execute_tick(self.child)
        if self.child._status is RUNNING:
            self.halt_child()
        try:
            return cast(Status, self.get_input("return_on_mismatch"))
        except (NodeError, BlackboardError, ConversionError):
            return FAILURE

    def _match(self) -> bool:
        try:
            left = self._read("value_A")
            right = self._read("value_B")
        except (NodeError, BlackboardError, ConversionError):
            return False
        if isinstance(left, float) and isinstance(right, float):
            return abs(left - right) <= FLOAT_EPSILON
        return left == right

    def _read(self, name: str) -> object:
        value = self.get_input(name)
        if isinstance(value, str):
            return self.element.from_text(value, 3)
        return self.element.cast(value)


@mypyc_attr(allow_interpreted_subclasses=True)
class BlackboardCheckInt(BlackboardCheck):
    """Ticks its child while `value_A` equals `value_B` as integers, else gives `return_on_mismatch`."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
    element: ClassVar[ValueType] = INT


@mypyc_attr(allow_interpreted_subclasses=True)
class BlackboardCheckDouble(BlackboardCheck):
    """Ticks its child while `value_A` equals `value_B` as real numbers, else gives `return_on_mismatch`."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
    element: ClassVar[ValueType] = DOUBLE


@mypyc_attr(allow_interpreted_subclasses=True)
class BlackboardCheckString(BlackboardCheck):
    """Ticks its child while `value_A` equals `value_B` as texts, else gives `return_on_mismatch`."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
    element: ClassVar[ValueType] = STRING


@mypyc_attr(allow_interpreted_subclasses=True)
class BlackboardCheckBool(BlackboardCheck):
    """Ticks its child while `value_A` equals `value_B` as truth values, else gives `return_on_mismatch`."""

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
    element: ClassVar[ValueType] = BOOL


@mypyc_attr(allow_interpreted_subclasses=True)
class SubTree3(SubTree):
    """Ticks the root of the tree named by `ID`, which has a blackboard of its own.

    `inner="outer"` (without braces) is one entry under two names; with `__shared_blackboard` both
    trees use one blackboard.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
    builtin_id: ClassVar[str] = "SubTree"

    @staticmethod
    def provided_ports() -> list[Port]:
        """None; the attributes are names."""
        return []


@mypyc_attr(allow_interpreted_subclasses=True)
class SubTreePlus(SubTree3):
    """Ticks the root of the tree named by `ID`, with remapping as in format 4.

    `inner="{outer}"` is one entry under two names, anything else a constant; with `__autoremap` every
    name that the inner tree uses is the outer one's.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (3,)
