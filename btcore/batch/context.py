"""What the nodes of one batch share: the agents, the clock, who was woken, and whose tick has failed."""

from typing import Protocol

from btcore.batch.agent_sets import AgentSets
from btcore.batch.timer import Timer
from btcore.clock import Clock
from btcore.errors import NodeExecutionError


class Located(Protocol):
    """A node, as far as an error names it."""

    path: str
    id: str
    where: str
    parent: "Located | None"


class BatchContext:
    """One per batch.

    *raised* are the agents in whose tick a node has raised: they take no further part in it, and are
    halted at its end. *errors* says which node it was, and for whom: an error each for what was raised in
    the same words. *woken* asked for another tick.
    """

    def __init__(self, crowd: AgentSets, clock: Clock) -> None:
        self.agent_sets = crowd
        self.clock = clock
        self.raised = 0
        self.errors: dict[tuple[str, str, type, str], tuple[NodeExecutionError, int]] = {}
        self.woken = 0
        self.timers: list[Timer] = []

    def timer(self) -> Timer:
        """A new timer, whose wishes count when it is asked who was woken."""
        made = Timer(self.agent_sets)
        self.timers.append(made)
        return made

    def fail(self, node: Located, agents: int, fault: BaseException, doing: str = "ticking") -> None:
        """Note that *node* raised *fault* for *agents*; an agent's first fault counts."""
        agents ^= agents & self.raised
        if not agents:
            return
        self.raised |= agents
        same = node.path, doing, type(fault), str(fault)
        known = self.errors.get(same)
        if known is not None:
            self.errors[same] = known[0], known[1] | agents
            return
        error = NodeExecutionError(node.path, node.id, fault, doing, node.where)
        error.__cause__ = fault
        place: Located | None = node
        while place is not None:
            error.backtrace.insert(0, place.path)
            place = place.parent
        self.errors[same] = error, agents

    def take_wake_up(self, agents: int) -> int:
        """Those of *agents* who were woken, by a node or by a moment that has come; it is taken."""
        now = self.clock.now()
        for timer in self.timers:
            if timer.wake_ups:
                self.woken |= timer.take_due_wake_ups(self.agent_sets.all_agents, now)
        woken = self.woken & agents
        self.woken ^= woken
        return woken
