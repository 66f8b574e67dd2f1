"""The panels of the blackboards: a table of their present values, and a history of their changes."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Any, Final

import numpy as np

from btcore.suggestions import shortened
from btcore_monitor.events import RUNNING, ObservedTree
from btcore_monitor.screen.panels import LEVELS, create_log_columns, create_markdown_columns, escape_markdown
from btcore_monitor.screen.row_buffer import RowBuffer, Series
from btcore_monitor.screen.style import Palette
from btcore_monitor.screen.tick_states import TickStates

BLACKBOARD: Final = "blackboard"
HISTORY: Final = "blackboard_history"

_MAX_VALUE_CHARS: Final = 60
_MAX_ENTRIES: Final = 500
_MAX_IDLE: Final = 40
"""Greatest number of entries of subtrees that do not run."""
_MAX_TIMES: Final = 10_000
"""Greatest number of entries whose last change is known, of a robot that adds entries without end."""
_MAX_LINES: Final = 40
"""Greatest number of lines that an update adds to the history."""

Boards = Mapping[str, Mapping[str, Any]]


class BlackboardTable:
    """The blackboards as a table: first the running subtrees, from the innermost to the main tree.

    Each entry has the time of its last change, and the entries that changed last are bold.

    Attributes:
        note: A text above the table, about data that the robot does not send.
    """

    def __init__(self, rows: RowBuffer, tree: ObservedTree, palette: Palette) -> None:
        self._rows = rows
        self._series: Series[str] = rows.create_series(BLACKBOARD, create_markdown_columns)
        self._history: Series[tuple[str, str, int]] = rows.create_series(HISTORY, create_log_columns)
        self._colour = int(palette.text)
        self.note = ""
        self.has_entries = False
        """Whether a blackboard with entries has been shown."""
        entries = [
            (at, tree.by_uid[node.children[0]].subtree)
            for at, node in enumerate(tree.nodes)
            if node.type == "subtree" and node.children
        ]
        self._entries = np.array([at for at, _ in entries], dtype=np.intp)
        self._paths = [path for _, path in entries]
        self._main = tree.root.subtree
        self._running: Sequence[str] = (self._main,)
        self._boards: Boards | None = None
        self._changed_at: dict[tuple[str, str], int] = {}
        self._last_changed: set[tuple[str, str]] = set()
        self._last_document = ""

    def show_note(self) -> None:
        """Show only the note, if no blackboard has been shown yet."""
        if not self._last_document:
            self._series.add(f"*{escape_markdown(self.note)}*")

    def show(self, boards: Boards) -> None:
        """Show *boards*, and add their changes to the history."""
        before, self._boards = self._boards, boards
        self.has_entries = self.has_entries or any(boards.values())
        if before is not None:
            changes = list(_list_changes(before, boards))
            if changes:
                self._last_changed = {(path, key) for path, key, *_ in changes}
                self._changed_at |= dict.fromkeys(self._last_changed, self._rows.stamp)
                if len(self._changed_at) > _MAX_TIMES:
                    self._changed_at = dict.fromkeys(self._last_changed, self._rows.stamp)
            lines = [_format_change(*change) for change in changes[:_MAX_LINES]]
            if len(changes) > _MAX_LINES:
                lines.append(f"… and {len(changes) - _MAX_LINES} more")
            for line in lines:
                self._history.add((line, LEVELS[2], self._colour))
        self._update()

    def show_running(self, states: TickStates) -> None:
        """Show the blackboards of the subtrees that run first."""
        active = np.flatnonzero(states.shown[self._entries] == RUNNING).tolist()
        # Inner subtrees follow outer subtrees in the tree.
        running = [*(self._paths[at] for at in reversed(active)), self._main]
        if running != self._running:
            self._running = running
            self._update()

    def _update(self) -> None:
        if self._boards is None:
            return
        document = self._format_boards(self._boards)
        if self.note:
            document = f"*{escape_markdown(self.note)}*\n\n{document}"
        if document != self._last_document:
            self._last_document = document
            self._series.add(document)

    def _format_boards(self, boards: Boards) -> str:
        lines: list[str] = []
        for path in self._running:
            lines += self._format_table(path, boards.get(path, {}))
        idle = [path for path, board in boards.items() if board and path not in self._running]
        count = 0
        for at, path in enumerate(idle):
            count += len(boards[path])
            if count > _MAX_IDLE:
                lines += ["", f"*and {len(idle) - at} blackboards of subtrees that do not run*"]
                break
            lines += self._format_table(path, boards[path])
        return "\n".join(lines[1:]) if lines else "*no entries*"

    def _format_table(self, path: str, board: Mapping[str, Any]) -> Iterator[str]:
        if not board:
            return
        yield ""
        yield f"| **{escape_markdown(path)}** | | |" if path else "| key | value | changed |"
        yield "|:--|:--|--:|"
        for key, value in islice(board.items(), _MAX_ENTRIES):
            changed = self._changed_at.get((path, key))
            bold = "**" if (path, key) in self._last_changed else ""
            text = "–" if value is None else f"`{escape_markdown(format_value(value))}`"
            time = "" if changed is None else f"{bold}{self._rows.to_seconds(changed):.1f} s{bold}"
            yield f"| {bold}{escape_markdown(format_value(key))}{bold} | {text} | {time} |"
        if len(board) > _MAX_ENTRIES:
            yield f"| and {len(board) - _MAX_ENTRIES} more entries | | |"


def _list_changes(before: Boards, boards: Boards) -> Iterator[tuple[str, str, Any, Any]]:
    """Yield the path, the key, the old and the new value of each changed entry."""
    for path, board in boards.items():
        known = before.get(path, {})
        for key, value in board.items():
            old = known.get(key)
            if key not in known or old != value:
                yield path, key, old, value


def _format_change(path: str, key: str, old: Any, new: Any) -> str:
    name = f"{path}: {format_value(key)}" if path else format_value(key)
    return f"{name}: {_format_entry_value(old)} → {_format_entry_value(new)}"


def _format_entry_value(value: Any) -> str:
    return "–" if value is None else format_value(value).replace("\n", " ")


def format_value(value: Any) -> str:
    """Return *value* as a short text, as scripts write values."""
    # As in scripts, not True and False as in Python.
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        # The class of an object is in `__type` (msgpack_values.py).
        entries = islice(value.items(), _MAX_VALUE_CHARS)
        parts = (f"{key}={format_value(part)}" for key, part in entries if key != "__type")
        text = f"{value.get('__type', '')}({', '.join(parts)})"
    elif isinstance(value, list | tuple):
        parts = (format_value(part) for part in value[:_MAX_VALUE_CHARS])
        text = f"[{', '.join(parts)}]"
    else:
        text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return shortened(text, _MAX_VALUE_CHARS)
