"""The built-in nodes of format 3 that differ from those of format 4 or do not exist in format 4."""

from typing import ClassVar, cast

from mypy_extensions import mypyc_attr

from btcore.blackboard.blackboard import Entry
from btcore.blackboard.ports import Port
from btcore.engine.control import DecoratorNode
from btcore.engine.node import execute_tick, input_or, set_status
from btcore.engine.node_spec import NodeSpec
from btcore.errors import BlackboardError, ConversionError, NodeError
from btcore.nodes.blackboard_actions import SetBlackboard
from btcore.nodes.branch import BranchNode
from btcore.nodes.parallel import ParallelNode, failure_port, required_results, success_port
from btcore.nodes.repeat import Repeat, RetryUntilSuccessful
from btcore.nodes.sequences_and_fallbacks import OrderedNode
from btcore.nodes.subtree import SubTree
from btcore.nodes.switch import FLOAT_EPSILON
from btcore.status import FAILURE, RUNNING, SUCCESS, Status
from btcore.values import ANY, BOOL, DOUBLE, INT, NODE_STATUS, STRING, ValueType


@mypyc_attr(allow_interpreted_subclasses=True)
class SequenceStar(OrderedNode):
    """A Sequence that starts again at the child that failed.

    When a child fails, only this child and the following children are reset, and the next start begins
    with this child. After a halt it begins with the first child.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(symbol="→", continue_on=SUCCESS, formats=(3,))
    has_memory: ClassVar[bool] = True


@mypyc_attr(allow_interpreted_subclasses=True)
class Parallel3(ParallelNode):
    """Ticks in order the children that have not completed, until enough have succeeded or failed.

    The node succeeds as soon as `success_threshold` children have succeeded. It fails as soon as
    `failure_threshold` children have failed, or `success_threshold` can no longer be reached.
    The following children are then not ticked, and RUNNING children are halted. Otherwise it is RUNNING. A
    negative threshold −n means the number of children + 1 − n: −1 = all. A threshold above the number of
    children is an error.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(3,))

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return [success_port("success_threshold"), failure_port("failure_threshold")]

    def tick(self) -> Status:
        """Tick the children that have not completed, until the result is known."""
        count = len(self._children)
        success_threshold = cast(int, self.get_input("success_threshold"))
        failure_threshold = cast(int, self.get_input("failure_threshold"))
        success_limit = required_results(success_threshold, count, "successes")
        failure_limit = required_results(failure_threshold, count, "failures")
        successes = 0
        failures = 0
        for index in range(count):
            child = self._children[index]
            status = child._status if index in self._completed else execute_tick(child)
            if status is SUCCESS:
                self._completed.add(index)
                successes += 1
                # Counted again in every tick, so "==" is reached; with a threshold of 0 never, as in C++.
                if successes == success_limit:
                    return self.finish(SUCCESS)
            elif status is FAILURE:
                self._completed.add(index)
                failures += 1
                if failures > count - success_limit or failures == failure_limit:
                    return self.finish(FAILURE)
            elif status is not RUNNING:
                raise self.idle_child_error(index)
        return RUNNING


@mypyc_attr(allow_interpreted_subclasses=True)
class WhileDoElse3(BranchNode):
    """Ticks the first child, a condition, in every tick, and the second or third child by its result.

    While the condition succeeds, the second child is ticked; while it fails, the third. The node returns
    the result of the selected child. When the result of the condition changes, the child that was RUNNING
    is halted. The node has exactly three children.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(
        child_count=(3, 3), child_roles="a condition, and two branches", formats=(3,)
    )

    def tick(self) -> Status:
        """Tick the condition and the branch that it selects."""
        if len(self._children) != 3:
            raise NodeError(
                f"<WhileDoElse> takes a condition and two branches, not {len(self._children)} children"
            )
        set_status(self, RUNNING)
        condition = execute_tick(self._children[0])
        if condition is RUNNING:
            return RUNNING
        # Format 3 has no SKIPPED, so any other result is FAILURE.
        chosen = 1 if condition is SUCCESS else 2
        self.halt_child(3 - chosen)
        status = execute_tick(self._children[chosen])
        if status is not RUNNING:
            self.reset_children()
        return status


@mypyc_attr(allow_interpreted_subclasses=True)
class Repeat3(Repeat):
    """Ticks its child until it has succeeded `num_cycles` times, and succeeds; −1 = forever.

    The node fails as soon as the child fails. Unless the child is RUNNING, all cycles happen in one tick.
    With 0 cycles it succeeds without ticking the child.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(3,))
    is_async: ClassVar[bool] = False


