"""What happens in the ticks of a node besides its `tick`: conditions, callbacks and counters.

The scripts of conditions (`_skipIf`, `_while`, `_onSuccess` and the others) run on the blackboard of the
node's scope. For a SubTree node, this is the scope of the outer tree.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Final

from btcore.blackboard.blackboard import Blackboard
from btcore.script.program import Program, compile_script, condition_result
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Status

if TYPE_CHECKING:
    from btcore.engine.journal import Journal  # imported when a recording begins

UNDECIDED: Final = IDLE
"""Stands for a result that the pre-conditions leave to the node; a node returns IDLE only in format 3."""


class NodeConditions:
    """The compiled pre- and post-conditions of one node."""

    def __init__(self, scripts: Mapping[str, str], enums: Mapping[str, int], blackboard: Blackboard) -> None:
        programs = {key: compile_script(text, enums) for key, text in scripts.items()}
        self.blackboard = blackboard
        self.failure_if: Program | None = programs.get("_failureIf")
        self.success_if: Program | None = programs.get("_successIf")
        self.skip_if: Program | None = programs.get("_skipIf")
        self.while_true: Program | None = programs.get("_while")
        self.on_halted: Program | None = programs.get("_onHalted")
        self.on_failure: Program | None = programs.get("_onFailure")
        self.on_success: Program | None = programs.get("_onSuccess")
        self.post: Program | None = programs.get("_post")

    def check_preconditions(self, status: Status) -> Status:
        """Check the pre-conditions of a node before a tick.

        `_failureIf`, `_successIf` and `_skipIf` are evaluated before a node starts. `_while` is also
        evaluated while the node is RUNNING; if it is false then, the caller must halt the node.

        Args:
            status: The status of the node before the tick.

        Returns:
            The result of the node, which is then not ticked; UNDECIDED = the node must be ticked.
        """
        # A node that stores SKIPPED itself, by set_status(), is not active either, as in BehaviorTree.CPP.
        if status is IDLE or status is SKIPPED:
            if self.failure_if is not None and condition_result(self.failure_if.run(self.blackboard)):
                return FAILURE
            if self.success_if is not None and condition_result(self.success_if.run(self.blackboard)):
                return SUCCESS
            if self.skip_if is not None and condition_result(self.skip_if.run(self.blackboard)):
                return SKIPPED
        elif status is not RUNNING:
            # A node that has completed and was not reset is ticked without pre-conditions.
            return UNDECIDED
        if self.while_true is not None and not condition_result(self.while_true.run(self.blackboard)):
            return SKIPPED
        return UNDECIDED

    def run_postconditions(self, status: Status) -> None:
        """Run `_onSuccess` or `_onFailure`, depending on the result *status*, and then `_post`."""
        if status is SUCCESS:
            if self.on_success is not None:
                self.on_success.run(self.blackboard)
        elif self.on_failure is not None:
            self.on_failure.run(self.blackboard)
        if self.post is not None:
            self.post.run(self.blackboard)

    def run_on_halted(self) -> None:
        """Run `_onHalted`."""
        if self.on_halted is not None:
            self.on_halted.run(self.blackboard)


class WatchedConditions(NodeConditions):
    """The conditions of a node, which may be none, with a report of the start of each tick.

    btcore_proof uses it. It is here because only a compiled class can extend `NodeConditions`.

    Args:
        scripts: The scripts, by the name of the attribute.
        enums: The numbers of enum names in scripts.
        blackboard: The scope of the scripts.
        started: Called at the start of each tick, before the pre-conditions.
    """

    def __init__(
        self,
        scripts: Mapping[str, str],
        enums: Mapping[str, int],
        blackboard: Blackboard,
        started: Callable[[], object],
    ) -> None:
        super().__init__(scripts, enums, blackboard)
        self.started = started

    def check_preconditions(self, status: Status) -> Status:
        """Report the start of a tick, and check the pre-conditions."""
        self.started()
        return super().check_preconditions(status)


class TickCounts:
    """The counters of one node: ticks, results, and halts while it was RUNNING."""

    def __init__(self) -> None:
        self.ticks = 0
        self.success = 0
        self.failure = 0
        self.skipped = 0
        self.halted = 0

    def by_name(self) -> dict[str, int]:
        """Return the counters by their names."""
        return {
            "ticks": self.ticks,
            "success": self.success,
            "failure": self.failure,
            "skipped": self.skipped,
            "halted": self.halted,
        }

    def add_result(self, status: Status) -> None:
        """Count the result *status* of a tick."""
        if status is SUCCESS:
            self.success += 1
        elif status is FAILURE:
            self.failure += 1
        elif status is SKIPPED:
            self.skipped += 1


class TickExtras:
    """The conditions, callbacks, counters and journal of one node.

    Most nodes of a tree in a program have none; under `btcore run` all nodes have counters.

    Attributes:
        boundary_journal: The journal of the tree, if it is recorded and the node or its parent is external,
            that is, not built in.
        is_external: Whether the node is external, so that the journal records its results.
    """

    def __init__(self) -> None:
        self.conditions: NodeConditions | None = None
        self.tick_counts: TickCounts | None = None
        self.pre_tick: Callable[[Any], Status] | None = None
        self.post_tick: Callable[[Any, Status], Status] | None = None
        self.boundary_journal: Journal | None = None
        self.is_external = False

    @property
    def is_empty(self) -> bool:
        """Whether the node has none of them."""
        return (
            self.conditions is None
            and self.tick_counts is None
            and self.pre_tick is None
            and self.post_tick is None
            and self.boundary_journal is None
        )
