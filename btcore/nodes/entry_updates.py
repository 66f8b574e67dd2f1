"""Nodes that look whether a blackboard entry was written since they looked last."""

from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port
from btcore.engine.control import DecoratorNode
from btcore.engine.leaf import SyncAction
from btcore.engine.node import TreeNode, execute_tick
from btcore.errors import NodeError
from btcore.status import (
    FAILURE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Status,
)
from btcore.values import ANY_VALUE


def entry_port() -> list[Port]:
    """The port of all of them."""
    return [Port("entry", type=ANY_VALUE, description="the entry to look at")]


class EntryWatcher:
    """The entry that a node watches, and how often it had been written at the last look."""

    def __init__(self, node: TreeNode) -> None:
        port = node.config.inputs.get("entry")
        if port is None or not port.text:
            raise NodeError(f"<{node.id}> needs port [entry], the blackboard entry to look at")
        self.node = node
        self.key: str = port.text if port.key is None else port.key
        self.seen = 0

    def updated(self) -> bool:
        """Whether the entry is there and was written since the last look."""
        entry = self.node._blackboard.find(self.key)
        if entry is None:
            return False
        before = self.seen
        self.seen = entry.sequence_id
        return before != entry.sequence_id


@mypyc_attr(allow_interpreted_subclasses=True)
class EntryUpdatedDecorator(DecoratorNode):
    """Ticks its child when the entry was written since the last look, else gives *otherwise*."""

    status_if_unchanged: ClassVar[Status] = SKIPPED
    _watch: EntryWatcher
    _going: bool = False

    @staticmethod
    def provided_ports() -> list[Port]:
        """The ports."""
        return entry_port()

    def prepare(self) -> None:
        """Find the entry's name."""
        self._watch = EntryWatcher(self)

    def tick(self) -> Status:
        """Look, unless the child runs; then tick it."""
        if not self._going and not self._watch.updated():
            return self.status_if_unchanged
        status = execute_tick(self.child)
        self._going = status is RUNNING
        return status

    def halt(self) -> None:
        """Halt the child; what was seen stays seen."""
        self._going = False
        self.halt_child()
        self.reset_status()


@mypyc_attr(allow_interpreted_subclasses=True)
class SkipUnlessUpdated(EntryUpdatedDecorator):
    """Ticks its child when `entry` was written since the last look, else is SKIPPED.

    The first look at an entry that has been written counts as an update; a child that runs is
    ticked without a look.
    """

    status_if_unchanged: ClassVar[Status] = SKIPPED


@mypyc_attr(allow_interpreted_subclasses=True)
class WaitValueUpdate(EntryUpdatedDecorator):
    """Ticks its child when `entry` was written since the last look, else is RUNNING.

    The first look at an entry that has been written counts as an update; a child that runs is
    ticked without a look.
    """

    status_if_unchanged: ClassVar[Status] = RUNNING


@mypyc_attr(allow_interpreted_subclasses=True)
class WasEntryUpdated(SyncAction):
    """Succeeds if `entry` was written since the last look; fails if not, or if there is none."""

    _watch: EntryWatcher

    @staticmethod
    def provided_ports() -> list[Port]:
        """The ports."""
        return entry_port()

    def prepare(self) -> None:
        """Find the entry's name."""
        self._watch = EntryWatcher(self)

    def tick(self) -> Status:
        """Look."""
        return SUCCESS if self._watch.updated() else FAILURE
