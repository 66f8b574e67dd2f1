"""Telling where objects are on the way: a lifecycle client of the object locator."""

from collections.abc import Sequence
from typing import Annotated, Protocol, runtime_checkable

from btcore import Out, StatefulAction, Status
from btcore_robot.process.lifecycle import LifecycleState


@runtime_checkable
class ObjectLocatorProtocol(Protocol):
    """A component that finds objects in pictures while it is active."""

    @property
    def state(self) -> LifecycleState:
        """Where it is in its life."""
        ...

    @property
    def boxes(self) -> Sequence[object]:
        """What the newest picture showed, as `btcore_robot.perception.boxes.Box`."""
        ...

    def activate(self) -> bool:
        """From inactive to active; False where that is refused."""
        ...

    def deactivate(self) -> bool:
        """From active to inactive; False where that is refused."""
        ...


class LocateObjects(StatefulAction):
    """Keep the object locator active, and write what it sees. Always RUNNING; a halt deactivates it."""

    boxes: Annotated[Out[object], "What the newest picture showed: boxes in the frame map, a list."]

    def __init__(self, locator: ObjectLocatorProtocol) -> None:
        self.locator = locator
        self.written_boxes: Sequence[object] | None = None

    def on_start(self) -> Status:
        """Activate the locator."""
        self.written_boxes = None
        return self.on_running()

    def on_running(self) -> Status:
        """Activate the locator again, should somebody have stopped it; write what is new."""
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
