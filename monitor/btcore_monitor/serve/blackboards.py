"""Blackboards for other threads: what they hold, without tearing and without holding up the tree.

After each tick, on the thread that ticks, entries whose sequence id moved are frozen: immutable
values are kept as they are, containers are copied one level deep, other objects are kept by
reference. Making them portable, which may be slow, is the publisher's work. A tree that
does not tick is read directly; a container that changes meanwhile is read again.
"""

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Final

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.tree.tree import Tree
from btcore_monitor.errors import MonitorError
from btcore_monitor.wire.msgpack_values import Boards, to_portable

ROOT: Final = "ROOT"
"""The name of the outermost blackboard, which Groot 2 gets beside those asked for."""

_ATTEMPTS: Final = 20
_SHARED: Final = frozenset({bool, int, float, str, type(None), bytes})


class ReservedNameError(MonitorError):
    """A subtree is called ROOT, the name under which the outermost blackboard is sent."""


class BlackboardTracker:
    """Follows the blackboards of one *tree*. Belongs to the thread that ticks, unless said otherwise."""

    def __init__(self, tree: Tree) -> None:
        self._main = tree.id
        self._boards: dict[str, Blackboard] = {one.path: one.blackboard for one in tree.subtrees}
        self._names = {path or tree.id: path for path in self._boards}
        self._outermost = tree.subtrees[0].blackboard.root
        if all(board is not self._outermost for board in self._boards.values()):
            self._boards.setdefault(ROOT, self._outermost)
        self._seen: dict[str, dict[str, tuple[Entry, int]]] = {path: {} for path in self._boards}
        self._frozen: dict[str, dict[str, object]] = {path: {} for path in self._boards}

    def snapshot_if_changed(self) -> Boards | None:
        """All blackboards, frozen, if an entry changed since the last call; else None."""
        news = False
        for path, board in self._boards.items():
            entries = board.local_entries()
            seen = self._seen[path]
            fresh: dict[str, object] = {}
            for key, entry in entries.items():
                known = seen.get(key)
                if known is None or known[1] != entry.sequence_id or known[0] is not entry:
                    seen[key] = (entry, entry.sequence_id)
                    fresh[key] = frozen(entry.value)
            if fresh or len(seen) != len(entries):
                news = True
                kept = self._frozen[path]
                if len(seen) != len(entries):
                    for key in [one for one in seen if one not in entries]:
                        del seen[key]
                    kept = {key: value for key, value in kept.items() if key in entries}
                self._frozen[path] = kept | fresh
        return dict(self._frozen) if news else None

    def read_now(self) -> Boards:
        """All blackboards as they are at this moment, from any thread."""
        return {path: _steady(_Values(board)) for path, board in self._boards.items()}

    def for_groot(self, names: list[str], boards: Boards) -> dict[str, Mapping[str, Any] | None]:
        """What BLACKBOARD answers for *names*, out of *boards*; from any thread.

        Unknown names are left out. ``ROOT`` joins as soon as a blackboard asked for is not the
        outermost itself; raises :class:`ReservedNameError` if a subtree asked for has that name already.
        """
        answer: dict[str, Mapping[str, Any] | None] = {}
        nested = False
        for name in names:
            path = self._names.get(name)
            if path is None:
                continue
            answer[name] = portable_board(boards.get(path, {}))
            nested = nested or self._boards[path] is not self._outermost
        if nested:
            if ROOT in answer:
                raise ReservedNameError(
                    "a subtree is named ROOT, which is the name of the outermost blackboard"
                )
            outermost = next(path for path, one in self._boards.items() if one is self._outermost)
            answer[ROOT] = portable_board(boards.get(outermost, {}))
        return answer


class _Values:
    """Reads one blackboard's values when called."""

    def __init__(self, board: Blackboard) -> None:
        self._board = board

    def __call__(self) -> dict[str, object]:
        return {key: frozen(entry.value) for key, entry in list(self._board.local_entries().items())}


def _steady(read: Callable[[], dict[str, object]]) -> dict[str, object]:
    """What *read* returns, tried again while another thread changes what it reads."""
    for _ in range(_ATTEMPTS):
        try:
            return read()
        except RuntimeError:  # a container changed size during iteration
            continue
    return {}


def frozen(value: object) -> object:
    """*value*, or a copy one level deep of a built-in container."""
    kind = type(value)
    if kind in _SHARED:
        return value
    if kind is list or kind is tuple or kind is deque or kind is set:
        return list(value)  # type: ignore[call-overload]
    if kind is dict:
        return dict(value)  # type: ignore[call-overload]
    return value


def portable_board(board: Mapping[str, object]) -> dict[str, Any]:
    """*board* with portable values; a value that refuses to be read is None."""
    return {key: _readable(value) for key, value in board.items()}


def _readable(value: object) -> Any:
    # the value may be an object of the user's, whose attributes may do anything
    for _ in range(_ATTEMPTS):
        try:
            return to_portable(value)
        except RuntimeError:
            continue
        except Exception:
            return None
    return None
