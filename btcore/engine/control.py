"""Inner nodes, which have children: control nodes and decorators."""

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
from btcore.status import IDLE, RUNNING, NodeType

MIN_CHILDREN_FOR_BATCH_RESET: Final = 6
"""From so many children on, one note of all is made sooner than one for each."""


@mypyc_attr(allow_interpreted_subclasses=True)
class ControlNode(TreeNode):
    """A node that decides which of its children is ticked, and when."""

    node_type: ClassVar[NodeType] = NodeType.CONTROL
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
    child: TreeNode

    def set_children(self, children: list[TreeNode]) -> None:
        """Take the one child. Called by the builder, once."""
        self.child = children[0]

    @property
    def children(self) -> list[TreeNode]:
        """The child, as a list."""
        return [self.child]

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
