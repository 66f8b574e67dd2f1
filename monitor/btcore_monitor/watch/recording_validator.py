"""Checking what a robot recorded: whether its transitions lead from what was known to what is.

Groot 2's publishers keep the last 1,000 transitions and hand them to whoever asks, once. They have no
numbers, so a batch counts as complete only if it is in keeping with the statuses that were asked for in
between: from how all nodes stood after the batch before, its transitions have to pass through exactly
those statuses, and no node may go to where it is.
"""

import time
from collections.abc import Mapping, Sequence

from btcore_monitor.errors import MonitorError
from btcore_monitor.events import IDLE
from btcore_monitor.wire.groot2 import RECORDED_AT_MOST, RecordedTransition, StatusRecord


class MissingTransitionsError(MonitorError):
    """Transitions are missing: the message says how that is known."""


class RecordingOverflowError(MissingTransitionsError):
    """There were more transitions than the robot keeps."""


class RecordingValidator:
    """How the nodes stand by the transitions so far, from how they stood in *statuses* on."""

    def __init__(self, statuses: Mapping[int, StatusRecord]) -> None:
        self.statuses = dict(statuses)

    def enter(
        self, looked: Mapping[int, StatusRecord], batch: Sequence[RecordedTransition]
    ) -> list[tuple[RecordedTransition, int]]:
        """The transitions of *batch*, each with its node's status before.

        *looked* is how the nodes stood at some moment after the batch before and not after this one.
        Raises :class:`MissingTransitionsError`; from then on what is known of a node is the latest that
        was said of it.
        """
        steps = []
        wrong = ""
        before = self.statuses
        now = dict(before)
        other = {uid for uid, record in looked.items() if now.get(uid) != record}
        met = not other
        for one in batch:
            known = now.get(one.uid)
            if known is None:
                continue
            if known.status == one.status:
                wrong = f"node {one.uid} went twice to the same status"
            steps.append((one, known.status))
            now[one.uid] = StatusRecord(one.status, known.status if one.status == IDLE else 0)
            if now[one.uid] == looked.get(one.uid):
                other.discard(one.uid)
            else:
                other.add(one.uid)
            met = met or not other
        if not wrong and met and len(batch) < RECORDED_AT_MOST:
            self.statuses = now
            return steps
        moved = {one.uid for one in batch}
        self.statuses = before | {
            uid: now[uid] if uid in moved and uid in now else record for uid, record in looked.items()
        }
        if len(batch) >= RECORDED_AT_MOST:
            raise RecordingOverflowError(
                f"the robot keeps {RECORDED_AT_MOST} transitions, and older ones are dropped"
            )
        raise MissingTransitionsError(wrong or "its recorded transitions do not lead to its statuses")


class RobotClock:
    """The wall clock of a robot (ns since the epoch), as far as it is known here, and its tree's time.

    It is ours until the robot tells its own, and goes steadily, whatever becomes of ours.
    """

    def __init__(self) -> None:
        self._ahead = time.time_ns() - time.monotonic_ns()
        self._origin = self.wall()

    def wall(self) -> int:
        """The robot's time now."""
        return time.monotonic_ns() + self._ahead

    def set(self, wall: int, then: int) -> None:
        """At *then*, as this clock has it, it was *wall* by the robot's."""
        self._ahead += wall - then

    def begin(self, wall: int) -> None:
        """The tree's time counts from *wall* on."""
        self._origin = wall

    def t(self, wall: int) -> int:
        """The tree's time (ns) at *wall*."""
        return wall - self._origin
