"""Components that are configured and activated from outside, with ROS 2's states and numbers."""

from enum import IntEnum


class State(IntEnum):
    """The states that last (``lifecycle_msgs/State``)."""

    UNCONFIGURED = 1
    INACTIVE = 2
    ACTIVE = 3
    FINALIZED = 4


class Change(IntEnum):
    """The transitions that may be asked for (``lifecycle_msgs/Transition``)."""

    CONFIGURE = 1
    CLEANUP = 2
    ACTIVATE = 3
    DEACTIVATE = 4
    SHUTDOWN = 5


_LEADS = {
    (State.UNCONFIGURED, Change.CONFIGURE): State.INACTIVE,
    (State.INACTIVE, Change.CLEANUP): State.UNCONFIGURED,
    (State.INACTIVE, Change.ACTIVATE): State.ACTIVE,
    (State.ACTIVE, Change.DEACTIVATE): State.INACTIVE,
    (State.UNCONFIGURED, Change.SHUTDOWN): State.FINALIZED,
    (State.INACTIVE, Change.SHUTDOWN): State.FINALIZED,
    (State.ACTIVE, Change.SHUTDOWN): State.FINALIZED,
}


class LifecycleComponent:
    """A component with a `state`. A subclass says what a change does, or refuses it by returning False."""

    def __init__(self) -> None:
        self._state = State.UNCONFIGURED

    @property
    def state(self) -> State:
        """Where it is now."""
        return self._state

    def change(self, asked: Change) -> bool:
        """Ask for a transition; False where there is none from here, or it is refused: nothing changes."""
        target = _LEADS.get((self._state, asked))
        if target is None or not self._callback(asked):
            return False
        self._state = target
        return True

    def configure(self) -> bool:
        """From unconfigured to inactive."""
        return self.change(Change.CONFIGURE)

    def activate(self) -> bool:
        """From inactive to active."""
        return self.change(Change.ACTIVATE)

    def deactivate(self) -> bool:
        """From active to inactive."""
        return self.change(Change.DEACTIVATE)

    def cleanup(self) -> bool:
        """From inactive to unconfigured."""
        return self.change(Change.CLEANUP)

    def shutdown(self) -> bool:
        """From anywhere to finalized, for good."""
        return self.change(Change.SHUTDOWN)

    def on_configure(self) -> bool:
        """Get ready."""
        return True

    def on_activate(self) -> bool:
        """Begin to work."""
        return True

    def on_deactivate(self) -> bool:
        """Stop working."""
        return True

    def on_cleanup(self) -> bool:
        """Give back what `on_configure` took."""
        return True

    def on_shutdown(self) -> bool:
        """End; unless it is overridden, as `on_deactivate` stops."""
        return self.on_deactivate()

    def _callback(self, asked: Change) -> bool:
        return {
            Change.CONFIGURE: self.on_configure,
            Change.ACTIVATE: self.on_activate,
            Change.DEACTIVATE: self.on_deactivate,
            Change.CLEANUP: self.on_cleanup,
            Change.SHUTDOWN: self.on_shutdown,
        }[asked]()
