"""The blackboard: entries with a type, in scopes that lead to their parents.

There is one blackboard for every subtree. A key is looked up in the scope itself, then where a
remapping or the automatic remapping leads, up to the root; ``@key`` means the root's at once, and a
key that begins with ``_`` never leaves its scope by itself (nodes.md §9).
"""

from collections.abc import Callable, Iterator
from typing import Final, NoReturn, SupportsIndex

from btcore.clock import Clock, SystemClock, now_function
from btcore.errors import BlackboardError, ConversionError
from btcore.suggestions import nearest_name
from btcore.values import (
    ANY,
    DOUBLE,
    FLOAT,
    INT,
    INT64,
    STRING,
    VECTOR_DOUBLE,
    VECTOR_INT,
    ValueType,
    to_builtin_number,
    type_of,
)


class Entry:
    """One value, with its type, the number of writes so far, and the time (ns) of the last.

    *value* is None until the first write. *inferred* tells that *declared* was taken from a
    value that user code gave, and not from a port or a C++ type.
    """

    __slots__ = ("declared", "inferred", "sequence_id", "stamp", "value")

    value: object
    declared: ValueType
    sequence_id: int
    stamp: int
    inferred: bool

    def __init__(self, declared: ValueType, inferred: bool = False) -> None:
        self.value = None
        self.declared = declared
        self.sequence_id = 0
        self.stamp = 0
        self.inferred = inferred

    def put(self, value: object, stamp: int) -> None:
        """Store *value*, written at *stamp* (ns)."""
        self.value = value
        self.sequence_id += 1
        self.stamp = stamp


# What a Python literal may have meant: 3 is also a float, and an integer of any width.
_WIDER: Final[dict[str, tuple[ValueType, ...]]] = {
    INT.name: (INT64, DOUBLE, FLOAT),
    INT64.name: (DOUBLE, FLOAT),
    VECTOR_INT.name: (VECTOR_DOUBLE,),
}


