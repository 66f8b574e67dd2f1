"""Branches: the first child decides which of the others is ticked."""

from mypy_extensions import mypyc_attr

from btcore.engine.control import ControlNode
from btcore.engine.node import execute_tick
from btcore.errors import NodeError
from btcore.status import (
    FAILURE,
    IDLE,
    RUNNING,
    SUCCESS,
    Status,
)


@mypyc_attr(allow_interpreted_subclasses=True)
class BranchNode(ControlNode):
    """A node of two or three children: a condition, then, and else."""

    def check_children(self) -> int:
        """The number of children. Raises NodeError unless it is 2 or 3."""
        count = len(self._children)
        if count != 2 and count != 3:
            raise NodeError(f"<{self.id}> takes a condition and one or two branches, not {count} children")
        return count


@mypyc_attr(allow_interpreted_subclasses=True)
class IfThenElse(BranchNode):
    """Ticks the condition once, then the second child if it succeeded, the third if it failed.

    While the branch runs the condition isn't ticked again. Without a third child a failed
    condition gives FAILURE, and the condition keeps its status. A skipped condition is an error.
    """

    _branch: int = 0

    def tick(self) -> Status:
        """Choose a branch if none is chosen, and tick it."""
        count = self.check_children()
        self.set_status(RUNNING)
        if self._branch == 0:
            condition = execute_tick(self._children[0])
            if condition is RUNNING:
                return RUNNING
            if condition is SUCCESS:
                self._branch = 1
            elif condition is FAILURE:
                if count == 2:
                    return FAILURE
                self._branch = 2
            else:
                raise NodeError("the condition was skipped, so that no branch can be chosen")
        status = execute_tick(self._children[self._branch])
        if status is not RUNNING:
            self._branch = 0
            self.reset_children()
        return status

    def halt(self) -> None:
        """Halt the children; the condition decides anew next time."""
        self._branch = 0
        self.reset_children()
        self.reset_status()


@mypyc_attr(allow_interpreted_subclasses=True)
class WhileDoElse(BranchNode):
    """Ticks the condition on every tick, and the second child while it succeeds, the third while it fails.

    When the condition changes its mind the branch that runs is halted. Without a third child a
    failed condition gives FAILURE. A skipped condition is an error.
    """

    def tick(self) -> Status:
        """Tick the condition, and the branch it asks for."""
        count = self.check_children()
        self.set_status(RUNNING)
        condition = execute_tick(self._children[0])
        if condition is RUNNING:
            return RUNNING
        status = IDLE
        if condition is SUCCESS:
            if count == 3:
                self.halt_child(2)
            status = execute_tick(self._children[1])
        elif condition is FAILURE:
            if count == 3:
                self.halt_child(1)
                status = execute_tick(self._children[2])
            else:
                status = FAILURE
        if status is not RUNNING:
            self.reset_children()
        if status is IDLE:
            raise NodeError("the condition was skipped, so that no branch can be ticked")
        return status
