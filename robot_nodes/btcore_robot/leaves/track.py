"""A leaf that tracks objects with the head: a lifecycle client of the head tracker."""

from typing import Protocol, runtime_checkable

from btcore import StatefulAction, Status
from btcore_robot.process.lifecycle import LifecycleState


@runtime_checkable
class HeadTrackerProtocol(Protocol):
    """A component that follows objects with the head while it is active."""

    @property
    def state(self) -> LifecycleState:
        """The current lifecycle state."""

    def activate(self) -> bool:
        """Change from inactive to active; return False if the transition is refused."""

    def deactivate(self) -> bool:
        """Change from active to inactive; return False if the transition is refused."""


class TrackObjects(StatefulAction):
    """Keep the head tracker active. Always RUNNING; a halt deactivates it."""

    def __init__(self, tracker: HeadTrackerProtocol) -> None:
        self.tracker = tracker

    def on_start(self) -> Status:
        """Activate the tracker."""
        return self.on_running()

    def on_running(self) -> Status:
        """Activate the tracker again if it was deactivated elsewhere."""
        if self.tracker.state is LifecycleState.INACTIVE:
            self.tracker.activate()
        return Status.RUNNING

    def on_halted(self) -> None:
        """Deactivate the tracker."""
        if self.tracker.state is LifecycleState.ACTIVE:
            self.tracker.deactivate()
