"""Nodes that check whether a blackboard entry was written since their last check."""

from collections.abc import Mapping
from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port, PortRole, braced_key
from btcore.engine.control import DecoratorNode
from btcore.engine.leaf import SyncAction
from btcore.engine.node import TreeNode, execute_tick
from btcore.engine.node_spec import NodeSpec
from btcore.errors import NodeError
from btcore.status import FAILURE, RUNNING, SKIPPED, SUCCESS, UNKNOWN_RESULTS, PossibleResults, Status
from btcore.values import ANY_VALUE


def entry_port() -> list[Port]:
    """Return a list with the port `entry`, the only port of each node of this module."""
    return [Port("entry", type=ANY_VALUE, description="the entry to check", role=PortRole.WATCHED_ENTRY)]


def entry_key(node: TreeNode) -> str:
    """Return the key of the entry that *node* checks. Raise NodeError if the port is missing."""
    port = node.config.inputs.get("entry")
    if port is None or not port.text:
        raise NodeError(f"<{node.config.id}> needs port [entry], the blackboard entry to check")
    return braced_key(port.text) or port.text


def write_count(node: TreeNode, key: str, seen: int) -> int:
    """Return how often the entry *key* was written, or *seen*, the previous count, if it is missing."""
    entry = node._blackboard.find(key)
    return seen if entry is None else entry.sequence_id


@mypyc_attr(allow_interpreted_subclasses=True)
class EntryUpdatedDecorator(DecoratorNode):
    """Ticks its child if the entry was written since the last check, else returns *status_if_unchanged*."""

    spec: ClassVar[NodeSpec] = NodeSpec(state_fields=("_seen", "_child_running"))
    status_if_unchanged: ClassVar[Status] = SKIPPED
    _key: str = ""
    _seen: int = 0  # the number of writes at the last check
    _child_running: bool = False  # whether the last tick of the child returned RUNNING

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return entry_port()

    def prepare(self) -> None:
        """Store the key of the entry."""
        self._key = entry_key(self)

    def tick(self) -> Status:
        """Check the entry, unless the child is RUNNING, and tick the child."""
        # Writes while the child is RUNNING are found by the next check, after the child has completed.
        if not self._child_running:
            before = self._seen
            self._seen = write_count(self, self._key, before)
            if self._seen == before:
                return self.status_if_unchanged
        status = execute_tick(self.child)
        self._child_running = status is RUNNING
        return status

    def halt(self) -> None:
        """Halt the child. The next check still counts the writes since the last check."""
        self._child_running = False
        super().halt()


@mypyc_attr(allow_interpreted_subclasses=True)
class SkipUnlessUpdated(EntryUpdatedDecorator):
    """Ticks its child if `entry` was written since the last check, else returns SKIPPED.

    In the first check, an entry that has ever been written counts as updated. A RUNNING child is
    ticked without a check. The node returns the child's result.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(4,))
    status_if_unchanged: ClassVar[Status] = SKIPPED


@mypyc_attr(allow_interpreted_subclasses=True)
class WaitValueUpdate(EntryUpdatedDecorator):
    """Ticks its child if `entry` was written since the last check, else returns RUNNING.

    In the first check, an entry that has ever been written counts as updated. A RUNNING child is
    ticked without a check. The node returns the child's result.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(formats=(4,))
    status_if_unchanged: ClassVar[Status] = RUNNING

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return that every tick may have any result or be RUNNING."""
        return UNKNOWN_RESULTS


@mypyc_attr(allow_interpreted_subclasses=True)
class WasEntryUpdated(SyncAction):
    """Succeeds if `entry` was written since the last check; fails if not, or if there is no such entry.

    In the first check, an entry that has ever been written counts as updated.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(
        results=frozenset({SUCCESS, FAILURE}), state_fields=("_seen",), formats=(4,)
    )

    _key: str = ""
    _seen: int = 0  # the number of writes at the last check

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return entry_port()

    def prepare(self) -> None:
        """Store the key of the entry."""
        self._key = entry_key(self)

    def tick(self) -> Status:
        """Check the entry."""
        before = self._seen
        self._seen = write_count(self, self._key, before)
        return FAILURE if self._seen == before else SUCCESS
