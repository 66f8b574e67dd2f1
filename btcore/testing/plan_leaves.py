"""Leaves that do what their port ``plan`` says, and write down that they were called.

They are the leaves of the recorded conformance cases, and serve any test of a tree whose own
leaves aren't there. The letters: R running, S success, F failure, K skipped; X raises.
"""

from typing import ClassVar

from btcore.blackboard.ports import Direction, Port
from btcore.engine.leaf import Condition, StatefulAction, SyncAction
from btcore.engine.signature import In
from btcore.errors import BlackboardError, ConversionError, NodeError
from btcore.status import FAILURE, RUNNING, SKIPPED, SUCCESS, Status
from btcore.values import INT

LETTERS = {"R": RUNNING, "S": SUCCESS, "F": FAILURE, "K": SKIPPED}


class CallLog:
    """The calls of planned leaves, in order, as ``name:what``."""

    def __init__(self) -> None:
        self.calls: list[str] = []

    def record(self, name: str, what: str) -> None:
        """Write down one call."""
        self.calls.append(f"{name}:{what}")

    def take(self) -> list[str]:
        """The calls since the last time."""
        taken, self.calls = self.calls, []
        return taken


class LeafPlanError(Exception):
    """A plan asks for an exception, or holds a letter that isn't one."""


def _status(letter: str) -> Status:
    status = LETTERS.get(letter)
    if status is None:
        raise LeafPlanError(f"the plan says {letter!r}")
    return status


class PlanAction(StatefulAction):
    """Each start takes the next segment of `plan` (separated by ``|``, cyclic), each call its next letter.

    The last letter of a segment repeats. Notes ``start``, ``running`` and ``halted``.
    """

    state_fields: ClassVar[tuple[str, ...] | None] = ("starts", "segment", "calls")

    plan: In[str]

    def __init__(self, journal: CallLog) -> None:
        self.journal = journal
        self.starts = 0
        self.segment = ""
        self.calls = 0

    def on_start(self) -> Status:
        """Take a segment, and give its first letter."""
        segments = self.plan.split("|")
        self.segment = segments[self.starts % len(segments)]
        self.starts += 1
        self.calls = 0
        self.journal.record(self.name, "start")
        return self._letter()

    def on_running(self) -> Status:
        """Give the next letter."""
        self.journal.record(self.name, "running")
        return self._letter()

    def on_halted(self) -> None:
        """Note it."""
        self.journal.record(self.name, "halted")

    def _letter(self) -> Status:
        index = min(self.calls, len(self.segment) - 1)
        self.calls += 1
        return _status(self.segment[index] if index >= 0 else "")


class _Ticks:
    """The letters of a plan, one a tick, cyclic."""

    def __init__(self) -> None:
        self.count = 0

    def next(self, plan: str) -> Status:
        letter = plan[self.count % len(plan)] if plan else ""
        self.count += 1
        return _status(letter)


class PlanCondition(Condition):
    """Gives the letters of `plan`, one a tick, cyclic. Notes ``tick``."""

    state_fields: ClassVar[tuple[str, ...] | None] = ("ticks",)

    plan: In[str]

    def __init__(self, journal: CallLog) -> None:
        self.journal = journal
        self.ticks = _Ticks()

    def tick(self) -> Status:
        """Give the next letter."""
        self.journal.record(self.name, "tick")
        return self.ticks.next(self.plan)


class PlanSync(SyncAction):
    """Gives the letters of `plan`, one a tick, cyclic. Notes ``tick``."""

    state_fields: ClassVar[tuple[str, ...] | None] = ("ticks",)

    plan: In[str]

    def __init__(self, journal: CallLog) -> None:
        self.journal = journal
        self.ticks = _Ticks()

    def tick(self) -> Status:
        """Give the next letter."""
        self.journal.record(self.name, "tick")
        return self.ticks.next(self.plan)


class Inc(SyncAction):
    """Writes `in` + 1 to `out`; fails where `in` can't be read. Notes ``tick``."""

    def __init__(self, journal: CallLog) -> None:
        self.journal = journal

    @staticmethod
    def provided_ports() -> list[Port]:
        """The ports."""
        return [Port("in", type=INT), Port("out", Direction.OUT, type=INT)]

    def tick(self) -> Status:
        """Count."""
        self.journal.record(self.name, "tick")
        try:
            value = self.get_input("in")
        except (NodeError, BlackboardError, ConversionError):
            return FAILURE
        port = self.config.outputs.get("out")
        if port is not None and port.key is not None and isinstance(value, int):
            port.write(value + 1)
        return SUCCESS
