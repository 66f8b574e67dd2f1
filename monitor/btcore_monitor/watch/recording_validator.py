"""Check the recorded transitions of a robot for gaps.

Groot 2's publishers keep the last 1,000 transitions, and the first client that requests them removes them.
The transitions have no numbers. So a batch counts as complete only if it agrees with the statuses that were
requested between two batches: starting from the statuses after the previous batch, its transitions must pass
through exactly those statuses, and no transition may lead to the node's current status.
"""

import time
from collections.abc import Mapping, Sequence

from btcore_monitor.errors import MonitorError
from btcore_monitor.events import IDLE
from btcore_monitor.wire.groot2 import RECORDED_AT_MOST, RecordedTransition, StatusRecord


class MissingTransitionsError(MonitorError):
    """Transitions are missing. The message describes how the gap was detected."""


class RecordingOverflowError(MissingTransitionsError):
    """There were more transitions than the robot keeps."""


class RecordingValidator:
    """Applies batches of transitions to *statuses*, and detects gaps."""

    def __init__(self, statuses: Mapping[int, StatusRecord]) -> None:
        self.statuses = dict(statuses)

    def apply(
        self, observed: Mapping[int, StatusRecord], batch: Sequence[RecordedTransition]
    ) -> list[tuple[RecordedTransition, int]]:
        """Apply a batch of transitions.

        Args:
            observed: The statuses that the robot sent after the previous batch and before this batch.
            batch: The recorded transitions, the oldest first.

        Returns:
            The transitions, each with its node's previous status.

        Raises:
            RecordingOverflowError: The batch is as large as the robot's buffer.
            MissingTransitionsError: The batch does not agree with *observed*. Then `statuses` holds the
                latest known status of each node.
        """
        steps = []
        problem = ""
        before = self.statuses
        now = dict(before)
        # Nodes whose status differs from *observed*. The batch agrees if the set is empty at some moment.
        different = {uid for uid, record in observed.items() if now.get(uid) != record}
        agreed = not different
        for transition in batch:
            known = now.get(transition.uid)
            if known is None:
                continue
            if known.status == transition.status:
                problem = f"node {transition.uid} went twice to the same status"
            steps.append((transition, known.status))
            now[transition.uid] = StatusRecord(
                transition.status, known.status if transition.status == IDLE else 0
            )
            if now[transition.uid] == observed.get(transition.uid):
                different.discard(transition.uid)
            else:
                different.add(transition.uid)
            agreed = agreed or not different
        if not problem and agreed and len(batch) < RECORDED_AT_MOST:
            self.statuses = now
            return steps
        moved = {transition.uid for transition in batch}
        self.statuses = before | {
            uid: now[uid] if uid in moved and uid in now else record for uid, record in observed.items()
        }
        if len(batch) >= RECORDED_AT_MOST:
            raise RecordingOverflowError(
                f"the robot keeps {RECORDED_AT_MOST} transitions, and older ones are dropped"
            )
        raise MissingTransitionsError(problem or "its recorded transitions do not lead to its statuses")


class RobotClock:
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

    def t(self, wall: int) -> int:
        """Return the tree's time (ns) at *wall* (ns since the epoch)."""
        return wall - self._origin
