"""The state of a tree as one hashable value: all that decides what it may do from now on.

It consists of the statuses, the attributes that the classes of the nodes declare in `spec.state_fields`, the
blackboards and the pending timers, in a form that is equal for equal futures: numbers that only grow, such as
counts of writes, are numbered anew, and times are replaced by what is known of their order.
"""

from collections import deque
from collections.abc import Callable, Collection, Hashable, Sequence
from enum import Enum
from inspect import get_annotations
from operator import itemgetter
from struct import pack, unpack
from types import BuiltinFunctionType, FunctionType, ModuleType
from typing import Any, Final, NamedTuple

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.clock import NS_PER_S, SimClock
from btcore.engine.node import TreeNode
from btcore.engine.node_spec import declared_fields
from btcore.errors import NodeError
from btcore.nodes.entry_updates import EntryUpdatedDecorator, WasEntryUpdated
from btcore.nodes.repeat import RepeatedNode
from btcore.status import Status
from btcore.suggestions import join_names
from btcore.tree.tree import Tree, scopes_of
from btcore_proof.interrupts import OpaqueStateError
from btcore_proof.model_leaves import UnknownValue
from btcore_proof.tick_times import FIRST_PENDING_NS, READING_INTERVAL_NS, TICK_START_NS, TickClock
from btcore_proof.timer_order import (
    NO_TIMERS,
    Advance,
    Bounds,
    advances,
    after_any_time,
    with_timer,
    without_timers,
)

_EXPIRED_NS: Final = TICK_START_NS
"""The deadline of every timer that has expired before a tick."""

SHIFT_S: Final = 10**7
"""The time (s) between a tick and its repetition: longer than any duration in a tree."""
_SHIFT_NS: Final = SHIFT_S * NS_PER_S
SHIFTED_WRITES: Final = 10**6
"""The number by which numbers of writes are greater when a tick is repeated."""
_OPAQUE: Final = ", which cannot be copied and compared"


class TreeState(NamedTuple):
    """The state of a tree between two ticks.

    Attributes:
        statuses: The status of each node.
        fields: The state fields of each node that has any.
        boards: The entries of each blackboard scope: keys, and numbers of entries.
        entries: The type, the value and the number of writes of each entry.
        objects: The contents of mutable values, to which values refer by number.
        timers: The bounds of the remaining times of all pending timers.
    """

    statuses: bytes
    fields: tuple[tuple[Any, ...], ...]
    boards: tuple[tuple[tuple[str, int], ...], ...]
    entries: tuple[tuple[Any, ...], ...]
    objects: tuple[Any, ...]
    timers: Bounds


_STATUSES: Final = tuple(Status)
"""The status of each number in `TreeState.statuses`."""


# The tags make sure that objects of different classes are not equal, although all of them are tuples.


_first: Final = itemgetter(0)


class _Reference(NamedTuple):
    """Stands for a mutable object: its number among the objects of the state."""

    number: int
    tag: str = "reference"


class _Timer(NamedTuple):
    """Stands for the deadline of a timer: its number in the bounds; -1 = it has expired."""

    number: int
    tag: str = "timer"


class _Typed(NamedTuple):
    """Stands for a value that may be equal to a value of another type, as True and 1 are."""

    cls: type
    value: object


class _Float(NamedTuple):
    """Stands for a zero with its sign, or for a NaN."""

    bits: bytes
    tag: str = "float"


class _Items(NamedTuple):
    """Stands for a tuple or a set."""

    cls: type
    items: tuple[Hashable, ...] | frozenset[Hashable]


def state_fields_of(cls: type[TreeNode]) -> list[str]:
    """Return the attributes that *cls* and its base classes declare as state, sorted."""
    return sorted(cls.spec.state_fields or ())


