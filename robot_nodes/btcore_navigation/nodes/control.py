"""Nav2's control nodes: pipelines, recoveries and variants of the sequence."""

from typing import Annotated

from btcore import FAILURE, RUNNING, SKIPPED, SUCCESS, ControlNode, In, InOut, NodeError, NodeSpec, Status


class PipelineSequence(ControlNode):
    """Ticks every child reached so far, from the first child, on every tick.

    Early children (planning) therefore keep running while a later child (driving) lasts. The sequence
    returns FAILURE when a child fails. A RUNNING child ends the tick only if no later child has been
    reached before. The sequence returns SUCCESS when the last child succeeds, and SKIPPED when all
    children are skipped.
    """

    spec = NodeSpec(state_fields=("reached",))

    def __init__(self) -> None:
        self.reached = 0

    def tick(self) -> Status:
        """Tick the children from the first."""
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
        """Halt all children and start from the first child next time."""
        self.reset_children()
        self.reached = 0

    def halt(self) -> None:
        """Halt all children and forget which children were reached."""
        self.reached = 0
        super().halt()


class RecoveryNode(ControlNode):
    """Ticks the first child; when it fails, ticks the second child to recover, then the first again.

    Returns SUCCESS when the first child succeeds, and FAILURE when the second child fails or is skipped,
    or when the first child fails after *number_of_retries* retries.
    """

    number_of_retries: Annotated[In[int], "Number of retries of the first child."] = 1

    spec = NodeSpec(state_fields=("current", "retries"))

    def __init__(self) -> None:
        self.retries = 0
        self.current = 0

    def prepare(self) -> None:
        """Raise NodeError unless the node has two children."""
        if len(self.children) != 2:
            raise NodeError(
                f"<RecoveryNode> needs two children (main and recovery), not {len(self.children)}"
            )

    def tick(self) -> Status:
        """Tick the current child."""
        self.set_status(RUNNING)
        main, recovery = self.children
        while True:
            status = (main if self.current == 0 else recovery).execute_tick()
            if status is RUNNING:
                return RUNNING
            if self.current == 0:
                if status is not FAILURE or self.retries >= self.number_of_retries:
                    return self.finish(status)
                self.halt_child(0)
                self.current = 1
                continue
            if status is FAILURE:
                return self.finish(FAILURE)
            self.halt_child(1)
            if status is SKIPPED:
                # Nav2 returns FAILURE here but keeps the count of retries and tries the first child next.
                self.current = 0
                return FAILURE
            self.retries += 1
            self.current = 0

    def finish(self, status: Status) -> Status:
        """Halt both children and start again at the next tick."""
        self.reset_children()
        self.retries = self.current = 0
        return status

    def halt(self) -> None:
        """Halt both children and reset the count of retries."""
        self.retries = self.current = 0
        super().halt()


class RoundRobin(ControlNode):
    """Ticks one child at a time, in turn: after a child succeeds, the next tick starts at the next child.

    When a child fails, the next child is ticked within the same tick; the node returns FAILURE when all
    children have failed. Without *wrap_around* the node returns FAILURE once the last child has ended,
    whatever its result, as Nav2's sources do.
    """

    wrap_around: Annotated[In[bool], "Whether to continue with the first child after the last."] = False

    spec = NodeSpec(state_fields=("failed", "turn"))

    def __init__(self) -> None:
        self.turn = 0
        self.failed = 0

    def tick(self) -> Status:
        """Tick the current child and, if it fails or is skipped, the children after it."""
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
        """Halt all children and start from the first child next time."""
        self.reset_children()
        self.turn = self.failed = 0

    def halt(self) -> None:
        """Halt all children and start from the first child next time."""
        self.turn = self.failed = 0
        super().halt()


class NonblockingSequence(ControlNode):
    """Ticks all children on every tick: SUCCESS when all succeed in one tick, FAILURE when one fails."""

    def tick(self) -> Status:
        """Tick all children."""
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
    """A Sequence that keeps the index of its current child on the blackboard and so resumes after a halt."""

    spec = NodeSpec(results=frozenset({SUCCESS, FAILURE}))

    current_child_idx: Annotated[InOut[int], "The index of the current child."]

    def tick(self) -> Status:
        """Tick the children from the current index."""
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
