"""Actions that write or remove blackboard entries: SetBlackboard and UnsetBlackboard."""

from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.blackboard.blackboard import Entry
from btcore.blackboard.ports import Direction, Port, PortRole, braced_key
from btcore.engine.leaf import SyncAction
from btcore.engine.node_spec import NodeSpec
from btcore.errors import BlackboardError
from btcore.status import FAILURE, SUCCESS, Status
from btcore.values import ANY_VALUE, STRING, ValueType, number_of


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
    and raises an error if it does not exist or if the destination has another type than the value. An integer
    that a script wrote first has 64 bits, which is another type than `int`.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(symbol="↓", results=frozenset({SUCCESS, FAILURE}), formats=(4,))

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
        if source_key is not None:
            source = board.find(source_key)
            if source is None:
                raise BlackboardError(f"port [value] reads {{{source_key}}}, which is not on the blackboard")
            # Created even if there is no value to copy, as in BehaviorTree.CPP.
            if board.find(key) is None:
                board.declare(key, source.declared)
            if source.value is None:
                return self.nothing_to_copy(key)
            self.copy(key, source)
        else:
            self.put_text(key, text or "")
        return SUCCESS

    def nothing_to_copy(self, key: str) -> Status:
        """Return the result if the entry to copy was never written."""
        return FAILURE

    def copy(self, key: str, source: Entry) -> None:
        """Copy the value of *source* with its type. A text is written as if it were the text of the port."""
        value = source.value
        if isinstance(value, str):
            self.put_text(key, value)
            return
        value_type = source.type_of_value()
        target = self._blackboard.find(key)
        if target is not None and target.declared.strong and not target.declared.same(value_type):
            # A Python int may stand for any integer type, and an object for its base class.
            is_exact = source.value_type is not None or (source.declared.strong and not source.inferred)
            if not target.declared.accepts(value) or (is_exact and number_of(value) is not None):
                raise copy_error(key, target.declared, value_type)
        self.store(key, target, value, value_type)

    def put_text(self, key: str, text: str) -> None:
        """Write *text*, which is converted if the entry has a type."""
        entry = self._blackboard.find(key)
        if entry is None:
            self._blackboard.set(key, text, STRING)
        elif not entry.declared.strong:
            # An entry without a type remains so: BehaviorTree.CPP accepts a number later, too.
            entry.put(text, self._blackboard.now())
        else:
            declared = entry.declared
            if not declared.converts:
                raise BlackboardError(
                    f"the entry '{key}' has the type {declared.name}, to which SetBlackboard cannot convert "
                    f"the text '{text}': assign the number of the member in a Script"
                )
            self.store(key, entry, declared.from_text(text, self.config.format), declared)

    def store(self, key: str, entry: Entry | None, value: object, value_type: ValueType) -> None:
        """Store *value* of the type *value_type* in *entry*, which `find` returns for *key*."""
        board = self._blackboard
        if key.startswith("@"):
            board, key = board.root, key.lstrip("@")
        if entry is not None and board.local_entries().get(key) is entry:
            if not entry.declared.strong:
                entry.declared = ANY_VALUE
            is_declared = value_type is entry.declared or value_type.same(entry.declared)
            entry.value_type = None if is_declared else value_type
            entry.put(value, board.now())
        else:
            # In an outer scope BehaviorTree.CPP may write another entry than it reads: "@m", not the root's
            # "m".
            board.set(key, value, value_type)


@mypyc_attr(allow_interpreted_subclasses=True)
class UnsetBlackboard(SyncAction):
    """Removes the entry named by `key` from the node's own scope, and succeeds.

    It succeeds also if there is no such entry. An entry of an outer scope is not removed.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(results=frozenset({SUCCESS}), formats=(4,))

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        about = "the name of the entry to remove"
        return [Port("key", type=STRING, description=about, role=PortRole.REMOVED_ENTRY)]

    def tick(self) -> Status:
        """Remove the entry."""
        self._blackboard.unset(str(self.get_input("key")))
        return SUCCESS
