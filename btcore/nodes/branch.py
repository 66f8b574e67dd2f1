"""Branches: the result of the first child decides which of the other children is ticked."""

from collections.abc import Mapping
from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.engine.control import ControlNode, results_of_any
from btcore.engine.node import execute_tick, set_status
from btcore.engine.node_spec import NodeSpec
from btcore.errors import NodeError
from btcore.status import FAILURE, IDLE, RUNNING, SUCCESS, PossibleResults, Status


@mypyc_attr(allow_interpreted_subclasses=True)
class BranchNode(ControlNode):
    """The base class of nodes with a condition, a branch for SUCCESS, and an optional branch for FAILURE."""

    spec: ClassVar[NodeSpec] = NodeSpec(
        symbol="⎇",
        child_count=(2, 3),
        child_roles="a condition, and one or two branches",
        branch_results=(SUCCESS, FAILURE),
    )

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return the results of the branches that the condition can select."""
        if not 2 <= len(children) <= 3:
            return results_of_any(cls, children)
        condition = children[0]
        missing = PossibleResults(frozenset({FAILURE}))
        first: set[Status] = set()
        late: set[Status] = set()
        may_run = condition.may_run
        for index, chosen in enumerate(cls.spec.branch_results):
            if chosen not in condition.results:
                continue
            branch = children[index + 1] if index + 1 < len(children) else missing
            may_run = may_run or branch.may_run
            late |= branch.after_running
            if chosen in condition.in_first_tick:
                first |= branch.in_first_tick
            if chosen in condition.after_running:
                late |= branch.in_first_tick
        if len(children) == 2 and FAILURE in condition.results:
            # The condition is not reset and keeps its FAILURE: the next start returns it in its first tick.
            first.add(FAILURE)
        return PossibleResults(frozenset(first), frozenset(late), may_run)

    def check_children(self) -> int:
        """Return the number of children. Raise NodeError unless it is 2 or 3."""
        count = len(self._children)
        if count != 2 and count != 3:
            raise NodeError(
                f"<{self.config.id}> takes a condition and one or two branches, not {count} children"
            )
        return count


@mypyc_attr(allow_interpreted_subclasses=True)
class IfThenElse(BranchNode):
    """Ticks the first child, a condition; then the second child if it succeeded, or the third if it failed.

    The node returns the result of the selected child. While that child is RUNNING, the condition is
    not ticked again. Without a third child, a failed condition makes the node fail, and the status of the
    condition stays FAILURE. A skipped condition is an error.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(state_fields=("_branch",), never_pauses=True, formats=(3, 4))

    _branch: int = 0  # the index of the selected child; 0 = none

    def tick(self) -> Status:
        """Select a branch unless a branch is selected already, and tick it."""
        count = self.check_children()
        set_status(self, RUNNING)
        if self._branch == 0:
            condition = execute_tick(self._children[0])
            if condition is RUNNING:
                return RUNNING
            if condition is SUCCESS:
                self._branch = 1
            elif condition is FAILURE:
                if count == 2:
                    # Without a reset of the condition, unlike all other results, as in BehaviorTree.CPP.
                    return FAILURE
                self._branch = 2
            else:
                raise NodeError("the condition was skipped, so that no branch can be chosen")
        # The selected branch is kept while it is RUNNING, so that the condition is not ticked again.
        status = execute_tick(self._children[self._branch])
        if status is not RUNNING:
            self._branch = 0
            self.reset_children()
        return status

    def halt(self) -> None:
        """Halt the children, and forget the selected branch."""
        self._branch = 0
        super().halt()


@mypyc_attr(allow_interpreted_subclasses=True)
class WhileDoElse(BranchNode):
    """Ticks the first child, a condition, in every tick, and the second or third child by its result.

    While the condition succeeds, the second child is ticked; while it fails, the third. The node returns
    the result of the selected child. When the result of the condition changes, the child that was RUNNING
    is halted. Without a third child, a failed condition makes the node fail. A skipped condition is an
    error.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(4,))

    def tick(self) -> Status:
        """Tick the condition and the branch that it selects."""
        count = self.check_children()
        set_status(self, RUNNING)
        condition = execute_tick(self._children[0])
        if condition is RUNNING:
            return RUNNING
        status = IDLE
        # The other branch is halted before the selected branch is ticked, so that they never run together.
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
