"""The state that all nodes of a batch share: agents, clock, columns, wake-ups, and the errors of a tick."""

from collections.abc import Sequence
from typing import Protocol

from btcore.blackboard.blackboard import Blackboard
from btcore.clock import Clock
from btcore.engine.node_config import NodeConfig
from btcore.errors import NodeExecutionError
from btcore_batch.agent_sets import AgentSet, Timer
from btcore_batch.columns import ColumnTable


class NodeLike(Protocol):
    """The interface of `BatchNode`, for modules that cannot import node.py because it imports them."""

    config: NodeConfig
    board: Blackboard
    context: "BatchContext"
    parent: "NodeLike | None"


class BatchContext:
    """The shared state of one batch.

    Attributes:
        columns: The columns of the blackboard.
        tick_start: The time (ns) at which the present tick began, by which its timers are judged.
        resources: The objects that leaves can get by type.
        raised: The agents for which a node has raised in this tick. They take no further part in it, and are
            halted at its end.
        errors: The errors of this tick, each with its agents. Errors of one node with the same type and
            message are stored as one error.
        woken: The agents that must be ticked again without delay.
        timers: The timers of all nodes.
    """

    def __init__(self, columns: ColumnTable, clock: Clock, resources: Sequence[object]) -> None:
        self.agent_sets = columns.agent_sets
        self.clock = clock
        self.tick_start = clock.now()
        self.columns = columns
        self.resources = resources
        self.raised = 0
        self.errors: dict[tuple[str, str, type, str], tuple[NodeExecutionError, AgentSet]] = {}
        self.woken = 0
        self.timers: list[Timer] = []

    def add_timer(self) -> Timer:
        """Return a new timer whose wake-ups are included in `take_wake_ups`."""
        timer = Timer(self.agent_sets)
        self.timers.append(timer)
        return timer

    def fail(self, node: NodeLike, agents: AgentSet, cause: BaseException, doing: str = "ticking") -> None:
        """Record that *node* raised *cause* for *agents*; only the first error of an agent is recorded."""
        # Later errors of an agent may be consequences of its first error.
        agents ^= agents & self.raised  # without those of `raised`
        if not agents:
            return
        self.raised |= agents
        config = node.config
        key = config.path, doing, type(cause), str(cause)
        known = self.errors.get(key)
        if known is not None:
            self.errors[key] = known[0], known[1] | agents
            return
        error = NodeExecutionError(config.path, config.id, cause, doing, config.where)
        error.__cause__ = cause
        place: NodeLike | None = node
        while place is not None:
            error.backtrace.insert(0, place.config.path)
            place = place.parent
        self.errors[key] = error, agents

    def take_wake_ups(self, agents: AgentSet) -> AgentSet:
        """Return those of *agents* that a node or a due timer has woken, and remove their wake-ups."""
        now = self.clock.now()
        for timer in self.timers:
            self.woken |= timer.take_due_wake_ups(now)
        woken = self.woken & agents
        self.woken ^= woken
        return woken
