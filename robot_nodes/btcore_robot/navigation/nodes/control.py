"""Nav2's control nodes: pipelines, recoveries, and sequences of other kinds."""

from typing import Annotated

from btcore import ControlNode, In, InOut, NodeError, Status

RUNNING, SUCCESS, FAILURE, SKIPPED = Status.RUNNING, Status.SUCCESS, Status.FAILURE, Status.SKIPPED


class PipelineSequence(ControlNode):
    """Ticks all children that were reached so far, from the first, again and again.

    So what comes first (planning) goes on while what comes later (driving) lasts. FAILURE of any child:
    FAILURE. A child that is RUNNING ends the tick only if none after it was reached before. SUCCESS when the
    last one succeeds.
    """

    def __init__(self) -> None:
        self.reached = 0

    def tick(self) -> Status:
        """Tick from the first child."""
        skipped = 0
        for index, child in enumerate(self.children):
            status = child.execute_tick()
            if status is FAILURE:
                self.restart()
                return FAILURE
            if status is SKIPPED:
                skipped += 1
            elif status is RUNNING and index >= self.reached:
                self.reached = index
                return RUNNING
        self.restart()
        return SKIPPED if skipped == len(self.children) else SUCCESS

    def restart(self) -> None:
        """Halt all, and begin again next time."""
        self.reset_children()
        self.reached = 0

    def halt(self) -> None:
        """Halt all, and forget how far it came."""
        self.reached = 0
        super().halt()


class RecoveryNode(ControlNode):
    """Ticks its first child; when that fails, the second to put things right, and then the first again.

    SUCCESS when the first child succeeds; FAILURE when the second one fails, or after *number_of_retries*.
    """

    number_of_retries: Annotated[In[int], "How many times the first child is tried again."] = 1

    def __init__(self) -> None:
        self.retries = 0
        self.at = 0

    def prepare(self) -> None:
        """Raises NodeError unless there are two children."""
        if len(self.children) != 2:
            raise NodeError(
                f"<RecoveryNode> has two children, what to do and how to recover, not {len(self.children)}"
            )

    def tick(self) -> Status:
        """Tick the child whose turn it is."""
        self.set_status(RUNNING)
        main, recovery = self.children
        while True:
            status = (main if self.at == 0 else recovery).execute_tick()
            if status is RUNNING:
                return RUNNING
            if self.at == 0:
                if status is not FAILURE or self.retries >= self.number_of_retries:
                    return self.ended(status)
                self.halt_child(0)
                self.at = 1
                continue
            if status is FAILURE:
                return self.ended(FAILURE)
            self.halt_child(1)
            if status is SKIPPED:
                self.at = 0
                return FAILURE
            self.retries += 1
            self.at = 0

    def ended(self, status: Status) -> Status:
        """Halt both, and begin again next time."""
        self.reset_children()
        self.retries = self.at = 0
        return status

    def halt(self) -> None:
        """Halt both, and forget the tries."""
        self.retries = self.at = 0
        super().halt()


class RoundRobin(ControlNode):
    """Gives its children turns: a child that succeeds passes the turn to the next one, for the next tick.

    A child that fails passes the turn on within the tick; when all have failed it is FAILURE. Without
    *wrap_around* the result of the last child ends the round as FAILURE, as in Nav2's present sources.
    """

    wrap_around: Annotated[In[bool], "Whether the first child follows the last."] = False

    def __init__(self) -> None:
        self.turn = 0
        self.failed = 0

    def tick(self) -> Status:
        """Tick the child whose turn it is."""
        self.set_status(RUNNING)
        count = len(self.children)
        wrap = self.wrap_around
        skipped = 0
        while self.failed + skipped < count:
            status = self.children[self.turn].execute_tick()
            if status is RUNNING:
                return RUNNING
            skipped += status is SKIPPED
            self.failed += status is FAILURE
            self.turn += 1
            if self.turn == count:
                if not wrap:
                    break
                self.turn = 0
            if status is SUCCESS:
                self.failed = 0
                self.reset_children()
                return SUCCESS
        self.restart()
        return SKIPPED if skipped == count else FAILURE

    def restart(self) -> None:
        """Halt all; the first child is next."""
        self.reset_children()
        self.turn = self.failed = 0

    def halt(self) -> None:
        """Halt all; the first child is next."""
        self.turn = self.failed = 0
        super().halt()


class NonblockingSequence(ControlNode):
    """Ticks all its children on every tick: SUCCESS when all succeed in one tick, FAILURE when one fails."""

    def tick(self) -> Status:
        """Tick all."""
        result = SUCCESS
        skipped = 0
        for child in self.children:
            status = child.execute_tick()
            if status is FAILURE:
                self.reset_children()
                return FAILURE
            if status is RUNNING:
                result = RUNNING
            elif status is SKIPPED:
                skipped += 1
        if result is SUCCESS:
            self.reset_children()
            return SKIPPED if skipped == len(self.children) else SUCCESS
        return result


class PersistentSequence(ControlNode):
    """A Sequence whose place is an entry of the blackboard, so that it goes on there after a halt."""

    current_child_idx: Annotated[InOut[int], "The child whose turn it is."]

    def tick(self) -> Status:
        """Tick on from the child whose turn it is."""
        self.set_status(RUNNING)
        while self.current_child_idx < len(self.children):
            status = self.children[self.current_child_idx].execute_tick()
            if status is RUNNING:
                return RUNNING
            if status is FAILURE:
                self.reset_children()
                self.current_child_idx = 0
                return FAILURE
            self.current_child_idx = self.current_child_idx + 1
        self.reset_children()
        self.current_child_idx = 0
        return SUCCESS
