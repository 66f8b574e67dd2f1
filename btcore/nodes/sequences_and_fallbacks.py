"""Sequences and fallbacks: control nodes that tick their children in order."""

from collections.abc import Mapping
from typing import ClassVar, cast

from mypy_extensions import mypyc_attr

from btcore.engine.control import ControlNode, halt_and_reset, results_in_order
from btcore.engine.node import execute_tick, set_status
from btcore.engine.node_spec import NodeSpec
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, PossibleResults, Status


@mypyc_attr(allow_interpreted_subclasses=True)
class OrderedNode(ControlNode):
    """Ticks its children in order; the next tick continues with the child that is RUNNING.

    After a child that returns *continue_on* or SKIPPED the next child is ticked. A child that returns the
    opposite result ends the node with this result. If all children were skipped, the node is SKIPPED.

    Attributes:
        is_async: Whether the node returns RUNNING and wakes the tree after a child that completed in its
            first tick, except the last, so that a parent can halt the node there.
        has_memory: Whether the next start begins with the child that ended the node, instead of the first.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(
        state_fields=("_current_child_index", "_skipped_count"), never_pauses=True, continue_on=SUCCESS
    )

    is_async: ClassVar[bool] = False
    has_memory: ClassVar[bool] = False

    _current_child_index: int = 0  # of the child with which the next tick continues
    _skipped_count: int = 0  # the number of children that were skipped since the start
    # Copies, see engine/node.py. If ticks read the attributes of the class, those of the benchmark's tree
    # `wide` take 17 % longer, and those of `deep` 13 % (compiled).
    _continue_on: Status = SUCCESS
    _is_async: bool = False
    _has_memory: bool = False

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return the results that follow from the order of the children, for each possible first child."""
        is_async, continue_on = cls.is_async, cast(Status, cls.spec.continue_on)
        whole = results_in_order(children, continue_on, is_async)
        first = whole.in_first_tick
        if cls.has_memory:
            # The node may start at any child. A start at the last child needs the fewest results to pass.
            stop = FAILURE if continue_on is SUCCESS else SUCCESS
            if any(stop in child.in_first_tick for child in children):
                first |= {stop}
            first |= results_in_order(children[-1:], continue_on, is_async).in_first_tick
        return PossibleResults(first, whole.after_running, whole.may_run)

    def prepare(self) -> None:
        """Copy what ticks need."""
        self._continue_on = cast(Status, self.spec.continue_on)
        self._is_async = self.is_async
        self._has_memory = self.has_memory

    def tick(self) -> Status:
        """Tick the children, starting with the current child."""
        children = self._children
        count = len(children)
        previous = self._status
        if previous is not RUNNING:
            # As in BehaviorTree.CPP, a completed node that was not reset keeps its count.
            if previous is IDLE or previous is SKIPPED:
                self._skipped_count = 0
            set_status(self, RUNNING)
        continue_on = self._continue_on
        index = self._current_child_index
        while index < count:
            child = children[index]
            was_idle = child._status is IDLE
            status = execute_tick(child)
            if status is RUNNING:
                return RUNNING
            if status is continue_on:
                self._current_child_index = index = index + 1
                # Pause, so that parents can halt the node here. While a child is RUNNING for several ticks,
                # they can halt it anyway: after such a child there is no pause.
                if self._is_async and was_idle and index < count:
                    self.wake_up()
                    return RUNNING
            elif status is SKIPPED:
                self._current_child_index = index = index + 1
                self._skipped_count += 1
            elif status is IDLE:
                raise self.idle_child_error(index)
            elif self._has_memory:
                # The children before keep their statuses, and the next start begins with this child.
                for later in range(index, count):
                    self.halt_child(later)
                return status
            else:
                self._current_child_index = 0
                self.reset_children()
                return status
        all_skipped = self._skipped_count == count and count > 0
        self._current_child_index = 0
        self._skipped_count = 0
        self.reset_children()
        return SKIPPED if all_skipped else continue_on

    def halt(self) -> None:
        """Halt the children. The next start begins with the first child."""
        self._current_child_index = 0
        self._skipped_count = 0
        super().halt()