class Blackboard:
    """The entries of one scope. User code reads and writes it like a dict.

    ``blackboard["key"] = value`` types the entry at its first write; from then on values of
    another type are refused, but for numbers that fit exactly and texts that convert. A text leaves
    a new entry untyped, since it may stand for anything.
    """

    parent: "Blackboard | None"
    autoremap: bool
    clock: Clock
    now: Callable[[], int]
    _entries: dict[str, Entry]
    _outside: dict[str, str]

    def __init__(self, parent: "Blackboard | None" = None, clock: Clock | None = None) -> None:
        self.parent = parent
        self.autoremap = False
        if clock is None:
            clock = parent.clock if parent is not None else SystemClock()
        self.clock = clock
        self.now = now_function(clock)
        self._entries = {}
        self._outside = {}

    @property
    def root(self) -> "Blackboard":
        """The outermost scope."""
        board = self
        while board.parent is not None:
            board = board.parent
        return board

    def remap(self, internal: str, external: str) -> None:
        """Let the key *internal* mean the parent's *external*; the first remapping of a key stays."""
        self._outside.setdefault(internal, external)

    def local_entries(self) -> dict[str, Entry]:
        """The entries that are stored in this very scope."""
        return self._entries

    def find(self, key: str) -> Entry | None:
        """The entry that *key* leads to, or None. It may hold no value yet."""
        entry = self._entries.get(key)
        if entry is not None and not key.startswith("@"):
            return entry
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
            outside = board._outside.get(key)
            if outside is not None:
                key = outside
            elif not board.autoremap or key.startswith("_"):
                return None
            board = parent

    def create(self, key: str, declared: ValueType = ANY) -> Entry:
        """The entry that *key* leads to, made where the route ends if there is none.

        Raises BlackboardError when it was declared with another type. That is no fault when either
        type is untyped, nor when the first is a text, which the reader converts.
        """
        if self.parent is None and not self._outside and not self.autoremap and key[:1] != "@":
            # The most frequent case by far: no route to follow.
            entry = self._entries.get(key)
            if entry is None:
                self._entries[key] = entry = Entry(declared)
                return entry
        else:
            entry = self._known(key)
            if entry is None:
                return self._created(key, declared)
        previous = entry.declared
        if not previous.strong or not declared.strong or previous.same(declared) or previous is STRING:
            if entry.inferred and previous.same(declared):
                entry.declared = declared
                entry.inferred = False
            return entry
        if entry.inferred and _widens(previous, declared):
            entry.value = declared.adapt(entry.value)
            entry.declared = declared
            entry.inferred = False
            return entry
        raise self._clash(key, previous, declared)

    def set(self, key: str, value: object, declared: ValueType | None = None) -> None:
        """Write *value* to the entry of *key*, made where the route ends if there is none.

        *declared* is the value's C++ type, where Python's can't tell it. Raises BlackboardError
        when the entry has another type that the value doesn't fit.
        """
        if key.startswith("@"):
            self.root.set(key[1:], value, declared)
            return
        if value is None:
            raise _nothing(key)
        value = to_builtin_number(value)
        entry = self._entries.get(key)
        if entry is None:
            self._set_new(key, value, declared)
            return
        kind = entry.declared
        if not kind.strong:
            entry.declared = declared or type_of(value)
            entry.inferred = declared is None
        elif not kind.accepts(value):
            value = self._fitted(key, kind, value)
        entry.put(value, self.now())

    def get(self, key: str) -> object:
        """The value of *key*. Raises BlackboardError where there is no such entry, or no value yet."""
        entry = self.find(key)
        if entry is None:
            raise BlackboardError(f"there is no entry '{key}' on the blackboard{self.hint(key)}")
        if entry.value is None:
            raise BlackboardError(f"the entry '{key}' is declared but was never written")
        return entry.value

    def unset(self, key: str) -> None:
        """Forget the entry *key* of this very scope, type and all; nothing happens if there is none."""
        self._entries.pop(key, None)

    def clone_into(self, other: "Blackboard") -> None:
        """Make *other*'s entries those of this scope; its remappings stay as they are."""
        for key in [key for key in other._entries if key not in self._entries]:
            del other._entries[key]
        now = other.now()
        for key, entry in self._entries.items():
            known = other._entries.get(key)
            if known is None:
                copy = Entry(entry.declared, entry.inferred)
                copy.value = entry.value
                other._entries[key] = copy
            else:
                known.declared = entry.declared
                known.inferred = entry.inferred
                known.put(entry.value, now)

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        raise TypeError("a blackboard is part of its tree: clone_into() copies its entries into another one")

    def visible_keys(self) -> list[str]:
        """Every key that :meth:`find` finds from here without an ``@``, sorted."""
        keys = set(self._entries)
        if self.parent is not None:
            seen = self.parent.visible_keys()
            keys.update(inside for inside, outside in self._outside.items() if outside in seen)
            if self.autoremap:
                keys.update(key for key in seen if not key.startswith("_"))
        return sorted(keys)

    def hint(self, key: str) -> str:
        """The end of a sentence that misses *key*: the nearest key that there is."""
        found = nearest_name(key, self.visible_keys())
        return f"; did you mean '{found}'?" if found else ""

    def __getitem__(self, key: str) -> object:
        return self.get(key)

    def __setitem__(self, key: str, value: object) -> None:
        self.set(key, value)

    def __delitem__(self, key: str) -> None:
        if key not in self._entries:
            raise BlackboardError(
                f"there is no entry '{key}' in this scope of the blackboard{self.hint(key)}"
            )
        self.unset(key)

    def __contains__(self, key: object) -> bool:
        entry = self.find(key) if isinstance(key, str) else None
        return entry is not None and entry.value is not None

    def __iter__(self) -> Iterator[str]:
        return iter([key for key, entry in self._entries.items() if entry.value is not None])

    def _known(self, key: str) -> Entry | None:
        """The entry whose type a declaration of *key* must agree with."""
        return self.find(key)

    def _created(self, key: str, declared: ValueType) -> Entry:
        """A new entry where the route of *key* ends."""
        if not key.startswith("@"):
            return self._route(key, declared, False)
        bare = key[1:]
        if "@" in bare:
            raise BlackboardError(f"the key '{key}' has more than one '@'; the first means the root's")
        return self.root._route(bare, declared, False)

    def _set_new(self, key: str, value: object, declared: ValueType | None) -> None:
        """Write a key that isn't stored here: where the route ends, the value must be of the type."""
        kind = declared or type_of(value)
        if kind is STRING and declared is None:
            kind = ANY
        entry = self._route(key, kind, declared is None and kind.strong, value)
        entry.put(value, self.now())

    def _route(self, key: str, declared: ValueType, inferred: bool, value: object = None) -> Entry:
        """The entry where the remappings of *key* end, made there if there is none.

        Unlike :meth:`find`, an ``@`` that a remapping brings in is taken for a part of the key.
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
                    raise board._clash(key, previous, declared)
                return entry
            outside = board._outside.get(key)
            if outside is None and (not board.autoremap or key.startswith("_")):
                entry = Entry(declared, inferred)
                board._entries[key] = entry
                return entry
            if board.parent is None:
                raise BlackboardError(f"the key '{key}' is remapped, but its blackboard has no parent")
            if outside is not None:
                key = outside
            board = board.parent

    def _fitted(self, key: str, kind: ValueType, value: object) -> object:
        """*value* as the entry's type *kind* has it."""
        try:
            if isinstance(value, str) and kind.converts:
                return kind.from_text(value)
            return kind.adapt(value)
        except ConversionError as fault:
            raise BlackboardError(
                f"the entry '{key}' is of type {kind.name}, and once declared its type stays: {fault}"
            ) from fault

    def _clash(self, key: str, previous: ValueType, declared: ValueType) -> BlackboardError:
        return BlackboardError(
            f"the entry '{key}' is of type {previous.name}, and is used as {declared.name} elsewhere; "
            "once declared, its type stays"
        )


def _nothing(key: str) -> BlackboardError:
    return BlackboardError(f"None can't be written to '{key}'; unset() removes an entry")


def _widens(previous: ValueType, declared: ValueType) -> bool:
    return any(wider.same(declared) for wider in _WIDER.get(previous.name, ()))
