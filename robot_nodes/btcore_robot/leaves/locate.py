"""A leaf that locates objects: a lifecycle client of the object locator."""

from collections.abc import Sequence
from typing import Annotated, Protocol, runtime_checkable

from btcore import Out, StatefulAction, Status
from btcore_robot.process.lifecycle import LifecycleState


@runtime_checkable
class ObjectLocatorProtocol(Protocol):
    """A component that finds objects in camera images while it is active."""

    @property
    def state(self) -> LifecycleState:
        """The current lifecycle state."""

    @property
    def boxes(self) -> Sequence[object]:
        """The objects in the newest image, as `btcore_robot.perception.boxes.BoundingBox3D`."""

    def activate(self) -> bool:
        """Change from inactive to active; return False if the transition is refused."""

    def deactivate(self) -> bool:
        """Change from active to inactive; return False if the transition is refused."""


class LocateObjects(StatefulAction):
    """Keep the object locator active and write its results.

    Always RUNNING; a halt deactivates the locator.
    """

    boxes: Annotated[Out[object], "The objects in the newest image: a list of boxes in the frame map."]

    def __init__(self, locator: ObjectLocatorProtocol) -> None:
        self.locator = locator
        self.written_boxes: Sequence[object] | None = None

    def on_start(self) -> Status:
        """Activate the locator."""
        self.written_boxes = None
        return self.on_running()

    def on_running(self) -> Status:
        """Activate the locator again if it was deactivated elsewhere, and write new results."""
        if self.locator.state is LifecycleState.INACTIVE:
            self.locator.activate()
        if self.locator.boxes is not self.written_boxes:
            self.written_boxes = self.locator.boxes
            self.boxes = list(self.written_boxes)
        return Status.RUNNING

    def on_halted(self) -> None:
        """Deactivate the locator."""
        if self.locator.state is LifecycleState.ACTIVE:
            self.locator.deactivate()
