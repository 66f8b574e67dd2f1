"""Consistent snapshots of blackboards for other threads, without delaying the tree.

After each tick the tick thread freezes the entries whose sequence ID changed: immutable values are kept,
containers are copied one level deep, other objects are kept by reference. The publisher's thread converts the
values to portable values (wire/msgpack_values.py), which may be slow. Blackboards of a tree that does not
tick are read directly. A container that changes while it is read is read again.
"""

import contextlib
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Final

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.tree.tree import Tree
from btcore_monitor.errors import MonitorError
from btcore_monitor.wire.msgpack_values import Boards, to_portable

ROOT: Final = "ROOT"
"""The name under which a reply also contains the outermost blackboard (`groot2_publisher.cpp`)."""

_ATTEMPTS: Final = 20
"""Maximum attempts to read a container that another thread changes at the same time."""

_COPIES: Final[Mapping[type, Callable[[Any], object]]] = {
    list: list,
    tuple: list,
    deque: list,
    set: list,
    dict: dict,
}


class ReservedNameError(MonitorError):
    """A subtree is named ROOT, the name under which the outermost blackboard is sent."""


class BlackboardTracker:
    """Tracks changes of the blackboards of *tree*.

    Only the tick thread may call the methods, except where a method's description permits any thread.
    """

    def __init__(self, tree: Tree) -> None:
        self._boards: dict[str, Blackboard] = {part.path: part.blackboard for part in tree.subtrees}
        self._names = {path or tree.id: path for path in self._boards}
        self._outermost = tree.subtrees[0].blackboard.root
        if all(board is not self._outermost for board in self._boards.values()):
            self._boards.setdefault(ROOT, self._outermost)
        self._known_entries: dict[str, dict[str, tuple[Entry, int]]] = {path: {} for path in self._boards}
        self._frozen_boards: dict[str, dict[str, object]] = {path: {} for path in self._boards}

    def snapshot_if_changed(self) -> Boards | None:
        """Return all blackboards, frozen, or None if no entry changed since the last call."""
        changed = False
        for path, board in self._boards.items():
            entries = board.local_entries()
            seen = self._known_entries[path]
            updated: dict[str, object] = {}
            for key, entry in entries.items():
                known = seen.get(key)
                # the entry too: a removed and recreated entry starts with the same sequence IDs again
                if known is None or known[1] != entry.sequence_id or known[0] is not entry:
                    seen[key] = (entry, entry.sequence_id)
                    updated[key] = freeze(entry.value)
            if updated or len(seen) != len(entries):
                changed = True
                values = self._frozen_boards[path]
                if len(seen) != len(entries):
                    for key in seen.keys() - entries.keys():
                        del seen[key]
                    values = {key: value for key, value in values.items() if key in entries}
                # a new dict: the publisher's thread may still read the old one
                self._frozen_boards[path] = values | updated
        return dict(self._frozen_boards) if changed else None

    def read_now(self) -> Boards:
        """Return all blackboards with their current values. Any thread may call this method."""
        return {path: _read(board) for path, board in self._boards.items()}

    def create_groot_reply(self, names: list[str], boards: Boards) -> dict[str, Mapping[str, Any] | None]:
        """Return the content of a BLACKBOARD reply. Any thread may call this method.

        The result also contains the outermost blackboard as `ROOT` if any other blackboard is requested.

        Args:
            names: The requested names. Unknown names are left out.
            boards: The values by the blackboard's path and by key.

        Raises:
            ReservedNameError: The result contains `ROOT`, and a requested subtree has that name.
        """
        reply: dict[str, Mapping[str, Any] | None] = {}
        nested = False
        for name in names:
            path = self._names.get(name)
            if path is None:
                continue
            reply[name] = to_portable_board(boards.get(path, {}))
            nested = nested or self._boards[path] is not self._outermost
        if nested:
            if ROOT in reply:
                raise ReservedNameError(
                    "a subtree is named ROOT, which is the name of the outermost blackboard"
                )
            outermost = next(path for path, board in self._boards.items() if board is self._outermost)
            reply[ROOT] = to_portable_board(boards.get(outermost, {}))
        return reply


def _read(board: Blackboard) -> dict[str, object]:
    """Return the values of *board*. If another thread changes a container meanwhile, read again."""
    for _ in range(_ATTEMPTS):
        # A container that changes size during the iteration raises RuntimeError.
        with contextlib.suppress(RuntimeError):
            return {key: freeze(entry.value) for key, entry in list(board.local_entries().items())}
    return {}


def freeze(value: object) -> object:
    """Return *value*, or a copy one level deep if it is a built-in container."""
    # By the exact type: a subclass may have any constructor.
    copy = _COPIES.get(type(value))
    return value if copy is None else copy(value)


def to_portable_board(board: Mapping[str, object]) -> dict[str, Any]:
    """Return *board* with portable values; a value that cannot be converted becomes None."""
    return {key: _to_portable_value(value) for key, value in board.items()}


def _to_portable_value(value: object) -> Any:
    # The value may be an object of a user's class, whose attributes may raise any exception.
    for _ in range(_ATTEMPTS):
        try:
            return to_portable(value)
        except RuntimeError:  # perhaps a container changed during the iteration
            continue
        except Exception:
            break
    return None
