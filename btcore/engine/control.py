"""The base classes of nodes with children: control nodes and decorators."""

from collections.abc import Mapping
from typing import ClassVar, Final

from mypy_extensions import mypyc_attr

from btcore.engine.node import RESETS_CHILD, TreeNode, attach_to_tree, halt_node, reset_status
from btcore.engine.node_config import NodeConfig
from btcore.engine.node_spec import NodeSpec
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
"""The number of children from which a common record of their reset is faster than a record for each child."""


def results_in_order(
    children: list[PossibleResults], continue_on: Status, is_async: bool = False
) -> PossibleResults:
    """Return the possible results of a node that ticks its children in order.

    Args:
        continue_on: The result of a child after which the next child is ticked. SKIPPED has the same effect.
        is_async: Whether the node returns RUNNING after a child, but the last, completed in its first tick.
    """
    stop = FAILURE if continue_on is SUCCESS else SUCCESS
    in_first_tick: set[Status] = set()
    after_running: set[Status] = set()
    # at_once, later: whether the current child may be reached in the first tick, or in a later tick.
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
        pauses = is_async and index + 1 < len(children) and continue_on in child.in_first_tick
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
    """Return the possible results of a node, if nothing is known but the results that its class declares.

    Args:
        cls: The class of the node.
    """
    may_run = any(child.may_run for child in children)
    ends = cls.spec.results
    if not cls.spec.skips_alone and not any(SKIPPED in child.results for child in children):
        ends -= {SKIPPED}
    return PossibleResults(ends, ends if may_run else NO_RESULT, may_run)


@mypyc_attr(allow_interpreted_subclasses=True)
class ControlNode(TreeNode):
    """A node with children that decides which of them are ticked, and when.

    Subclasses implement `tick` and, to forget their state when halted, override `halt`.

    Examples:
        >>> import btcore
        >>> class First(btcore.ControlNode):
        ...     def tick(self):
        ...         return self.children[0].execute_tick()
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(First)
        >>> b = btcore.Builder(nodes)
        >>> b.build(b.First(b.AlwaysSuccess(), b.AlwaysFailure())).tick_once()
        <Status.SUCCESS: 2>
    """

    spec: ClassVar[NodeSpec] = NodeSpec(
        node_type=NodeType.CONTROL, child_count=(1, None), child_count_at_load=(1, None)
    )

    _children: list[TreeNode]

    # The configs of the children; filled by the first reset of many children for an observer.
    _configs: list[NodeConfig]

    def set_children(self, children: list[TreeNode]) -> None:
        """Set the children. Called once, when the node is created."""
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
        """Return the results that follow from the order of the children, if they are ticked in order."""
        continue_on = cls.spec.continue_on
        if continue_on is None:
            return results_of_any(cls, children)
        return results_in_order(children, continue_on)

    def halt_child(self, index: int) -> None:
        """Halt the child at *index* if it is RUNNING, and reset it."""
        halt_and_reset(self._children[index])

    def reset_children(self) -> None:
        """Halt the children that are RUNNING, and reset all children.

        Raises:
            NodeExecutionError: A child raised. All other children were halted and reset nevertheless.
        """
        observers = self._context.observers
        # Fast paths, which stop at the first RUNNING child: the loop below resets the rest. Without it,
        # the tick of a sequence of 30 leaves takes 3 % longer (compiled).
        done = _reset_unobserved(self._children) if observers is None else self._batch_reset(observers)
        if done:
            return
        first: NodeExecutionError | None = None
        stamp: object = None
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
                stamp = None
            if status is not IDLE:
                child._status = IDLE
                child._status_before_reset = status
                if observers is not None:
                    if stamp is None:
                        # Children that are reset together get the same time stamp.
                        stamp = observers.now()
                    observers.record_transition(stamp, child.config, status, IDLE)
        if first is not None:
            raise first

    def _batch_reset(self, observers: Observers) -> bool:
        """Reset children up to the first that is RUNNING, with one record; return whether all are reset."""
        children = self._children
        if len(children) < MIN_CHILDREN_FOR_BATCH_RESET or observers.notifies_at_once:
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
                child._status_before_reset = status
                count += 1
        if count:
            if len(self._configs) != len(children):
                self._configs = [child.config for child in children]
            observers.record_reset(self._configs, before, count)
        return none_runs

    def halt(self) -> None:
        """Halt the children, then set the node to IDLE."""
        self.reset_children()
        self.reset_status()

    def idle_child_error(self, index: int) -> NodeError:
        """Return the error for a child that returned IDLE."""
        return NodeError(f"child {index + 1} returned IDLE")


def _reset_unobserved(children: list[TreeNode]) -> bool:
    """Reset the children up to the first that is RUNNING. Return whether all children are reset."""
    for child in children:
        status = child._status
        if status is RUNNING:
            return False
        if status is not IDLE:
            child._status = IDLE
            child._status_before_reset = status
    return True


def halt_and_reset(child: TreeNode) -> None:
    """Halt *child* if it is RUNNING, and reset it."""
    if child._status is RUNNING:
        halt_node(child)
    reset_status(child)


class MissingChild(TreeNode):
    """Stands for the child of a decorator without a child: a tree of format 3 with such a decorator loads.

    BehaviorTree.CPP 3.8 accepts `<Action ID="Repeat"/>`, and crashes when the child is ticked.
    """

    def tick(self) -> object:
        """Raise NodeError."""
        raise NodeError(f"<{self.config.id}> has no child to tick; a decorator has exactly 1")


@mypyc_attr(allow_interpreted_subclasses=True)
class DecoratorNode(TreeNode):
    """A node with exactly one child: it changes the child's result, or decides when the child is ticked.

    Attributes:
        child: The child.

    Examples:
        >>> import btcore
        >>> class Verbose(btcore.DecoratorNode):
        ...     def tick(self):
        ...         status = self.child.execute_tick()
        ...         print(self.child.name, status.name)
        ...         return status
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(Verbose)
        >>> b = btcore.Builder(nodes)
        >>> b.build(b.Verbose(b.AlwaysFailure(name="door"))).tick_once()
        door FAILURE
        <Status.FAILURE: 3>
    """

    spec: ClassVar[NodeSpec] = NodeSpec(
        node_type=NodeType.DECORATOR, child_count=(1, 1), child_count_at_load=(1, 1)
    )
    child: TreeNode

    def set_children(self, children: list[TreeNode]) -> None:
        """Set the child, the only element of *children*. Called once, when the node is created."""
        if children:
            self.child = children[0]
        else:
            self.child = MissingChild()
            attach_to_tree(self.child, self.config, self._context, self._blackboard)

    @property
    def children(self) -> list[TreeNode]:
        """The child, in a list."""
        return [] if type(self.child) is MissingChild else [self.child]

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return the declared results. The child determines only whether SKIPPED and RUNNING are possible."""
        return results_of_any(cls, children)

    def halt_child(self) -> None:
        """Halt the child if it is RUNNING, and reset it."""
        halt_and_reset(self.child)

    def reset_child(self) -> None:
        """Call `halt_child`: BehaviorTree.CPP has both names."""
        self.halt_child()

    def halt(self) -> None:
        """Halt the child, then set the node to IDLE."""
        self.halt_child()
        self.reset_status()


def enable_child_reset(node: DecoratorNode) -> None:
    """Let `execute_tick` reset the child of *node* when the child has completed.

    Call it once, after `set_children` and `__init__`, which a class may override to change the child.
    """
    node._decorated_child = node.child
    node._tick_flags |= RESETS_CHILD
