"""Leaves that follow the plan in their port `plan`, and record their calls.

They are the leaves of random trees, and can replace other leaves in a test. The letters of a plan are R
(RUNNING), S (SUCCESS), F (FAILURE) and K (SKIPPED); X raises an exception.
"""

from btcore.engine.leaf import Condition, StatefulAction, SyncAction
from btcore.engine.node_spec import NodeSpec
from btcore.engine.signature import In
from btcore.status import FAILURE, RUNNING, SKIPPED, SUCCESS, Status

LETTERS = {"R": RUNNING, "S": SUCCESS, "F": FAILURE, "K": SKIPPED}


class CallLog:
    """A log of the calls of planned leaves, in order. An entry is `NAME:CALL`, for example `n3:start`.

    Attributes:
        calls: The entries so far.
    """

    def __init__(self) -> None:
        self.calls: list[str] = []

    def record(self, name: str, call: str) -> None:
        """Record a call of a leaf.

        Args:
            name: The instance name of the leaf.
            call: The kind of call; the leaves of this module record `start`, `running`, `halted` and
                `tick`.
        """
        self.calls.append(f"{name}:{call}")

    def take(self) -> list[str]:
        """Return the calls since the last call of this method."""
        taken, self.calls = self.calls, []
        return taken


class LeafPlanError(Exception):
    """Raised by a planned leaf if the plan contains X or an invalid letter."""


def status_of(letter: str) -> Status:
    """Return the status for a letter of a plan.

    Raises:
        LeafPlanError: The letter is X, or invalid.
    """
    status = LETTERS.get(letter)
    if status is None:
        raise LeafPlanError(f"the plan contains {letter!r}")
    return status


def _status_at(plan: str, index: int) -> Status:
    return status_of(plan[index % len(plan)] if plan else "")


class PlanAction(StatefulAction):
    """An action that follows the segments of `plan`, which are separated by `|`.

    Each start takes the next segment; after the last segment, the first follows again. Each call returns the
    result of the segment's next letter; the last letter is repeated. The calls `start`, `running` and
    `halted` are recorded.

    Attributes:
        plan: The segments.
        journal: The log of the calls.
        starts: The number of starts.
        segment: The results of the current start.
        calls: The number of ticks since the start.

    Examples:
        >>> import btcore
        >>> from btcore.testing import CallLog, PlanAction
        >>> calls = CallLog()
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(PlanAction)
        >>> b = btcore.Builder(nodes)
        >>> tree = b.build(b.PlanAction(plan="RRS", name="drive"), resources=[calls])
        >>> [tree.tick_once().name for _ in range(3)], calls.take()
        (['RUNNING', 'RUNNING', 'SUCCESS'], ['drive:start', 'drive:running', 'drive:running'])
    """

    spec = NodeSpec(state_fields=("starts", "segment", "calls"))

    plan: In[str]

    def __init__(self, journal: CallLog) -> None:
        self.journal = journal
        self.starts = 0
        self.segment = ""
        self.calls = 0

    def on_start(self) -> Status:
        """Take the next segment, and return the result of its first letter."""
        segments = self.plan.split("|")
        self.segment = segments[self.starts % len(segments)]
        self.starts += 1
        self.calls = 0
        self.journal.record(self.name, "start")
        return self._next_status()

    def on_running(self) -> Status:
        """Return the result of the next letter."""
        self.journal.record(self.name, "running")
        return self._next_status()

    def on_halted(self) -> None:
        """Record the call."""
        self.journal.record(self.name, "halted")

    def _next_status(self) -> Status:
        index = min(self.calls, len(self.segment) - 1)
        self.calls += 1
        return _status_at(self.segment, index)


class PlanCondition(Condition):
    """A condition that returns the results of `plan` in turn, and repeats them. `tick` is recorded.

    Attributes:
        plan: The letters of the results.
        journal: The log of the calls.
        ticks: The number of ticks.

    Examples:
        >>> import btcore
        >>> from btcore.testing import CallLog, PlanCondition
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(PlanCondition)
        >>> b = btcore.Builder(nodes)
        >>> tree = b.build(b.PlanCondition(plan="SF"), resources=[CallLog()])
        >>> [tree.tick_once().name for _ in range(3)]
        ['SUCCESS', 'FAILURE', 'SUCCESS']
    """

    spec = NodeSpec(state_fields=("ticks",))

    plan: In[str]

    def __init__(self, journal: CallLog) -> None:
        self.journal = journal
        self.ticks = 0

    def tick(self) -> Status:
        """Return the result of the next letter."""
        self.journal.record(self.name, "tick")
        self.ticks += 1
        return _status_at(self.plan, self.ticks - 1)


class PlanSync(SyncAction):
    """An action that returns the results of `plan` in turn, and repeats them. `tick` is recorded.

    Attributes:
        plan: The letters of the results.
        journal: The log of the calls.
        ticks: The number of ticks.

    Examples:
        >>> import btcore
        >>> from btcore.testing import CallLog, PlanSync
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(PlanSync)
        >>> b = btcore.Builder(nodes)
        >>> tree = b.build(b.PlanSync(plan="SF"), resources=[CallLog()])
        >>> [tree.tick_once().name for _ in range(3)]
        ['SUCCESS', 'FAILURE', 'SUCCESS']
    """

    spec = NodeSpec(state_fields=("ticks",))

    plan: In[str]

    def __init__(self, journal: CallLog) -> None:
        self.journal = journal
        self.ticks = 0

    def tick(self) -> Status:
        """Return the result of the next letter."""
        self.journal.record(self.name, "tick")
        self.ticks += 1
        return _status_at(self.plan, self.ticks - 1)
