"""Actions that write or remove blackboard entries: SetBlackboard and UnsetBlackboard."""

from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.blackboard.blackboard import Entry
from btcore.blackboard.ports import Direction, Port, PortRole, braced_key
from btcore.engine.leaf import SyncAction
from btcore.errors import BlackboardError
from btcore.status import FAILURE, SUCCESS, Status
from btcore.values import STRING, ValueType, number_of


def copy_error(key: str, declared: ValueType, given: ValueType) -> BlackboardError:
    """Return the error for a copy to the entry *key* of type *declared* from an entry of type *given*."""
    return BlackboardError(
        f"the type of the entry '{key}' cannot change from {declared.name} to {given.name}: "
        "copy to another entry, or assign the value in a Script, which converts it"
    )


@mypyc_attr(allow_interpreted_subclasses=True)
class SetBlackboard(SyncAction):
    """Writes `value` to the entry named by `output_key` (the name itself, without braces), and succeeds.

    A text is converted if the entry already has a type. `value="{key}"` copies the entry `key`; if the
    destination does not exist, it gets the same type. The node fails if the entry `key` was never written,
    and raises an error if it does not exist or if the destination has another type.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    node_symbol: ClassVar[str] = "↓"
    batch_class: ClassVar[str] = "btcore.batch.script_nodes:SetBlackboard"
    may_return: ClassVar[frozenset[Status]] = frozenset({SUCCESS, FAILURE})

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
        key = STRING.cast(self.get_input("output_key"))
        # The text of the port, not its value: BehaviorTree.CPP copies an entry with its type.
        text = self.config.inputs["value"].text if "value" in self.config.inputs else None
        if text is None:
            self.get_input("value")
        source_key = braced_key(text or "", self.config.format)
        value: object = text
        if source_key is not None:
            source = board.find(source_key)
            if source is None:
                raise BlackboardError(f"port [value] reads {{{source_key}}}, which is not on the blackboard")
            # Created even if there is no value to copy, as in BehaviorTree.CPP.
            if board.find(key) is None:
                board.create(key, source.declared)
            value = source.value
            if value is None:
                return self.nothing_to_copy(key)
            self.check_copy(key, source)
        self.write(key, value)
        return SUCCESS

    def check_copy(self, key: str, source: Entry) -> None:
        """Raise BlackboardError if *source* has another type than the entry *key*, unless it is a text."""
        target = self._blackboard.find(key)
        value = source.value
        if target is None or isinstance(value, str):
            return
        have, given = target.declared, source.declared
        if not have.strong or not given.strong or have.same(given):
            return
        # A Python int may stand for any integer type, and an object for its base class.
        if not have.accepts(value) or (not source.inferred and number_of(value) is not None):
            raise copy_error(key, have, given)

    def nothing_to_copy(self, key: str) -> Status:
        """Return the result if the entry to copy was never written."""
        return FAILURE

    def write(self, key: str, value: object) -> None:
        """Write *value*; a text is converted if the entry has a type."""
        board = self._blackboard
        entry = board.find(key)
        if isinstance(value, str) and entry is not None:
            # An entry without a type remains so: BehaviorTree.CPP accepts a number later, too.
            if entry.declared.strong:
                value = entry.declared.from_text(value, self.config.format)
            if not entry.declared.strong or board.local_entries().get(key) is entry:
                entry.put(value, board.now())
                return
        # In an outer scope BehaviorTree.CPP may write another entry than it reads: "@m", not the root's "m".
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
