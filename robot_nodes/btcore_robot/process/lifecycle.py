"""Components that are configured and activated from outside, with ROS 2's states and numbers."""

from enum import IntEnum


class LifecycleState(IntEnum):
    """The states that last (``lifecycle_msgs/State``)."""

    UNCONFIGURED = 1
    INACTIVE = 2
    ACTIVE = 3
    FINALIZED = 4


class LifecycleTransition(IntEnum):
    """The transitions that may be asked for (``lifecycle_msgs/Transition``)."""

    CONFIGURE = 1
    CLEANUP = 2
    ACTIVATE = 3
    DEACTIVATE = 4
    SHUTDOWN = 5


_LEADS = {
    (LifecycleState.UNCONFIGURED, LifecycleTransition.CONFIGURE): LifecycleState.INACTIVE,
    (LifecycleState.INACTIVE, LifecycleTransition.CLEANUP): LifecycleState.UNCONFIGURED,
    (LifecycleState.INACTIVE, LifecycleTransition.ACTIVATE): LifecycleState.ACTIVE,
    (LifecycleState.ACTIVE, LifecycleTransition.DEACTIVATE): LifecycleState.INACTIVE,
    (LifecycleState.UNCONFIGURED, LifecycleTransition.SHUTDOWN): LifecycleState.FINALIZED,
    (LifecycleState.INACTIVE, LifecycleTransition.SHUTDOWN): LifecycleState.FINALIZED,
    (LifecycleState.ACTIVE, LifecycleTransition.SHUTDOWN): LifecycleState.FINALIZED,
}


class LifecycleComponent:
    """A component with a `state`. A subclass says what a change does, or refuses it by returning False."""

    def __init__(self) -> None:
        self._state = LifecycleState.UNCONFIGURED

    @property
    def state(self) -> LifecycleState:
        """Where it is now."""
        return self._state

    def change(self, asked: LifecycleTransition) -> bool:
        """Ask for a transition; False where there is none from here, or it is refused: nothing changes."""
        target = _LEADS.get((self._state, asked))
        if target is None or not self._callback(asked):
            return False
        self._state = target
        return True

    def configure(self) -> bool:
        """From unconfigured to inactive."""
        return self.change(LifecycleTransition.CONFIGURE)

    def activate(self) -> bool:
        """From inactive to active."""
        return self.change(LifecycleTransition.ACTIVATE)

    def deactivate(self) -> bool:
        """From active to inactive."""
        return self.change(LifecycleTransition.DEACTIVATE)

    def cleanup(self) -> bool:
        """From inactive to unconfigured."""
        return self.change(LifecycleTransition.CLEANUP)

    def shutdown(self) -> bool:
        """From anywhere to finalized, for good."""
        return self.change(LifecycleTransition.SHUTDOWN)

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

    def _callback(self, asked: LifecycleTransition) -> bool:
        return {
            LifecycleTransition.CONFIGURE: self.on_configure,
            LifecycleTransition.ACTIVATE: self.on_activate,
            LifecycleTransition.DEACTIVATE: self.on_deactivate,
            LifecycleTransition.CLEANUP: self.on_cleanup,
            LifecycleTransition.SHUTDOWN: self.on_shutdown,
        }[asked]()