def check_state_declaration(node: TreeNode) -> None:
    """Raise NodeError if *node* has attributes of a user's class, but no such class declares its state."""
    classes = [cls for cls in type(node).__mro__ if issubclass(cls, TreeNode)]
    engine = [cls for cls in classes if vars(cls)["__module__"].startswith("btcore.")]
    users = [cls for cls in classes if cls not in engine]
    if not users or any("state_fields" in declared_fields(cls) for cls in users):
        return
    known = {name for cls in engine for name in get_annotations(cls)}
    unknown = sorted(set(getattr(node, "__dict__", ())) - known)
    if unknown:
        raise NodeError(
            f"the state of '{node.config.path}' <{node.config.id}> cannot be saved: "
            f"{classes[0].__qualname__} does not declare which of its attributes change between ticks "
            f'({join_names(unknown)}): write for example spec = NodeSpec(state_fields=("{unknown[0]}",)), '
            "or state_fields=() if none does"
        )


class StateKeeper:
    """Captures and restores the state of one tree.

    Args:
        tree: The tree, whose clock must stand at `TICK_START_NS`.
        instant: Whether ticks take no time.

    Attributes:
        clock: The clock of the tree's nodes.
        timer_slots: The nodes with time fields, and the names of these fields.
        shared: The ids of objects that are the same in every state.

    Raises:
        NodeError: The state of a node of the tree cannot be saved.
    """

    def __init__(self, tree: Tree, instant: bool = False) -> None:
        self._tree = tree
        self._instant = instant
        self.clock = TickClock(tree)
        self._boards: list[Blackboard] = scopes_of(tree)
        self._nodes = list(tree.nodes)
        self._with_fields: list[tuple[TreeNode, list[str], frozenset[str]]] = []
        self._watchers: list[tuple[int, EntryUpdatedDecorator | WasEntryUpdated]] = []
        self._endless: set[int] = set()
        self._fields: dict[int, list[str]] = {}
        # The state of which the entries were restored last, its entries, and their values.
        self._restored: tuple[TreeState, list[Entry], list[object]] | None = None
        self.timer_slots: list[tuple[TreeNode, str]] = []
        self.shared: Collection[int] = ()
        self._is_shifted = False
        for node in tree.nodes:
            check_state_declaration(node)
            if node.spec.state_fields is None:
                raise NodeError(
                    f"the state of '{node.config.path}' <{node.config.id}> cannot be saved while it is "
                    "RUNNING, so that nothing can be proved about it"
                )
            fields = state_fields_of(type(node))
            self._fields[node.config.uid] = fields
            if not fields:
                continue
            index = len(self._with_fields)
            self._with_fields.append((node, fields, frozenset(node.spec.time_fields)))
            self.timer_slots += [(node, name) for name in node.spec.time_fields]
            if isinstance(node, (EntryUpdatedDecorator, WasEntryUpdated)):
                self._watchers.append((index, node))
            if isinstance(node, RepeatedNode):
                limit = node.config.inputs.get(node.limit_port)
                if limit is not None and limit.key is None and limit.literal == -1:
                    self._endless.add(index)

    def advances(self, state: TreeState) -> list[Advance]:
        """Return what may have happened to the timers of *state* before the next tick."""
        return advances(state.timers)

    def restore(self, state: TreeState, advance: Advance, shift: bool = False) -> None:
        """Put the tree into *state*, after *advance*.

        Args:
            advance: The advance of the timers.
            shift: Whether to change what is not a part of the state: the time, and the numbers of writes.
                Only code that looks at them by other means than the state provides notices the change.
        """
        if shift is not self._is_shifted:
            self._is_shifted = shift
            assert isinstance(self.clock.replaced, SimClock)
            self.clock.replaced.advance(SHIFT_S if shift else -SHIFT_S)
            self._restored = None
        thaw = _Thawer(state.objects).thaw
        expired = set(advance.expired)
        numbers: dict[int, int] = {}
        for number in range(len(state.timers) - 1):
            if number not in expired:
                numbers[number] = FIRST_PENDING_NS + len(numbers)
        for node, status in zip(self._nodes, state.statuses, strict=True):
            node._status = _STATUSES[status]
        for (node, fields, _), values in zip(self._with_fields, state.fields, strict=True):
            for name, value in zip(fields, values, strict=True):
                cls = type(value)
                if cls is _Timer:
                    value = numbers.get(value.number, _EXPIRED_NS)
                elif cls not in _PLAIN:
                    value = thaw(value)
                setattr(node, name, value)
        if not self._has_entries_of(state):
            self._restore_entries(state, thaw)
        if shift:
            self._shift_writes()
        context = self._tree.context
        context.deadlines.clear()
        if context.is_woken:
            context.consume_wake_up()
        self.clock.begin_in_search(TICK_START_NS + _SHIFT_NS if shift else TICK_START_NS, self._instant)

    def _restore_entries(self, state: TreeState, thaw: Callable[[Any], Any]) -> None:
        entries: list[Entry] = []
        for declared, inferred, value, writes, value_type in state.entries:
            entry = Entry(declared, inferred)
            entry.value_type = value_type
            entry.value = value if type(value) in _PLAIN else thaw(value)
            entry.sequence_id = writes
            entries.append(entry)
        for board, keys in zip(self._boards, state.boards, strict=True):
            held = board.local_entries()
            held.clear()
            for key, number in keys:
                held[key] = entries[number]
        self._restored = None if state.objects else (state, entries, [entry.value for entry in entries])

    def _shift_writes(self) -> None:
        """Increase the numbers of writes of the entries that no built-in node counts."""
        counted = {id(node._blackboard.find(node._key)) for _, node in self._watchers}
        entries = {id(entry): entry for board in self._boards for entry in board.local_entries().values()}
        for number, entry in entries.items():
            if number not in counted:
                entry.sequence_id += SHIFTED_WRITES
        self._restored = None

    def _has_entries_of(self, state: TreeState) -> bool:
        """Return whether the blackboards are as they were restored, with the entries of *state*."""
        if self._restored is None:
            return False
        restored, entries, values = self._restored
        if restored.entries is not state.entries or restored.boards is not state.boards:
            return False
        for entry, value, row in zip(entries, values, state.entries, strict=True):
            declared, inferred, _, writes, value_type = row
            if (
                entry.sequence_id != writes
                or entry.value is not value
                or entry.declared is not declared
                or entry.inferred is not inferred
                or entry.value_type is not value_type
            ):
                return False
        for board, keys in zip(self._boards, state.boards, strict=True):
            held = board.local_entries()
            if len(held) != len(keys):
                return False
            for key, number in keys:
                if held.get(key) is not entries[number]:
                    return False
        return True

    def kept_timers(self) -> int:
        """Return a bit for each time field whose timer was pending before the last tick and still is."""
        bits = 0
        for number, (node, name) in enumerate(self.timer_slots):
            if getattr(node, name) >= FIRST_PENDING_NS:
                bits |= 1 << number
        return bits

    def fields_of(self, node: TreeNode) -> tuple[Hashable, ...]:
        """Return the present state fields of one node.

        Raises:
            OpaqueStateError: A field cannot be copied and compared.
        """
        freezer = Freezer(self.shared)
        row: list[Hashable] = []
        for name in self._fields[node.config.uid]:
            value = getattr(node, name)
            if self._is_shifted and name in node.spec.time_fields:
                value = _unshift_time(value)
            row.append(freezer.freeze(value))
        return (*row, freezer.objects())

    def entries(self) -> Hashable:
        """Return the present entries of all blackboards."""
        freezer = Freezer()
        numbers: dict[int, int] = {}
        boards = [
            tuple(
                [
                    (
                        key,
                        numbers.setdefault(id(entry), len(numbers)),
                        freezer.freeze(entry.value),
                        entry.sequence_id % SHIFTED_WRITES,
                    )
                    for key, entry in board.local_entries().items()
                ]
            )
            for board in self._boards
        ]
        return (tuple(boards), freezer.objects())

    def deadlines(self) -> list[int]:
        """Return the deadlines of all pending timers, each once, in the order of the bounds of the state.

        Those from `FIRST_PENDING_NS` on were pending before the last tick already, in this order.
        """
        values = [getattr(node, name) for node, name in self.timer_slots]
        if self._is_shifted:
            values = [_unshift_time(value) for value in values]
        return list(dict.fromkeys(value for value in values if value > TICK_START_NS))

    def capture(self, timers: Bounds = NO_TIMERS) -> TreeState:
        """Return the state of the tree.

        Args:
            timers: The bounds of the timers that were pending in this tick.

        Raises:
            OpaqueStateError: A part of the state cannot be copied and compared.
        """
        try:
            return self._capture_state(timers)
        except OpaqueStateError:
            raise self._opaque_part() from None

    def _capture_state(self, timers: Bounds) -> TreeState:
        freezer = Freezer(self.shared)
        rows: list[list[Any]] = []
        deadlines = self.deadlines() if self.timer_slots else []
        numbers_of_deadlines = {deadline: number for number, deadline in enumerate(deadlines)}
        for index, (node, fields, times) in enumerate(self._with_fields):
            row: list[Any] = []
            for name in fields:
                value = getattr(node, name)
                if name in times:
                    if self._is_shifted:
                        value = _unshift_time(value)
                    if value > TICK_START_NS:
                        value = _Timer(numbers_of_deadlines[value])
                    elif value > 0:
                        value = _Timer(-1)
                elif index in self._endless and name == "_count":
                    value = 0
                else:
                    value = freezer.freeze(value)
                row.append(value)
            rows.append(row)
        boards, entries = self._capture_entries(freezer, rows)
        return TreeState(
            bytes([node._status for node in self._nodes]),
            tuple(map(tuple, rows)),
            boards,
            entries,
            freezer.objects(),
            _timer_bounds(timers, deadlines),
        )

    def _opaque_part(self) -> OpaqueStateError:
        """Return the error that names the first part of the state that cannot be copied and compared."""
        for node, fields, _ in self._with_fields:
            for name in fields:
                try:
                    Freezer(self.shared).freeze(getattr(node, name))
                except OpaqueStateError as error:
                    return OpaqueStateError(
                        f"'{node.config.path}' <{node.config.id}> keeps {error} in '{name}'{_OPAQUE}"
                    )
        for board in self._boards:
            for key, entry in board.local_entries().items():
                try:
                    Freezer(self.shared).freeze(entry.value)
                except OpaqueStateError as error:
                    return OpaqueStateError(f"the entry {{{key}}} holds {error}{_OPAQUE}")
        return OpaqueStateError(f"a part of the state of the tree{_OPAQUE}")

    def differences(self, first: TreeState, second: TreeState) -> list[tuple[TreeNode, str]]:
        """Return the nodes with state fields that differ in two states, and the names of the fields."""
        return [
            (node, name)
            for (node, fields, _), first_row, second_row in zip(
                self._with_fields, first.fields, second.fields, strict=True
            )
            for name, value, now in zip(fields, first_row, second_row, strict=True)
            if value != now
        ]

    def _capture_entries(
        self, freezer: "Freezer", rows: list[list[Any]]
    ) -> tuple[tuple[tuple[tuple[str, int], ...], ...], tuple[tuple[Any, ...], ...]]:
        """Return the boards and the entries. Put the numbers of writes that nodes have seen into *rows*."""
        if not self._watchers and self._restored is not None and self._has_entries_of(self._restored[0]):
            return self._restored[0].boards, self._restored[0].entries
        entries: list[list[Any]] = []
        numbers: dict[int, int] = {}
        captured_entries: list[Entry] = []
        boards: list[tuple[tuple[str, int], ...]] = []
        for board in self._boards:
            keys: list[tuple[str, int]] = []
            # In the order of the keys, not of their creation, on which nothing depends.
            for key, entry in sorted(board.local_entries().items(), key=_first):
                if id(entry) not in numbers:
                    numbers[id(entry)] = len(entries)
                    frozen = freezer.freeze(entry.value)
                    entries.append([entry.declared, entry.inferred, frozen, 0, entry.value_type])
                    captured_entries.append(entry)
                keys.append((key, numbers[id(entry)]))
            boards.append(tuple(keys))
        seen: dict[int, list[tuple[int, int]]] = {}
        for index, node in self._watchers:
            watched = node._blackboard.find(node._key)
            # Without an entry, the count that was seen remains, and is compared with later writes.
            place = numbers.get(id(watched), -1) if watched is not None else -1
            seen.setdefault(place, []).append((index, node._seen))
        for place, watchers in seen.items():
            if place >= 0:
                self._renumber(rows, entries[place], captured_entries[place].sequence_id, watchers)
        return tuple(boards), tuple(map(tuple, entries))

    def _renumber(
        self, rows: list[list[Any]], entry: list[Any], writes: int, watchers: list[tuple[int, int]]
    ) -> None:
        """Replace the number of writes of an entry, and those that nodes have seen, by small numbers.

        Nodes compare them for equality only. A number beyond the present one, which a node has seen before
        the entry was removed, keeps its distance.
        """
        below = sorted({0, writes, *(seen for _, seen in watchers if seen <= writes)})
        entry[3] = below.index(writes)
        for index, seen in watchers:
            fields = self._with_fields[index][1]
            number = below.index(seen) if seen <= writes else entry[3] + seen - writes
            rows[index][fields.index("_seen")] = number


