"""Inner nodes, which have children: control nodes and decorators."""

from collections.abc import Mapping
from typing import ClassVar, Final

from mypy_extensions import mypyc_attr

from btcore.engine.node import (
    DECORATING,
    TreeNode,
    halt_node,
    reset_status,
)
from btcore.engine.node_config import NodeConfig
from btcore.engine.observers import Observers
from btcore.errors import NodeError, NodeExecutionError
from btcore.status import (
    FAILURE,
    IDLE,
    NO_RESULT,
    RUNNING,
    SKIPPED,
    SUCCESS,
    NodeType,
    PossibleResults,
    Status,
)

MIN_CHILDREN_FOR_BATCH_RESET: Final = 6
"""From so many children on, one note of all is made sooner than one for each."""


def results_in_order(
    children: list[PossibleResults], continue_on: Status, yields: bool = False
) -> PossibleResults:
    """What a node may result in that ticks its children in turn.

    Args:
        children: What its children may result in.
        continue_on: The result after which the next child is ticked, as after SKIPPED.
        yields: Whether the node is RUNNING after each child but the last that gives *continue_on* at once.
    """
    stop = FAILURE if continue_on is SUCCESS else SUCCESS
    in_first_tick: set[Status] = set()
    after_running: set[Status] = set()
    # Whether the child at hand may be reached in the first tick, and in a later one.
    at_once, later, all_skipped, may_run = True, False, True, False
    for index, child in enumerate(children):
        if not at_once and not later:
            break
        if stop in child.in_first_tick:
            if at_once:
                in_first_tick.add(stop)
            if later:
                after_running.add(stop)
        if stop in child.after_running:
            after_running.add(stop)
        pauses = yields and index + 1 < len(children) and continue_on in child.in_first_tick
        may_run = may_run or child.may_run or pauses
        passes = SKIPPED in child.in_first_tick or (continue_on in child.in_first_tick and not pauses)
        passes_late = continue_on in child.after_running or SKIPPED in child.after_running or pauses
        later = (later and (passes or passes_late)) or (at_once and passes_late)
        at_once = at_once and passes
        all_skipped = all_skipped and SKIPPED in child.results
    end = {continue_on, SKIPPED} if all_skipped else {continue_on}
    return PossibleResults(
        frozenset(in_first_tick | end if at_once else in_first_tick),
        frozenset(after_running | end if later else after_running),
        may_run,
    )


def results_of_any(cls: type[TreeNode], children: list[PossibleResults]) -> PossibleResults:
    """What a node of *cls* may result in, if nothing but its declared results is known."""
    may_run = any(child.may_run for child in children)
    ends = cls.may_return
    if not cls.skips_alone and not any(SKIPPED in child.results for child in children):
        ends -= {SKIPPED}
    return PossibleResults(ends, ends if may_run else NO_RESULT, may_run)


@mypyc_attr(allow_interpreted_subclasses=True)
class ControlNode(TreeNode):
    """A node that decides which of its children is ticked, and when."""

    node_type: ClassVar[NodeType] = NodeType.CONTROL
    child_count: ClassVar[tuple[int, int | None]] = (1, None)
    child_count_at_load: ClassVar[tuple[int, int | None]] = (1, None)
    continue_on: ClassVar[Status | None] = None
    """The result of a child after which the next one is ticked, as after SKIPPED; None = no such order."""
    runs_one_child: ClassVar[bool] = False
    """Whether a child that is RUNNING halts all others, and the next tick begins at the first again."""
    branch_results: ClassVar[tuple[Status, ...]] = ()
    """The results of the first child that lead to the second one, the third one, and so on."""
    handler_port: ClassVar[str | None] = None
    """If not None, the last child is ticked only after another failed, or as the port of this name says."""

    _children: list[TreeNode]

    # Those of the children, once somebody observed a reset.
    _configs: list[NodeConfig]

    def set_children(self, children: list[TreeNode]) -> None:
        """Take *children*. Called by the builder, once."""
        self._children = children
        self._configs = []

    @property
    def children(self) -> list[TreeNode]:
        """The children, in order."""
        return self._children

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """What follows from the order of the children, if there is one."""
        if cls.continue_on is None or cls.handler_port is not None:
            return results_of_any(cls, children)
        return results_in_order(children, cls.continue_on)

    def halt_child(self, index: int) -> None:
        """Halt child *index* if it runs, and reset it."""
        child = self._children[index]
        if child._status is RUNNING:
            halt_node(child)
        reset_status(child)

    def reset_children(self) -> None:
        """Halt the children that run, and reset all. If one raises, the others are halted first."""
        observers = self._context.observers
        if observers is not None and self._reset_done(observers):
            return
        first: NodeExecutionError | None = None
        moment: object = None
        for child in self._children:
            status = child._status
            if status is RUNNING:
                try:
                    halt_node(child)
                except NodeExecutionError as error:
                    if first is None:
                        first = error
                    else:
                        first.later_errors.append(error)
                status = child._status
                moment = None
            if status is not IDLE:
                child._status = IDLE
                if observers is not None:
                    if moment is None:
                        # All that are reset at once are so at the same moment.
                        moment = observers.now()
                    observers.record_transition(moment, child.config, status, IDLE)
        if first is not None:
            raise first

    def _reset_done(self, observers: Observers) -> bool:
        """Reset many children, up to one that runs, with one note of all. Returns whether that is all."""
        children = self._children
        if len(children) < MIN_CHILDREN_FOR_BATCH_RESET or observers.immediate_listeners:
            return False
        before = [IDLE] * len(children)
        count = 0
        none_runs = True
        for index, child in enumerate(children):
            status = child._status
            if status is RUNNING:
                none_runs = False
                break
            if status is not IDLE:
                before[index] = status
                child._status = IDLE
                count += 1
        if count:
            if len(self._configs) != len(children):
                self._configs = [child.config for child in children]
            observers.record_reset(self._configs, before, count)
        return none_runs

    def halt(self) -> None:
        """Halt the children, and be IDLE afterwards."""
        self.reset_children()
        self.reset_status()

    def idle_child(self, index: int) -> NodeError:
        """The fault of a child that returned IDLE."""
        return NodeError(f"child {index + 1} returned IDLE")


@mypyc_attr(allow_interpreted_subclasses=True)
class DecoratorNode(TreeNode):
    """A node with one child, whose result or whose ticks it changes."""

    node_type: ClassVar[NodeType] = NodeType.DECORATOR
    _family: ClassVar[int] = DECORATING
    child_count: ClassVar[tuple[int, int | None]] = (1, 1)
    child_count_at_load: ClassVar[tuple[int, int | None]] = (1, 1)
    child: TreeNode

    def set_children(self, children: list[TreeNode]) -> None:
        """Take the one child. Called by the builder, once."""
        self.child = children[0]

    @property
    def children(self) -> list[TreeNode]:
        """The child, as a list."""
        return [self.child]

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """The declared results, whatever the child does."""
        return results_of_any(cls, children)

    def halt_child(self) -> None:
        """Halt the child if it runs, and reset it."""
        child = self.child
        if child._status is RUNNING:
            try:
                halt_node(child)
            finally:
                reset_status(child)
        else:
            reset_status(child)

    def reset_child(self) -> None:
        """The same as :meth:`halt_child`, by BehaviorTree.CPP's other name."""
        self.halt_child()

    def halt(self) -> None:
        """Halt the child, and be IDLE afterwards."""
        self.halt_child()
        self.reset_status()