@mypyc_attr(allow_interpreted_subclasses=True)
class ReactiveNode(ControlNode):
    """Ticks its children in order, starting with the first in every tick; at most one child is RUNNING."""

    spec: ClassVar[NodeSpec] = NodeSpec(continue_on=SUCCESS)
    _continue_on: Status = SUCCESS  # a copy

    def prepare(self) -> None:
        """Copy what ticks need."""
        self._continue_on = cast(Status, self.spec.continue_on)

    def tick(self) -> Status:
        """Tick the children, starting with the first child."""
        continue_on = self._continue_on
        children = self._children
        all_skipped = len(children) > 0
        if self._status is not RUNNING:
            set_status(self, RUNNING)
        for index, child in enumerate(children):
            status = execute_tick(child)
            if status is RUNNING:
                # Also the children after this child, which may be RUNNING since an earlier tick.
                for other in children:
                    if other is not child and other._status is not IDLE:
                        halt_and_reset(other)
                return RUNNING
            if status is continue_on:
                all_skipped = False
            elif status is SKIPPED:
                # SKIPPED is not stored. Reset the child, so that its pre-conditions are checked again.
                self.halt_child(index)
            elif status is IDLE:
                raise self.idle_child_error(index)
            else:
                self.reset_children()
                return status
        self.reset_children()
        return SKIPPED if all_skipped else continue_on


@mypyc_attr(allow_interpreted_subclasses=True)
class Sequence(OrderedNode):
    """Ticks its children in order while they succeed.

    If a child is RUNNING, the node is RUNNING, and the next tick continues with this child. If a child
    fails, the children are reset and the node fails. After a child that succeeds or is SKIPPED, the next
    child is ticked. After the last child the node succeeds, or is SKIPPED if all children were skipped.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(symbol="→", formats=(3, 4))


@mypyc_attr(allow_interpreted_subclasses=True)
class AsyncSequence(Sequence):
    """A Sequence that returns RUNNING between its children, so that it can be halted there.

    After a child, except the last, that succeeded in its first tick, the node returns RUNNING and wakes
    the tree; the next tick continues with the next child. Everything else is as in Sequence.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(4,))
    is_async: ClassVar[bool] = True


@mypyc_attr(allow_interpreted_subclasses=True)
class SequenceWithMemory(Sequence):
    """A Sequence that starts again at the child that failed.

    When a child fails, only this child and the following children are reset, and the next start begins
    with this child, even after a halt. Like AsyncSequence, the node returns RUNNING after a child, except
    the last, that succeeded in its first tick.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(4,))
    is_async: ClassVar[bool] = True
    has_memory: ClassVar[bool] = True

    def halt(self) -> None:
        """Halt the children. The next start begins with the current child."""
        self.reset_children()
        self.reset_status()


@mypyc_attr(allow_interpreted_subclasses=True)
class ReactiveSequence(ReactiveNode):
    """Ticks its children in order, starting with the first child in every tick, while they succeed.

    If a child is RUNNING, all other children are halted and the node is RUNNING. If a child fails, all
    children are reset and the node fails. After a child that succeeds or is SKIPPED, the next child is
    ticked. After the last child the node succeeds, or is SKIPPED if all children were skipped.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(symbol="↻→", formats=(3, 4))


@mypyc_attr(allow_interpreted_subclasses=True)
class Fallback(OrderedNode):
    """Ticks its children in order until a child succeeds.

    If a child is RUNNING, the node is RUNNING, and the next tick continues with this child. If a child
    succeeds, the children are reset and the node succeeds. After a child that fails or is SKIPPED, the
    next child is ticked. After the last child the node fails, or is SKIPPED if all children were skipped.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(symbol="?", continue_on=FAILURE, formats=(3, 4))


@mypyc_attr(allow_interpreted_subclasses=True)
class AsyncFallback(Fallback):
    """A Fallback that returns RUNNING between its children, so that it can be halted there.

    After a child, except the last, that failed in its first tick, the node returns RUNNING and wakes the
    tree; the next tick continues with the next child. Everything else is as in Fallback.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(4,))
    is_async: ClassVar[bool] = True


@mypyc_attr(allow_interpreted_subclasses=True)
class ReactiveFallback(ReactiveNode):
    """Ticks its children in order, starting with the first in every tick, until one succeeds or is RUNNING.

    If a child is RUNNING, all other children are halted and the node is RUNNING. If a child succeeds, all
    children are reset and the node succeeds. After a child that fails or is SKIPPED, the next child is
    ticked. After the last child the node fails, or is SKIPPED if all children were skipped.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(symbol="↻?", continue_on=FAILURE, formats=(3, 4))
