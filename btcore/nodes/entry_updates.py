"""Nodes that look whether a blackboard entry was written since they looked last."""

from collections.abc import Mapping
from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port, PortRole
from btcore.engine.control import DecoratorNode
from btcore.engine.leaf import SyncAction
from btcore.engine.node import TreeNode, execute_tick
from btcore.errors import NodeError
from btcore.status import (
    FAILURE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    UNKNOWN_RESULTS,
    PossibleResults,
    Status,
)
from btcore.values import ANY_VALUE


def entry_port() -> list[Port]:
    """The port of all of them."""
    return [Port("entry", type=ANY_VALUE, description="the entry to look at", role=PortRole.WATCHED_ENTRY)]


def entry_key(node: TreeNode) -> str:
    """The key of the entry that *node* looks at. Raises NodeError without the port."""
    port = node.config.inputs.get("entry")
    if port is None or not port.text:
        raise NodeError(f"<{node.id}> needs port [entry], the blackboard entry to look at")
    return port.text if port.key is None else port.key


def write_count(node: TreeNode, key: str, seen: int) -> int:
    """How often the entry *key* has been written, or *seen* if there is none."""
    entry = node._blackboard.find(key)
    return seen if entry is None else entry.sequence_id


@mypyc_attr(allow_interpreted_subclasses=True)
class EntryUpdatedDecorator(DecoratorNode):
    """Ticks its child when the entry was written since the last look, else gives *otherwise*."""

    builtin_formats: ClassVar[tuple[int, ...]] = ()
    state_fields: ClassVar[tuple[str, ...] | None] = ("_seen", "_going")
    status_if_unchanged: ClassVar[Status] = SKIPPED
    _key: str = ""
    _seen: int = 0
    _going: bool = False

    @staticmethod
    def provided_ports() -> list[Port]:
        """The ports."""
        return entry_port()

    def prepare(self) -> None:
        """Find the entry's name."""
        self._key = entry_key(self)

    def tick(self) -> Status:
        """Look, unless the child runs; then tick it."""
        if not self._going:
            before = self._seen
            self._seen = write_count(self, self._key, before)
            if self._seen == before:
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

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    status_if_unchanged: ClassVar[Status] = SKIPPED


@mypyc_attr(allow_interpreted_subclasses=True)
class WaitValueUpdate(EntryUpdatedDecorator):
    """Ticks its child when `entry` was written since the last look, else is RUNNING.

    The first look at an entry that has been written counts as an update; a child that runs is
    ticked without a look.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    status_if_unchanged: ClassVar[Status] = RUNNING

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Any result, and RUNNING."""
        return UNKNOWN_RESULTS


@mypyc_attr(allow_interpreted_subclasses=True)
class WasEntryUpdated(SyncAction):
    """Succeeds if `entry` was written since the last look; fails if not, or if there is none."""

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    may_return: ClassVar[frozenset[Status]] = frozenset({SUCCESS, FAILURE})
    state_fields: ClassVar[tuple[str, ...] | None] = ("_seen",)

    _key: str = ""
    _seen: int = 0

    @staticmethod
    def provided_ports() -> list[Port]:
        """The ports."""
        return entry_port()

    def prepare(self) -> None:
        """Find the entry's name."""
        self._key = entry_key(self)

    def tick(self) -> Status:
        """Look."""
        before = self._seen
        self._seen = write_count(self, self._key, before)
        return FAILURE if self._seen == before else SUCCESS
