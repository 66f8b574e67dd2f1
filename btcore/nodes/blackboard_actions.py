"""Actions that write or remove blackboard entries: SetBlackboard and UnsetBlackboard."""

from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Direction, Port, PortRole, remapped_key
from btcore.engine.leaf import SyncAction
from btcore.errors import BlackboardError
from btcore.status import FAILURE, SUCCESS, Status
from btcore.values import STRING


@mypyc_attr(allow_interpreted_subclasses=True)
class SetBlackboard(SyncAction):
    """Writes `value` to the entry named by `output_key` (the name itself, without braces), and succeeds.

    A text is converted if the entry already has a type. `value="{key}"` copies the entry `key`; if the
    destination does not exist, it gets the same type. The node fails if the entry `key` was never written,
    and raises an error if it does not exist.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    node_symbol: ClassVar[str] = "↓"
    batch_class: ClassVar[str] = "btcore.batch.script_nodes:SetBlackboard"

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return [
            Port("value", description="what to write", role=PortRole.WRITTEN_VALUE),
            Port(
                "output_key",
                Direction.INOUT,
                description="the name of the entry to write",
                role=PortRole.WRITTEN_ENTRY,
            ),
        ]

    def tick(self) -> Status:
        """Write the entry."""
        board = self._blackboard
        key = str(self.get_input("output_key"))
        # The text of the port, not its value: BehaviorTree.CPP copies an entry with its type.
        text = self.config.inputs["value"].text if "value" in self.config.inputs else None
        if text is None:
            self.get_input("value")
        source_key = remapped_key(text or "", "value", self.config.format)
        value: object = text
        if source_key is not None and text not in ("=", "{=}"):
            source = board.find(source_key)
            if source is None:
                raise BlackboardError(f"port [value] reads {{{source_key}}}, which is not on the blackboard")
            # Created even if there is no value to copy, as in BehaviorTree.CPP.
            if board.find(key) is None:
                board.create(key, source.declared)
            value = source.value
            if value is None:
                return self.nothing_to_copy(key)
        self.write(key, value)
        return SUCCESS

    def nothing_to_copy(self, key: str) -> Status:
        """Return the result if the entry to copy was never written."""
        return FAILURE

    def write(self, key: str, value: object) -> None:
        """Write *value*; a text is converted if the entry has a type."""
        board = self._blackboard
        entry = board.find(key)
        if isinstance(value, str) and entry is not None and entry.declared.strong:
            value = entry.declared.from_text(value, self.config.format)
        board.set(key, value)


@mypyc_attr(allow_interpreted_subclasses=True)
class UnsetBlackboard(SyncAction):
    """Removes the entry named by `key` from the node's own scope, and succeeds.

    It succeeds also if there is no such entry. An entry of an outer scope is not removed.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    may_return: ClassVar[frozenset[Status]] = frozenset({SUCCESS})

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        about = "the name of the entry to remove"
        return [Port("key", type=STRING, description=about, role=PortRole.REMOVED_ENTRY)]

    def tick(self) -> Status:
        """Remove the entry."""
        self._blackboard.unset(str(self.get_input("key")))
        return SUCCESS