@mypyc_attr(allow_interpreted_subclasses=True)
class RetryUntilSuccessful3(RetryUntilSuccessful):
    """Ticks its child until it has failed `num_attempts` times, and fails; −1 = forever.

    The node succeeds as soon as the child succeeds. Unless the child is RUNNING, all attempts happen in one
    tick. With 0 attempts it fails without ticking the child.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(3,))
    is_async: ClassVar[bool] = False

    def limit_after(self, limit: int) -> int:
        """Return *limit*: format 3 reads the port once per tick."""
        return limit


@mypyc_attr(allow_interpreted_subclasses=True)
class RetryUntilSuccesful(RetryUntilSuccessful3):
    """Is `RetryUntilSuccessful` with the spelling of early releases of BehaviorTree.CPP 3."""

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(3,))


@mypyc_attr(allow_interpreted_subclasses=True)
class SetBlackboard3(SetBlackboard):
    """Writes `value` to the entry named by `output_key` (without braces), and succeeds.

    `value="{key}"` copies the entry `key` with its type, even if it was never written.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(results=frozenset({SUCCESS}), formats=(3,))

    def nothing_to_copy(self, key: str) -> Status:
        """Remove the value of the destination, as the entry to copy has no value. Return SUCCESS."""
        entry = self._blackboard.find(key)
        if entry is not None:
            entry.value = None
        return SUCCESS

    def copy(self, key: str, source: Entry) -> None:
        """Replace the value of the destination. In format 3 its type remains, and may be another type."""
        entry = self._blackboard.find(key)
        if entry is not None:
            entry.put(source.value, self._blackboard.now())

    def put_text(self, key: str, text: str) -> None:
        """Write *text* without conversion."""
        self._blackboard.set(key, text)


@mypyc_attr(allow_interpreted_subclasses=True)
class BlackboardCheck(DecoratorNode):
    """Ticks its child while `value_A` equals `value_B`, else returns `return_on_mismatch` (default FAILURE).

    Both values are read in every tick, as *value_type*. If they differ while the child is RUNNING, the child
    is halted. A value that cannot be read or converted counts as different. Real numbers are equal if
    they differ by at most C's FLT_EPSILON.
    """

    value_type: ClassVar[ValueType] = STRING

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return [
            Port("value_A", type=ANY, description="one value", optional=True),
            Port("value_B", type=ANY, description="the other value", optional=True),
            Port(
                "return_on_mismatch",
                type=NODE_STATUS,
                description="the result if the values differ",
                optional=True,
            ),
        ]

    def tick(self) -> Status:
        """Compare, then tick the child."""
        set_status(self, RUNNING)
        if self._values_match():
            return execute_tick(self.child)
        if self.child._status is RUNNING:
            self.halt_child()
        return cast(Status, input_or(self, "return_on_mismatch", FAILURE))

    def _values_match(self) -> bool:
        try:
            left = self.converted(self.get_input("value_A"))
            right = self.converted(self.get_input("value_B"))
        except (NodeError, BlackboardError, ConversionError):
            return False
        if isinstance(left, float) and isinstance(right, float):
            return abs(left - right) <= FLOAT_EPSILON
        return left == right

    def converted(self, value: object) -> object:
        """Return *value*, which was read from a port, as *value_type*. Raise ConversionError."""
        if isinstance(value, str):
            return self.value_type.from_text(value, 3)
        return self.value_type.cast(value)


@mypyc_attr(allow_interpreted_subclasses=True)
class BlackboardCheckInt(BlackboardCheck):
    """Ticks its child while `value_A` equals `value_B` as integers, else returns `return_on_mismatch`."""

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(3,))
    value_type: ClassVar[ValueType] = INT


@mypyc_attr(allow_interpreted_subclasses=True)
class BlackboardCheckDouble(BlackboardCheck):
    """Ticks its child while `value_A` equals `value_B` as real numbers, else returns `return_on_mismatch`."""

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(3,))
    value_type: ClassVar[ValueType] = DOUBLE


@mypyc_attr(allow_interpreted_subclasses=True)
class BlackboardCheckString(BlackboardCheck):
    """Ticks its child while `value_A` equals `value_B` as texts, else returns `return_on_mismatch`."""

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(3,))
    value_type: ClassVar[ValueType] = STRING


@mypyc_attr(allow_interpreted_subclasses=True)
class BlackboardCheckBool(BlackboardCheck):
    """Ticks its child while `value_A` equals `value_B` as bools, else returns `return_on_mismatch`.

    Every integer in an entry except 0 is true.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(3,))
    value_type: ClassVar[ValueType] = BOOL

    def converted(self, value: object) -> object:
        """Return *value* as a bool. Raise ConversionError."""
        return value != 0 if isinstance(value, int) else super().converted(value)


@mypyc_attr(allow_interpreted_subclasses=True)
class SubTree3(SubTree):
    """Ticks the root of the tree named by `ID`, and returns its result.

    The inner tree has its own blackboard. `inner="outer"` (without braces) makes the key `inner` of the inner
    tree the entry `outer` of the outer tree. With `__shared_blackboard` both trees use the outer tree's
    blackboard.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(3,))

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return no ports: all attributes are remappings."""
        return []


@mypyc_attr(allow_interpreted_subclasses=True)
class SubTreePlus(SubTree3):
    """Ticks the root of the tree named by `ID`, with remapping as in format 4, and returns its result.

    `inner="{outer}"` makes the key `inner` of the inner tree the entry `outer` of the outer tree; any other
    value is a constant. With `__autoremap` every key that the inner tree uses is the entry of the same name
    in the outer tree.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(3,))
