"""Leaves that keep the head tracker or the object locator active."""

from collections.abc import Sequence
from typing import Annotated, Protocol, runtime_checkable

from btcore import RUNNING, NodeSpec, Out, StatefulAction, Status
from btcore_robot.components.lifecycle import LifecycleState


class _Server(Protocol):
    """A server with a lifecycle."""

    @property
    def state(self) -> LifecycleState:
        """The current lifecycle state."""

    def activate(self) -> bool:
        """Change from inactive to active; return False if the transition is refused."""

    def deactivate(self) -> bool:
        """Change from active to inactive; return False if the transition is refused."""


@runtime_checkable
class HeadTrackerProtocol(_Server, Protocol):
    """A head tracker: a server that follows objects with the head while it is active."""

    @property
    def detection(self) -> object:
        """The object in the newest image, as `btcore_robot.perception.colour.Detection`, or None."""


@runtime_checkable
class ObjectLocatorProtocol(_Server, Protocol):
    """An object locator: a server that finds objects in camera images while it is active."""

    @property
    def boxes(self) -> Sequence[object]:
        """The objects in the newest image, as `btcore_robot.perception.object_locator.BoundingBox3D`."""


class _KeepActive(StatefulAction):
    """Keeps a server active. Always RUNNING; a halt deactivates the server."""

    spec = NodeSpec(results=frozenset())

    _server: _Server

    def on_start(self) -> Status:
        """Activate the server."""
        return self.on_running()

    def on_running(self) -> Status:
        """Activate the server if it is inactive, for example because another program deactivated it."""
        if self._server.state is LifecycleState.INACTIVE:
            self._server.activate()
        return RUNNING

    def on_halted(self) -> None:
        """Deactivate the server."""
        if self._server.state is LifecycleState.ACTIVE:
            self._server.deactivate()


class TrackObjects(_KeepActive):
    """Keeps the head tracker active. Always RUNNING; a halt deactivates the tracker."""

    spec = NodeSpec(state_fields=())

    def __init__(self, tracker: HeadTrackerProtocol) -> None:
        self._server = tracker


class LocateObjects(_KeepActive):
    """Keeps the object locator active and writes its results to *boxes*.

    Always RUNNING; a halt deactivates the locator.
    """

    boxes: Annotated[Out[object], "The objects in the newest image: a list of boxes in the frame map."]

    # The boxes belong to the locator, and a copy would count as new.
    spec = NodeSpec(state_fields=None, writes=("boxes",))

    def __init__(self, locator: ObjectLocatorProtocol) -> None:
        self._server = self.locator = locator
        self.written_boxes: Sequence[object] | None = None

    def on_start(self) -> Status:
        """Activate the locator; the next tick writes its results again."""
        self.written_boxes = None
        return super().on_start()

    def on_running(self) -> Status:
        """Activate the locator if necessary, and write new results."""
        status = super().on_running()
        if self.locator.boxes is not self.written_boxes:
            self.written_boxes = self.locator.boxes
            self.boxes = list(self.written_boxes)
        return status
