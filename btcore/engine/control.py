"""The base classes of nodes with children: control nodes and decorators."""

from collections.abc import Mapping
from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.engine.node import TreeNode, attach_to_tree, halt_node, reset_status
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
    """Return the possible results of a node, if nothing is known but the results that its class declares."""
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

    _configs: list[NodeConfig]
    """The configs of the children, for records of their resets."""

    def set_children(self, children: list[TreeNode]) -> None:
        """Set the children. Called once, when the node is created."""
        self._children = children
        self._configs = [child.config for child in children]

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
        # Usually no child is RUNNING, and the first loop resets all. It stops at a RUNNING child. The last
        # loop halts and resets the others; for a child that is reset it has no effect.
        observers = self._context.observers
        if observers is None:
            # With calls of `reset_status`, a tick of the benchmark's tree `deep` executes 15 % more
            # instructions of the engine (compiled).
            for child in self._children:
                status = child._status
                if status is RUNNING:
                    break
                if status is not IDLE:
                    child._status = IDLE
                    child._status_before_reset = status
            else:
                return
        elif _reset_and_record(self._children, self._configs, observers):
            return
        first_error: NodeExecutionError | None = None
        for child in self._children:
            try:
                halt_and_reset(child)
            except NodeExecutionError as error:
                if first_error is None:
                    first_error = error
                else:
                    first_error.later_errors.append(error)
        if first_error is not None:
            raise first_error

    def halt(self) -> None:
        """Halt the children, then set the node to IDLE."""
        self.reset_children()
        self.reset_status()

    def idle_child_error(self, index: int) -> NodeError:
        """Return the error for a child that returned IDLE."""
        return NodeError(f"child {index + 1} returned IDLE")


def _reset_and_record(children: list[TreeNode], configs: list[NodeConfig], observers: Observers) -> bool:
    """Reset the children up to the first that is RUNNING, and record it. Return whether all are reset."""
    before: list[Status] = []
    count = 0
    for child in children:
        status = child._status
        if status is RUNNING:
            break
        before.append(status)
        if status is not IDLE:
            child._status = IDLE
            child._status_before_reset = status
            count += 1
    if count:
        observers.record_resets(configs, before, count)
    return len(before) == len(children)


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
