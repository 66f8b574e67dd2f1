"""The events that a journal records, independent of the tree: nodes are numbers (UIDs), scopes are indices.

This module is not compiled: compiled named tuples lose the types of fields, by which recordings are read.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from btcore.blackboard.blackboard import Entry
from btcore.status import Status


class TickBegan(NamedTuple):
    """The root is ticked: the number of the tick, its time (ns), and what woke it, `TreeContext.woken_by`."""

    tick: int
    time: int
    woken_by: int


class HaltBegan(NamedTuple):
    """The whole tree is halted, between two ticks."""


class StepEnded(NamedTuple):
    """The tick or the halt has ended. *status* is the result; IDLE after a halt or an exception."""

    status: Status


class RecordedError(NamedTuple):
    """An exception: the name of its class, and its text."""

    type: str
    text: str


class Raised(NamedTuple):
    """The tick of an external node raised an exception."""

    uid: int
    error: RecordedError


class ExternalHaltBegan(NamedTuple):
    """The halt of an external node begins, in which more happens than that its status becomes IDLE."""

    uid: int


class ExternalHaltEnded(NamedTuple):
    """The halt that began by `ExternalHaltBegan` has ended; *error* is what it raised, or None."""

    uid: int
    error: RecordedError | None


class ChildTicked(NamedTuple):
    """An external node ticks a child."""

    uid: int


class ChildHalted(NamedTuple):
    """An external node halts a child."""

    uid: int


class StatusSet(NamedTuple):
    """An external node stores the status of itself or of a child, which it has not ticked or halted."""

    uid: int
    status: Status


class StatusForced(NamedTuple):
    """A callback before or after the tick of a node forces its result; SKIPPED = it only wrote entries."""

    uid: int
    is_pre_tick: bool
    status: Status


class Paused(NamedTuple):
    """A built-in node pauses after *repetitions*, because of a tick limit or a signal."""

    uid: int
    repetitions: int


class TimeRead(NamedTuple):
    """A built-in node reads the clock, after *repeats* that read the same time as before."""

    time: int
    repeats: int


class Written(NamedTuple):
    """An entry is written.

    Attributes:
        scope: The index of the scope on which the entry was written.
        key: The key, before remapping.
        value: The value that the entry has now, encoded.
        declared: The name of the type that the writer has declared, or None.
    """

    scope: int
    key: str
    value: Any
    declared: str | None


class Removed(NamedTuple):
    """An entry of a scope is removed."""

    scope: int
    key: str


class ScriptRun(NamedTuple):
    """External code runs a script on a scope, with the given enum names."""

    scope: int
    text: str
    enums: Mapping[str, int]


class MessageLogged(NamedTuple):
    """External code logs a message with a level, such as WARNING."""

    level: str
    text: str


class RecordedEntry(NamedTuple):
    """An entry, with its encoded value and the names of its types."""

    value: Any
    declared: str
    inferred: bool
    value_type: str | None
    sequence_id: int


class Replaced(NamedTuple):
    """All entries of a scope are replaced."""

    scope: int
    entries: Mapping[str, RecordedEntry]


InputEvent = (
    Raised
    | ExternalHaltBegan
    | ExternalHaltEnded
    | ChildTicked
    | ChildHalted
    | StatusSet
    | StatusForced
    | Paused
    | TimeRead
    | MessageLogged
    | Written
    | Removed
    | Replaced
    | ScriptRun
)
"""What a tick or halt depends on, besides the results of external nodes, which have no event."""
Event = TickBegan | HaltBegan | StepEnded | InputEvent


def recorded_error(error: BaseException) -> RecordedError:
    """Return the recorded form of *error*."""
    return RecordedError(type(error).__name__, str(error))


def recorded_entry(entry: Entry, encoded: object) -> RecordedEntry:
    """Return *entry* with its *encoded* value."""
    value_type = None if entry.value_type is None else entry.value_type.name
    return RecordedEntry(encoded, entry.declared.name, entry.inferred, value_type, entry.sequence_id)