def _unshift_time(value: int) -> int:
    """Return a deadline without the shift of the clock, unless the deadline is from before the tick."""
    return value - _SHIFT_NS if TICK_START_NS + _SHIFT_NS <= value < FIRST_PENDING_NS else value


def _timer_bounds(timers: Bounds, deadlines: Sequence[int]) -> Bounds:
    """Return the bounds of the pending timers, given the values of their deadlines.

    A deadline from `FIRST_PENDING_NS` on is that of a timer that was pending in this tick. Any other is new,
    and contains the reading of the clock at which it was set.
    """
    bounds = timers
    places: dict[int, int] = {}
    last_reading = 0
    for deadline in sorted(deadline for deadline in deadlines if deadline < FIRST_PENDING_NS):
        reading, duration = divmod(deadline - TICK_START_NS, READING_INTERVAL_NS)
        if reading > last_reading:
            bounds = after_any_time(bounds)
            last_reading = reading
        bounds = with_timer(bounds, duration)
        places[deadline] = len(bounds) - 2
    order = [places.get(deadline, deadline - FIRST_PENDING_NS) for deadline in deadlines]
    return without_timers(bounds, order)


class Freezer:
    """Replaces values by hashable ones that are equal only if no code can tell the values apart.

    Mutable objects are replaced by references to copies of their contents, each object once.

    Args:
        shared: The ids of objects that are the same in every state, such as the value of a global variable.
        unknown: Whether a value may be unknown.
    """

    def __init__(self, shared: Collection[int] = (), unknown: bool = True) -> None:
        self._shared = shared
        self._unknown = unknown
        self._numbers: dict[int, int] = {}
        self._objects: list[Any] = []
        # Objects that exist only here: their ids must not be used again.
        self._temporary: list[object] = []
        # The objects of which the arguments are being frozen.
        self._unmade: set[int] = set()

    def freeze(self, value: object) -> Hashable:
        """Return a hashable value that stands for *value*.

        Raises:
            OpaqueStateError: The value cannot be copied and compared.
        """
        cls = type(value)
        if cls in _PLAIN:
            # 1, True, 1.0 and a Status are equal, but nodes and scripts tell them apart.
            if cls is int or cls is str:
                return value
            if cls is float and (value == 0.0 or value != value):
                # -0.0 is equal to 0.0, and NaN is not equal to itself.
                return _Float(pack("d", value))
            return _Typed(cls, value)
        if value is None:
            return None
        if cls is tuple or cls is set or cls is frozenset:
            assert isinstance(value, (tuple, set, frozenset))
            items = [self.freeze(item) for item in value]
            return _Items(cls, tuple(items) if cls is tuple else frozenset(items))
        if cls is UnknownValue and not self._unknown:
            raise OpaqueStateError("an unknown value")
        if cls is UnknownValue or id(value) in self._shared:
            return Identity(value)
        if _is_atom(value, cls):
            return _Typed(cls, value) if cls.__hash__ is not None else Identity(value)
        number = self._numbers.get(id(value))
        if number is None:
            number = self._numbers[id(value)] = len(self._objects)
            self._objects.append(None)
            self._objects[number] = self._contents(number, value, cls)
        elif number in self._unmade:
            raise OpaqueStateError(_describe(cls))
        return _Reference(number)

    def objects(self) -> tuple[Any, ...]:
        """Return the contents of all mutable objects, by number."""
        return tuple(self._objects)

    def _contents(self, number: int, value: object, cls: type) -> Hashable:
        if cls is list or (isinstance(value, deque) and cls is deque and value.maxlen is None):
            assert isinstance(value, (list, deque))
            return (cls, tuple([self.freeze(item) for item in value]))
        if isinstance(value, dict) and cls is dict:
            return (cls, tuple([(self.freeze(key), self.freeze(item)) for key, item in value.items()]))
        try:
            parts = value.__reduce_ex__(4)
        except Exception as error:
            raise OpaqueStateError(_describe(cls)) from error
        if isinstance(parts, str):
            # The name of a global object.
            return Identity(value)
        self._temporary.append(parts)
        make, arguments, state, items, pairs, setter = [*parts, None, None, None, None][:6]
        self._unmade.add(number)
        construction = (self.freeze(make), self.freeze(arguments))
        self._unmade.discard(number)
        held = [None if each is None else tuple(each) for each in (items, pairs)]
        self._temporary.append(held)
        return (None, *construction, *[self.freeze(part) for part in (state, *held, setter)])


