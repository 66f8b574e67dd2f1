"""ROS 2's lifecycle, for servers that a user configures, activates and deactivates."""

from collections.abc import Callable
from enum import IntEnum


class LifecycleState(IntEnum):
    """The primary states (`lifecycle_msgs/State`)."""

    UNCONFIGURED = 1
    INACTIVE = 2
    ACTIVE = 3
    FINALIZED = 4


class LifecycleTransition(IntEnum):
    """The transitions that a user may request (`lifecycle_msgs/Transition`)."""

    CONFIGURE = 1
    CLEANUP = 2
    ACTIVATE = 3
    DEACTIVATE = 4
    SHUTDOWN = 5


_TARGETS = {
    (LifecycleState.UNCONFIGURED, LifecycleTransition.CONFIGURE): LifecycleState.INACTIVE,
    (LifecycleState.INACTIVE, LifecycleTransition.CLEANUP): LifecycleState.UNCONFIGURED,
    (LifecycleState.INACTIVE, LifecycleTransition.ACTIVATE): LifecycleState.ACTIVE,
    (LifecycleState.ACTIVE, LifecycleTransition.DEACTIVATE): LifecycleState.INACTIVE,
    (LifecycleState.UNCONFIGURED, LifecycleTransition.SHUTDOWN): LifecycleState.FINALIZED,
    (LifecycleState.INACTIVE, LifecycleTransition.SHUTDOWN): LifecycleState.FINALIZED,
    (LifecycleState.ACTIVE, LifecycleTransition.SHUTDOWN): LifecycleState.FINALIZED,
}


class Lifecycle:
    """The base class of servers with a lifecycle, such as the head tracker.

    A subclass overrides the `on_…` callbacks. A callback that returns False refuses its transition.
    """

    def __init__(self) -> None:
        self.state = LifecycleState.UNCONFIGURED
        """The current state; only `change_state` sets it."""

    def change_state(self, transition: LifecycleTransition) -> bool:
        """Request *transition*; return False if it is invalid in the current state or refused."""
        target = _TARGETS.get((self.state, transition))
        # For example, the callback of CONFIGURE is `on_configure`.
        callback: Callable[[], bool] = getattr(self, f"on_{transition.name.lower()}")
        if target is None or not callback():
            return False
        self.state = target
        return True

    def configure(self) -> bool:
        """Change from unconfigured to inactive; return whether it succeeded."""
        return self.change_state(LifecycleTransition.CONFIGURE)

    def activate(self) -> bool:
        """Change from inactive to active; return whether it succeeded."""
        return self.change_state(LifecycleTransition.ACTIVATE)

    def deactivate(self) -> bool:
        """Change from active to inactive; return whether it succeeded."""
        return self.change_state(LifecycleTransition.DEACTIVATE)

    def cleanup(self) -> bool:
        """Change from inactive to unconfigured; return whether it succeeded."""
        return self.change_state(LifecycleTransition.CLEANUP)

    def shutdown(self) -> bool:
        """Change from any state to finalized, permanently; return whether it succeeded."""
        return self.change_state(LifecycleTransition.SHUTDOWN)

    def on_configure(self) -> bool:
        """Prepare for work. Return False to refuse the transition."""
        return True

    def on_activate(self) -> bool:
        """Start to work. Return False to refuse the transition."""
        return True

    def on_deactivate(self) -> bool:
        """Stop working. Return False to refuse the transition."""
        return True

    def on_cleanup(self) -> bool:
        """Release the resources of `on_configure`. Return False to refuse the transition."""
        return True

    def on_shutdown(self) -> bool:
        """Release all resources; by default call `on_deactivate`. Return False to refuse the transition."""
        return self.on_deactivate()
