"""The blackboard: typed entries in scopes, which may have a parent.

Every subtree has its own scope. A key is looked up in the scope itself, then in the parent if the key is
remapped or the scope has automatic remapping, and so on up to the root. `@key` is looked up in the root
scope. A key that begins with `_` is not remapped automatically (BehaviorTree.CPP, src/blackboard.cpp).
"""

import reprlib
from collections.abc import Callable, ItemsView, Iterator, KeysView, Mapping, Sequence, ValuesView
from copy import deepcopy
from typing import Any, Final, NoReturn, SupportsIndex, TypeVar, cast, get_origin, overload

from btcore.clock import FAST_NOW, Clock, SystemClock
from btcore.errors import BlackboardError, ConversionError, MissingEntryError
from btcore.suggestions import did_you_mean
from btcore.values import (
    ANY,
    DOUBLE,
    FLOAT,
    INT,
    INT64,
    STRING,
    VECTOR_DOUBLE,
    VECTOR_INT,
    IntegerType,
    RealType,
    TypeRegistry,
    UserType,
    ValueType,
    number_of,
    to_builtin_number,
    type_of,
)

T = TypeVar("T")
D = TypeVar("D")
_NOT_GIVEN: Final = object()


class Entry:
    """A value on the blackboard, with its type.

    Attributes:
        value: The value; None before the first write.
        declared: The type of the entry.
        inferred: Whether *declared* was inferred from a value written by user code, and not from a port.
        sequence_id: The number of writes.
        stamp: The time (ns) of the last write.
        value_type: The type of the value, if it is not *declared*: BehaviorTree.CPP stores it with the value,
            and compares it when SetBlackboard copies the entry. None = *declared*, or in an entry without a
            type, the type that follows from the value.

    Examples:
        >>> import btcore
        >>> board = btcore.Blackboard()
        >>> board["speed"] = 0.5
        >>> entry = board.find("speed")
        >>> entry.value, entry.declared.name, entry.sequence_id
        (0.5, 'double', 1)
    """

    __slots__ = ("declared", "inferred", "sequence_id", "stamp", "value", "value_type")

    def __init__(self, declared: ValueType, inferred: bool = False) -> None:
        self.value: object = None
        self.declared = declared
        self.sequence_id = 0
        self.stamp = 0
        self.inferred = inferred
        self.value_type: ValueType | None = None

    def type_of_value(self) -> ValueType:
        """Return the type of the value, which must not be None: `value_type`, or the type it stands for."""
        if self.value_type is not None:
            return self.value_type
        return self.declared if self.declared.strong else type_of(self.value)

    def put(self, value: object, stamp: int) -> None:
        """Store a value, and count the write.

        Args:
            value: The value. Its type is not checked.
            stamp: The time of the write (ns, the blackboard's clock).
        """
        self.value = value
        self.sequence_id += 1
        self.stamp = stamp


# The types to which an inferred type may change: a Python int may stand for a float or a wider integer.
_WIDER: Final[dict[str, tuple[ValueType, ...]]] = {
    INT.name: (INT64, DOUBLE, FLOAT),
    INT64.name: (DOUBLE, FLOAT),
    VECTOR_INT.name: (VECTOR_DOUBLE,),
}


class WriteRecorder:
    """What records the writes of a blackboard's users: `btcore.engine.journal.Journal`."""

    def write(self, board: "Blackboard", key: str, value: object, declared: ValueType | None) -> bool:
        """Set an entry and record it. Return False, without effect, if the write is not to be recorded.

        The entry is set by `Blackboard.set`, which calls this method again: the inner call returns False.
        """
        raise NotImplementedError

    def remove(self, board: "Blackboard", key: str) -> bool:
        """Remove an entry and record it. Return False, without effect, if this is not to be recorded."""
        raise NotImplementedError

    def add_entries(self, board: "Blackboard") -> None:
        """Record all entries of a scope, which were replaced."""
        raise NotImplementedError

    def begin_script(self, board: "Blackboard", text: str, enums: Mapping[str, int]) -> bool:
        """Record that a script is run, up to `end_script`. Return False if this is not to be recorded."""
        raise NotImplementedError

    def end_script(self) -> None:
        """End the effect of `begin_script`, which has returned True."""
        raise NotImplementedError


