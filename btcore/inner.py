"""Inner nodes, which have children: control nodes and decorators."""

from typing import ClassVar, Final

from mypy_extensions import mypyc_attr

from btcore.errors import NodeFault, NodeRaised
from btcore.node import DECORATING, TreeNode, halt_node, reset_status
from btcore.status import IDLE, RUNNING, NodeType, Status

MANY: Final = 6
"""From so many children on, one note of all is made sooner than one for each."""


@mypyc_attr(allow_interpreted_subclasses=True)
class ControlNode(TreeNode):
    """A node that decides which of its children is ticked, and when."""

    node_type: ClassVar[NodeType] = NodeType.CONTROL
    _children: list[TreeNode]

    def adopt(self, children: list[TreeNode]) -> None:
        """Take *children*. Called by the builder, once."""
        self._children = children

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
        if observers is not None and len(self._children) >= MANY and not observers.at_once:
            before = [child._status for child in self._children]
            count = _done(before)
            if count > 0:
                observers.note_reset([child.config for child in self._children], before, count)
                for child in self._children:
                    child._status = IDLE
            if count >= 0:
                return
        first: NodeRaised | None = None
        moment: object = None
        for child in self._children:
            status = child._status
            if status is RUNNING:
                try:
                    halt_node(child)
                except NodeRaised as error:
                    if first is None:
                        first = error
                    else:
                        first.also.append(error)
                status = child._status
                moment = None
            if status is not IDLE:
                child._status = IDLE
                if observers is not None:
                    if moment is None:
                        # All that are reset at once are so at the same moment.
                        moment = observers.now()
                    observers.note(moment, child.config, status, IDLE)
        if first is not None:
            raise first

    def halt(self) -> None:
        """Halt the children, and be IDLE afterwards."""
        self.reset_children()
        self.reset_status()

    def idle_child(self, index: int) -> NodeFault:
        """The fault of a child that returned IDLE."""
        return NodeFault(f"child {index + 1} returned IDLE")


def _done(statuses: list[Status]) -> int:
    """How many of *statuses* are not IDLE; -1 if one is RUNNING."""
    count = 0
    for status in statuses:
        if status is RUNNING:
            return -1
        if status is not IDLE:
            count += 1
    return count


@mypyc_attr(allow_interpreted_subclasses=True)
class DecoratorNode(TreeNode):
    """A node with one child, whose result or whose ticks it changes."""

    node_type: ClassVar[NodeType] = NodeType.DECORATOR
    _family: ClassVar[int] = DECORATING
    child: TreeNode

    def adopt(self, children: list[TreeNode]) -> None:
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
