"""Check the recorded transitions of a robot for gaps.

Groot 2's publishers keep the last 1,000 transitions, and the first client that requests them removes them.
The transitions have no numbers. So a batch counts as complete only if it agrees with the statuses that were
requested between two batches: starting from the statuses after the previous batch, its transitions must pass
through exactly those statuses, and no transition may lead to the node's current status.

A gap leaves the statuses of some nodes uncertain, because they may have changed within the gap. These nodes
are not checked in the next batch. If that batch is complete, it makes them certain again: a node without a
transition still has the status that was requested.
"""

import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from btcore_monitor.events import IDLE
from btcore_monitor.wire.groot2 import MAX_RECORDED, RecordedTransition, StatusRecord

Step = tuple[RecordedTransition, int]
"""A transition, and the previous status of its node."""


class CheckedBatch(NamedTuple):
    """A batch of transitions after the check.

    Attributes:
        before: The latest known status of each node before the transitions.
        steps: The transitions. Transitions to a node's known status are left out.
        is_complete: Whether no transitions are missing since the previous batch.
        is_overflow: Whether transitions are missing because the robot's buffer was full.
    """

    before: dict[int, StatusRecord]
    steps: list[Step]
    is_complete: bool
    is_overflow: bool


class _Walk(NamedTuple):
    """The result of applying a batch. *uncertain* are nodes whose record is uncertain after the batch."""

    before: dict[int, StatusRecord]
    steps: list[Step]
    after: dict[int, StatusRecord]
    uncertain: set[int]
    agrees: bool


class RecordingValidator:
    """Applies batches of transitions to *statuses*, and detects gaps.

    Args:
        statuses: The statuses before the recording began. They count as uncertain, because a node may have
            changed before the recording began.
    """

    def __init__(self, statuses: Mapping[int, StatusRecord]) -> None:
        self.statuses = dict(statuses)
        self._uncertain = set(statuses)

    def apply(
        self, observed: Mapping[int, StatusRecord], batch: Sequence[RecordedTransition]
    ) -> CheckedBatch:
        """Apply a batch of transitions.

        Args:
            observed: The statuses that the robot sent after the previous batch and before this batch.
            batch: The recorded transitions, the oldest first.
        """
        is_overflow = len(batch) >= MAX_RECORDED
        walk = self._walk(observed, batch, self._uncertain)
        is_complete = walk.agrees and not is_overflow
        if not is_complete:
            walk = self._walk(observed, batch, set(self.statuses))
        self.statuses, self._uncertain = walk.after, walk.uncertain
        if is_overflow:
            # Transitions before the batch are missing, but none since: other nodes may have another status.
            self._uncertain |= self.statuses.keys() - {transition.uid for transition in batch}
        elif not is_complete:
            # Transitions may be missing anywhere, for example because another client stopped the recording.
            self._uncertain = set(self.statuses)
        return CheckedBatch(walk.before, walk.steps, is_complete, is_overflow)

    def _walk(
        self,
        observed: Mapping[int, StatusRecord],
        batch: Sequence[RecordedTransition],
        uncertain: set[int],
    ) -> _Walk:
        """Apply *batch* without a check of the *uncertain* nodes. *self* is not changed."""
        before = dict(self.statuses)
        if uncertain:
            reached: defaultdict[int, set[int]] = defaultdict(set)
            for transition in batch:
                reached[transition.uid].add(transition.status)
            # A requested status to which no transition leads is the status before the batch.
            before.update(
                (uid, record)
                for uid, record in observed.items()
                if uid in uncertain and record.status not in reached[uid]
            )
        now = dict(before)
        # Nodes whose status differs from *observed*. The batch agrees if the set is empty at some moment.
        different = {
            uid for uid, record in now.items() if uid not in uncertain and observed.get(uid) != record
        }
        agrees, is_consistent = not different, True
        steps: list[Step] = []
        # Uncertain nodes whose only transition led to IDLE: their previous status is unknown.
        incomplete: set[int] = set()
        for transition in batch:
            uid, status = transition.uid, transition.status
            known = now.get(uid)
            if known is None:
                continue
            if uid in incomplete:
                incomplete.discard(uid)
            elif status == IDLE and uid in uncertain and known is before[uid]:
                incomplete.add(uid)
            if known.status != status:
                steps.append((transition, known.status))
            elif uid not in uncertain:
                is_consistent = False
            now[uid] = record = StatusRecord(status, known.status if status == IDLE else 0)
            if uid not in uncertain:
                (different.discard if record == observed.get(uid) else different.add)(uid)
                agrees = agrees or not different
        return _Walk(before, steps, now, incomplete, agrees and is_consistent)


class RobotClockEstimate:
    """An estimate of a robot's wall clock (ns since the epoch), and the time of its tree.

    Until the robot sends a time, the estimate equals this machine's wall clock. The estimate advances with
    the monotonic clock, so changes of this machine's wall clock do not affect it.
    """

    def __init__(self) -> None:
        self._offset = time.time_ns() - time.monotonic_ns()
        self._origin = self.wall()

    def wall(self) -> int:
        """Return the estimate of the current time of the robot's wall clock (ns since the epoch)."""
        return time.monotonic_ns() + self._offset

    def set(self, wall: int, then: int) -> None:
        """Correct the estimate.

        Args:
            wall: A time of the robot's wall clock, in ns since the epoch.
            then: The value of the method `wall` at the same moment.
        """
        self._offset += wall - then

    def begin(self, wall: int) -> None:
        """Let the tree's time start at *wall* (ns since the epoch)."""
        self._origin = wall

    def stamp(self, wall: int) -> int:
        """Return the tree's time (ns) at *wall* (ns since the epoch)."""
        return wall - self._origin
