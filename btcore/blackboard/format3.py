"""The blackboard with the rules of format 3 (BehaviorTree.CPP 3.8)."""

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.errors import BlackboardError, ConversionError
from btcore.values import ANY, ValueType, to_builtin_number, type_of


class Format3Blackboard(Blackboard):
    """A scope of a tree of format 3.

    The differences from `Blackboard`: `@` and `_` have no meaning at the start of a key. An entry
    that is created through remappings is stored in every scope that the remappings pass. An untyped entry
    never becomes typed. A typed entry accepts only values of exactly its type; if a port declared the type,
    it also accepts texts, which are converted, unless the entry existed before the port.
    """

    def find(self, key: str) -> Entry | None:
        """Return the entry of *key* after remapping, or None. The entry may never have been written."""
        board: Blackboard | None = self
        outer: str | None = key
        while board is not None and outer is not None:
            entry = board._entries.get(outer)
            if entry is not None:
                return entry
            outer = board._remaps.get(outer, outer if board.autoremap else None)
            board = board.parent
        return None

    def set(self, key: str, value: object, declared: ValueType | None = None) -> None:
        """Write *value* to the entry of *key* after remapping. Create it if it does not exist."""
        if self.recorder is not None and self.recorder.write(self, key, value, declared):
            return
        if value is None:
            raise BlackboardError(f"None can't be written to '{key}'")
        value = to_builtin_number(value)
        entry = self._entries.get(key)
        if entry is None:
            self._set_new(key, value, declared)
            return
        entry_type = entry.declared
        if entry_type.strong and not entry_type.accepts(value):
            if not isinstance(value, str) or entry.inferred:
                if declared is None or not declared.strong or isinstance(value, str):
                    declared = type_of(value)
                raise self._type_error(key, entry_type, declared)
            try:
                value = entry_type.from_text(value, 3)
            except ConversionError as error:
                raise BlackboardError(f"the entry '{key}' is of type {entry_type.name}: {error}") from error
        entry.put(value, self.now())

    def written_entry(self, key: str) -> Entry:
        """Return the entry that `set` has written."""
        return self._find_or_create(key, ANY, False)

    def declare(self, key: str, declared: ValueType = ANY, only_read: bool = False) -> Entry:
        """Return the entry of *key*. A port does not change the rule for texts of an existing entry.

        Unlike in format 4, *only_read* has no effect: the type of the entry must not be a related class.
        """
        known = self._entries.get(key)
        inferred = known is not None and known.inferred and known.declared.same(declared)
        entry = super().declare(key, declared)
        if inferred:
            entry.inferred = True
        return entry

    def _find_declared(self, key: str) -> Entry | None:
        return self._entries.get(key)

    def _create_entry(self, key: str, declared: ValueType) -> Entry:
        return self._find_or_create(key, declared, False)

    def _find_or_create(self, key: str, declared: ValueType, inferred: bool, value: object = None) -> Entry:
        """Return the entry where the remappings of *key* end, and store it in every scope that they pass."""
        entry = self._entries.get(key)
        if entry is None:
            outer = self._remaps.get(key, key if self.autoremap else None)
            if outer is None:
                entry = Entry(declared, inferred)
            elif self.parent is None:
                raise BlackboardError(f"the key '{key}' is remapped, but its blackboard has no parent")
            else:
                entry = self.parent._find_or_create(outer, declared, inferred)
            self._entries[key] = entry
        elif entry.declared.strong and declared.strong and not entry.declared.same(declared):
            raise self._type_error(key, entry.declared, declared)
        return entry