class Blackboard:
    """One scope of entries. User code reads and writes it like a dict, and it is a Mapping.

    Looking up a key follows the remappings of the scope. The length and the iteration cover the written
    entries of the scope itself, in the order of their creation.

    The first write, `blackboard["key"] = value`, determines the type of the entry. Later writes of another
    type raise BlackboardError, except numbers that fit exactly and texts that convert. An entry that is first
    written with a text stays untyped, because the text may stand for a value of any type.

    Args:
        parent: The enclosing scope; None = this is a root scope.
        clock: The clock of the time stamps; by default the parent's clock, else the system's.

    Attributes:
        autoremap: Whether keys without a remapping name the parent's entries.
        now: The function that returns the time of the clock (ns).
        recorder: Records the writes of users, or None.

    Examples:
        >>> from btcore import Blackboard
        >>> board = Blackboard()
        >>> board["battery"] = 0.8
        >>> board["battery"], "goal" in board, dict(board)
        (0.8, False, {'battery': 0.8})
    """

    def __init__(self, parent: "Blackboard | None" = None, clock: Clock | None = None) -> None:
        self.parent = parent
        self.autoremap = False
        if clock is None:
            clock = parent.clock if parent is not None else SystemClock()
        self.clock: Clock = clock
        self.now: Callable[[], int] = FAST_NOW.get(type(clock), clock.now)
        self.recorder: WriteRecorder | None = None
        self._entries: dict[str, Entry] = {}
        # The keys of the parent to which keys of this scope are remapped.
        self._remaps: dict[str, str] = {}

    @property
    def root(self) -> "Blackboard":
        """The outermost scope."""
        board = self
        while board.parent is not None:
            board = board.parent
        return board

    def remap(self, internal: str, external: str) -> None:
        """Remap a key of this scope to a key of the parent, unless it is already remapped.

        Args:
            internal: The key in this scope.
            external: The key in the parent scope.
        """
        self._remaps.setdefault(internal, external)

    def remappings(self) -> Mapping[str, str]:
        """Return the keys of the parent to which keys of this scope are remapped."""
        return self._remaps

    def local_entries(self) -> dict[str, Entry]:
        """Return the entries that are stored in this scope itself."""
        return self._entries

    def find(self, key: str) -> Entry | None:
        """Return the entry of *key* after remapping, or None. The entry may never have been written."""
        board = self
        while True:
            if key.startswith("@"):
                return board.root._entries.get(key.lstrip("@"))
            entry = board._entries.get(key)
            if entry is not None:
                return entry
            parent = board.parent
            if parent is None:
                return None
            external = board._remaps.get(key)
            if external is not None:
                key = external
            elif not board.autoremap or key.startswith("_"):
                return None
            board = parent

    def declare(self, key: str, declared: ValueType = ANY, only_read: bool = False) -> Entry:
        """Return the entry of *key* after remapping, for values of a type. It is created if it is missing.

        Args:
            key: The key.
            declared: The type that the caller needs.
            only_read: Whether the caller reads the entry and never writes it. Then the type of the entry may
                also be a base class or a derived class, whose objects are checked when they are read.

        Raises:
            BlackboardError: The entry has another type. There is no error if one of the types is ANY, if the
                entry is a string, which is converted when it is read, or if its inferred type may change.
            ConversionError: The inferred type of the entry may change, but its value does not fit *declared*.
        """
        if self.parent is None and not self._remaps and not self.autoremap and key[:1] != "@":
            # By far the most frequent case: no remapping to follow.
            entry = self._entries.get(key)
            if entry is None:
                self._entries[key] = entry = Entry(declared)
                return entry
        else:
            entry = self._find_declared(key)
            if entry is None:
                return self._create_entry(key, declared)
        previous = entry.declared
        if not previous.strong or not declared.strong or previous.same(declared) or previous is STRING:
            if entry.inferred and previous.same(declared):
                entry.declared = declared
                entry.inferred = False
            return entry
        if entry.inferred and any(wider.same(declared) for wider in _WIDER.get(previous.name, ())):
            entry.value = declared.adapt(entry.value)
            entry.declared = declared
            entry.inferred = False
            entry.value_type = None
            return entry
        if only_read and previous.is_related(declared):
            return entry
        raise self._type_error(key, previous, declared)

    def set(self, key: str, value: object, declared: ValueType | None = None) -> None:
        """Write *value* to the entry of *key* after remapping. Create it if it does not exist.

        Args:
            key: The key.
            value: The value, not None.
            declared: The C++ type of the value, if it does not follow from the Python type.

        Raises:
            BlackboardError: The value does not fit the type of the entry, or is None.
        """
        if self.recorder is not None and self.recorder.write(self, key, value, declared):
            return
        if key.startswith("@"):
            self.root.set(key[1:], value, declared)
            return
        if value is None:
            raise BlackboardError(f"None can't be written to '{key}'; unset() removes an entry")
        value = to_builtin_number(value)
        entry = self._entries.get(key)
        if entry is None:
            self._set_new(key, value, declared)
            return
        entry_type = entry.declared
        if not entry_type.strong:
            entry.declared = declared or type_of(value)
            entry.inferred = declared is None
            entry.value_type = None
        elif entry.value_type is not None or not entry_type.accepts(value):
            value = self._convert_to_entry(key, entry, value)
        entry.put(value, self.now())

    def written_entry(self, key: str) -> Entry:
        """Return the entry that `set` has written. For an `@` in a remapping, `find` may return another."""
        if key.startswith("@"):
            return self.root.written_entry(key[1:])
        return self._find_or_create(key, ANY, False)

    @overload
    def get(self, key: str) -> object: ...
    @overload
    def get(self, key: str, result_type: type[T]) -> T: ...
    @overload
    def get(self, key: str, result_type: type[T], default: D) -> T | D: ...
    @overload
    def get(self, key: str, default: object, /) -> object: ...
    @overload
    def get(self, key: str, *, default: object) -> object: ...
    def get(self, key: str, result_type: object = None, default: object = _NOT_GIVEN) -> object:
        """Return the value of an entry: as in a dict, or as a value of a type.

        `get("speed")` and `get("speed", 0.5)` return None or the default if the entry is missing or was
        never written. `get("speed", float)` raises then, `get("speed", float, 0.5)` does not.

        Args:
            key: The key.
            result_type: The class of the result, or a type such as `list[float]`. The value is converted as
                by an input port of the type. Any other second argument is the default.
            default: The result for an entry that is missing or was never written.

        Raises:
            MissingEntryError: The entry is missing or was never written, and only a type is given.
            BlackboardError: The value cannot be converted to the type.
        """
        is_typed = isinstance(result_type, (type, ValueType)) or get_origin(result_type) is not None
        entry = self.find(key)
        if entry is None or entry.value is None:
            if default is not _NOT_GIVEN:
                return default
            if is_typed:
                raise self._missing_entry_error(key, entry)
            return result_type
        return _convert_to_type(key, entry.value, result_type) if is_typed else entry.value

    def unset(self, key: str) -> None:
        """Remove the entry *key*, with its type, from this scope itself, if there is such an entry."""
        if self.recorder is not None and self.recorder.remove(self, key):
            return
        self._entries.pop(key, None)

    def clone_into(self, other: "Blackboard") -> None:
        """Make the entries of *other* a copy of the entries of this scope. The remappings of *other* stay."""
        for key in [key for key in other._entries if key not in self._entries]:
            del other._entries[key]
        now = other.now()
        for key, entry in self._entries.items():
            known = other._entries.get(key)
            if known is None:
                known = other._entries[key] = Entry(entry.declared, entry.inferred)
                known.value = entry.value
            else:
                known.declared = entry.declared
                known.inferred = entry.inferred
                known.put(entry.value, now)
            known.value_type = entry.value_type
        if other.recorder is not None:
            other.recorder.add_entries(other)

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        raise TypeError("a blackboard cannot be copied or pickled; clone_into() copies its entries")

    def visible_keys(self) -> list[str]:
        """Return all keys without `@` for which `find` returns an entry, sorted."""
        keys = set(self._entries)
        if self.parent is not None:
            keys_of_parent = self.parent.visible_keys()
            keys.update(internal for internal, external in self._remaps.items() if external in keys_of_parent)
            if self.autoremap:
                keys.update(key for key in keys_of_parent if not key.startswith("_"))
        return sorted(keys)

    def hint(self, key: str) -> str:
        """Return the end of an error message about an unknown *key*: the most similar visible key, or ""."""
        return did_you_mean(key, self.visible_keys())

    def __getitem__(self, key: str) -> object:
        entry = self.find(key)
        if entry is None or entry.value is None:
            raise self._missing_entry_error(key, entry)
        return entry.value

    def __setitem__(self, key: str, value: object) -> None:
        self.set(key, value)

    def __delitem__(self, key: str) -> None:
        if key not in self._entries:
            raise MissingEntryError(
                f"there is no entry '{key}' in this scope of the blackboard{self.hint(key)}"
            )
        self.unset(key)

    def __contains__(self, key: object) -> bool:
        entry = self.find(key) if isinstance(key, str) else None
        return entry is not None and entry.value is not None

    def __iter__(self) -> Iterator[str]:
        return iter([key for key, entry in self._entries.items() if entry.value is not None])

    def __len__(self) -> int:
        return sum([entry.value is not None for entry in self._entries.values()])

    def __bool__(self) -> bool:
        # Also without entries, so that `blackboard or Blackboard()` keeps a shared blackboard.
        return True

    def keys(self) -> KeysView[str]:
        """Return a view of the keys of the written entries of this scope itself."""
        return KeysView(cast(Mapping[str, object], self))

    def values(self) -> ValuesView[object]:
        """Return a view of the values of this scope itself."""
        return ValuesView(cast(Mapping[str, object], self))

    def items(self) -> ItemsView[str, object]:
        """Return a view of the keys and values of this scope itself."""
        return ItemsView(cast(Mapping[str, object], self))

    def __repr__(self) -> str:
        shown = reprlib.Repr()
        shown.maxstring = shown.maxother = 80
        values = [f"{shown.repr(key)}: {shown.repr(self[key])}" for key in list(self)[:20]]
        more = len(self) - len(values)
        return f"<Blackboard {{{', '.join(values)}{f', … and {more} more' if more else ''}}}>"

    def _missing_entry_error(self, key: str, entry: Entry | None) -> MissingEntryError:
        problem = f"the entry '{key}' is declared but was never written"
        if entry is None:
            problem = f"there is no entry '{key}' on the blackboard{self.hint(key)}"
        error = MissingEntryError(problem)
        error.unwritten_key = key
        return error

    def _find_declared(self, key: str) -> Entry | None:
        """Return the entry whose type must agree with a new declaration of *key*, or None."""
        return self.find(key)

    def _create_entry(self, key: str, declared: ValueType) -> Entry:
        if not key.startswith("@"):
            return self._find_or_create(key, declared, False)
        bare = key[1:]
        if "@" in bare:
            raise BlackboardError(f"the key '{key}' has more than one '@'; only the first means the root")
        return self.root._find_or_create(bare, declared, False)

    def _set_new(self, key: str, value: object, declared: ValueType | None) -> None:
        """Write a key that is not stored in this scope itself."""
        entry_type = declared or type_of(value)
        if entry_type is STRING and declared is None:
            entry_type = ANY
        entry = self._find_or_create(key, entry_type, declared is None and entry_type.strong, value)
        entry.value_type = (
            None if declared is None or not declared.strong or declared is entry.declared else declared
        )
        entry.put(value, self.now())

    def _find_or_create(self, key: str, declared: ValueType, inferred: bool, value: object = None) -> Entry:
        """Return the entry at the end of the remappings of *key*; create it if it does not exist.

        Unlike in `find`, an `@` in a remapped key is a part of the key.
        """
        board = self
        while True:
            entry = board._entries.get(key)
            if entry is not None:
                previous = entry.declared
                if (
                    previous.strong
                    and declared.strong
                    and not previous.same(declared)
                    and (value is None or not previous.accepts(value))
                ):
                    raise board._type_error(key, previous, declared)
                return entry
            external = board._remaps.get(key)
            if external is None and (not board.autoremap or key.startswith("_")):
                entry = Entry(declared, inferred)
                board._entries[key] = entry
                return entry
            if board.parent is None:
                raise BlackboardError(f"the key '{key}' is remapped, but its blackboard has no parent")
            if external is not None:
                key = external
            board = board.parent

    def _convert_to_entry(self, key: str, entry: Entry, value: object) -> object:
        """Return *value* converted to the type of *entry*, and then to the type of the number that it holds.

        A number that a script has written first keeps its type, as in BehaviorTree.CPP: an entry of doubles
        may hold an integer, which no fraction can replace, and an entry of integers a double.
        """
        declared = entry.declared
        if value is False and isinstance(declared, IntegerType) and declared.low < 0:
            # BehaviorTree.CPP considers true to be a safe value for signed integers, but not false.
            raise BlackboardError(
                f"the entry '{key}' has the type {declared.name}, which cannot change to bool: "
                "write 0, not False"
            )
        held = entry.value_type
        try:
            if isinstance(value, str) and declared.converts and not declared.accepts(value):
                fitted = declared.from_text(value)
            else:
                fitted = declared.adapt(value)
        except ConversionError as error:
            raise BlackboardError(
                f"the entry '{key}' has the type {declared.name}, which cannot change: {error}"
            ) from error
        if held is None or number_of(entry.value) is None:
            return fitted
        number = number_of(fitted)
        try:
            return (DOUBLE if isinstance(held, RealType) else INT64).adapt(
                fitted if number is None else number
            )
        except ConversionError as error:
            raise BlackboardError(
                f"the entry '{key}' holds a number of the type {held.name}, which a script has written: "
                f"it cannot be replaced by {fitted!r}: {error}"
            ) from error

    def _type_error(self, key: str, previous: ValueType, declared: ValueType) -> BlackboardError:
        return BlackboardError(
            f"the type of the entry '{key}' cannot change from {previous.name} to {declared.name}"
        )


Mapping.register(Blackboard)  # not a base class: mypyc compiles only classes with compiled bases


def copy_scopes(scopes: Sequence[Blackboard]) -> list[Blackboard]:
    """Return a copy of each scope, with copies of the values but without parents and remappings.

    Values that refer to the same object do so in the copies, too. A value that cannot be copied, such as a
    lock or a connection, is shared.
    """
    copies: list[Blackboard] = []
    known: dict[int, Any] = {}
    for scope in scopes:
        board = Blackboard(clock=scope.clock)
        scope.clone_into(board)
        for entry in board.local_entries().values():
            try:
                entry.value = deepcopy(entry.value, known)
            except Exception:
                continue
        copies.append(board)
    return copies


def _convert_to_type(key: str, value: object, result_type: Any) -> object:
    if type(value) is result_type:
        return value
    # A Python int has no size: only ports restrict it to 32 bits.
    value_type = INT64 if result_type is int else TypeRegistry().of(result_type)
    try:
        if isinstance(value, str) and not isinstance(value_type, UserType):
            return value_type.from_text(value)
        return value_type.cast(value)
    except ConversionError as error:
        raise BlackboardError(
            f"the entry '{key}' holds {reprlib.repr(value)}, not {value_type.name}: {error}"
        ) from error