def _is_atom(value: object, cls: type) -> bool:
    """Return whether a value is the same object in every state: code, a constant, or a part of the engine."""
    return cls is object or isinstance(value, _CONSTANTS) or cls.__module__.partition(".")[0] == "btcore"


def _describe(cls: type) -> str:
    """Return a name for a value of a class, with an article."""
    name = cls.__qualname__
    return f"{'an' if name[:1].lower() in 'aeiou' else 'a'} {name}"


class Identity:
    """Makes an object hashable that is not; no node changes it."""

    __slots__ = ("value",)

    def __init__(self, value: object) -> None:
        self.value = value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Identity) and other.value is self.value

    def __hash__(self) -> int:
        return id(self.value)


_PLAIN: Final = frozenset({bool, int, float, str, Status, bytes})
_CONSTANTS: Final = (type, FunctionType, BuiltinFunctionType, ModuleType, Enum, TreeNode)


class _Thawer:
    """Makes new objects with frozen contents."""

    def __init__(self, frozen: tuple[Any, ...]) -> None:
        self._frozen = frozen
        self._made: dict[int, Any] = {}

    def thaw(self, value: Any) -> Any:
        """Return the value for which *value* stands."""
        cls = type(value)
        if cls is _Typed or cls is Identity:
            return value.value
        if cls is _Reference:
            number = value.number
            return self._made[number] if number in self._made else self._new(number)
        if cls is _Items:
            return value.cls([self.thaw(item) for item in value.items])
        return unpack("d", value.bits)[0] if cls is _Float else value

    def _new(self, number: int) -> Any:
        contents = self._frozen[number]
        if type(contents) is Identity:
            return contents.value
        cls, items, *rest = contents
        if cls is None:
            return self._thaw_reduced(number, items, *rest)
        thawed_object = self._made[number] = cls()
        if cls is dict:
            thawed_object.update((self.thaw(key), self.thaw(item)) for key, item in items)
        else:
            thawed_object.extend(self.thaw(item) for item in items)
        return thawed_object

    def _thaw_reduced(self, number: int, make: Any, *frozen: Any) -> Any:
        """Return the object that consists of the parts of its `__reduce_ex__`, as pickle makes it."""
        arguments = self.thaw(frozen[0])
        thawed_object = self._made[number] = self.thaw(make)(*arguments)
        state, items, pairs, setter = [self.thaw(part) for part in frozen[1:]]
        for item in items or ():
            thawed_object.append(item)
        for key, item in pairs or ():
            thawed_object[key] = item
        if setter is not None:
            setter(thawed_object, state)
        elif state is not None:
            _set_state(thawed_object, state)
        return thawed_object


def _set_state(target: Any, state: Any) -> None:
    if hasattr(target, "__setstate__"):
        target.__setstate__(state)
        return
    attributes, slots = state if isinstance(state, tuple) and len(state) == 2 else (state, None)
    if attributes:
        vars(target).update(attributes)
    for name, value in (slots or {}).items():
        setattr(target, name, value)
