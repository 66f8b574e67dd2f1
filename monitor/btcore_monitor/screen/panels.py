"""The panels beside the tree: log of transitions, state, statistics, tick duration and rate."""

import re
from collections import deque
from collections.abc import Iterable, Mapping
from statistics import median
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from btcore_monitor.events import (
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    STATUS_NAMES,
    SUCCESS,
    ConnectionEvent,
    DataSource,
    ExceptionEvent,
    HooksEvent,
    LostTransitionsEvent,
    MissingDataEvent,
    ObservedTree,
    TickEvent,
    TransitionEvent,
)
from btcore_monitor.screen.captions import distinct_names
from btcore_monitor.screen.font import elide
from btcore_monitor.screen.row_buffer import RowBuffer, Series, create_curve_style, create_scalar_columns
from btcore_monitor.screen.style import Palette
from btcore_monitor.screen.tick_states import RESET_OFFSET, SHOWN_NAMES, TickStates
from btcore_monitor.screen.tree_view import list_leaves
from btcore_scene import MovingScene

LOG: Final = "log"
NOW: Final = "now"
STATISTICS: Final = "statistics"
TICK_MS: Final = "tick/duration"
BUDGET_MS: Final = "tick/budget"
RATE: Final = "rate/ticks"
"""Paths of rerun entities below the path of their robot: the log, the tables, and the curves over time."""

LEVELS: Final = ("TRACE", "DEBUG", "INFO", "WARN", "ERROR")
"""Levels of the log's lines, from the most to the least detailed, with rerun's names."""
_LEVEL_OF_STATUS: Final[Mapping[int, str]] = {
    IDLE: "TRACE",
    RUNNING: "DEBUG",
    SKIPPED: "DEBUG",
    SUCCESS: "INFO",
    FAILURE: "WARN",
}
"""Level of a transition, by its new status. Missing data has the level WARN, an exception of a node ERROR."""

_MAX_NAME_CHARS: Final = 28
_MAX_NAMES: Final = 4
_MAX_CELL_CHARS: Final = 28
"""Characters that always fit into a cell of a table; the viewer does not wrap cells."""
UPDATE_INTERVAL_NS: Final = 1_000_000_000
"""Shortest time (ns of the tree's clock) between two updates of the statistics."""
MAX_TABLE_ROWS: Final = 60
_MAX_PATH_CHARS: Final = 56
"""Characters of a displayed path; big trees show paths to distinguish their leaves."""
_INDENT: Final = "\xa0" * 4


class TransitionLog:
    """The log of transitions, exceptions, gaps and connection changes."""

    def __init__(self, rows: RowBuffer, tree: ObservedTree, palette: Palette) -> None:
        names = distinct_names(tree.nodes)
        width = min(_MAX_NAME_CHARS, max(map(len, names)))
        self._names = {
            node.uid: f"{elide(name, width):{width}}" for node, name in zip(tree.nodes, names, strict=True)
        }
        self._width = width
        self._rows = rows
        self._palette = palette
        # With several robots, the first column shows the time of the day.
        self._shows_time = bool(rows.entity_path_prefix)
        self._lines: Series[tuple[str, str, int]] = rows.create_series(LOG, create_log_columns)
        self._numbers: Series[TransitionEvent] = rows.create_series(f"{LOG}/numbers", _create_number_columns)

    def add_transition(self, event: TransitionEvent) -> None:
        """Log a transition as a line `#number  name  PREVIOUS → STATUS`, and as numbers."""
        line = (
            f"#{event.number:<6d} {self._names.get(event.uid, '?' * self._width)} "
            f"{STATUS_NAMES[event.previous]:>7} → {STATUS_NAMES[event.status]}"
        )
        level, colour = _LEVEL_OF_STATUS[event.status], self._palette.ink[event.status]
        self._add(line, level, colour)
        self._numbers.add(event)

    def send(self) -> None:
        """Send the lines and the numbers, before the other data of the robot."""
        for series in (self._lines, self._numbers):
            series.send()

    def add_unmatched_pattern(self, pattern: str) -> None:
        """Log that no node matches a search pattern."""
        self._warn(f"no node's name or path matches '{pattern}'")

    def add_exception(self, event: ExceptionEvent) -> None:
        """Log the exception of a node."""
        line = f"{event.path} raised: {shorten_message(event.message)}"
        self._add(line, "ERROR", self._palette.ink[FAILURE])

    def add_gap(self, event: LostTransitionsEvent) -> None:
        """Log a gap in the transitions."""
        self._warn(f"transitions #{event.first} to #{event.last} are missing: they never arrived")

    def add_missing_data(self, event: MissingDataEvent) -> None:
        """Log missing data of unknown amount."""
        since = f"since {self._rows.to_seconds(event.since):.2f}s " if event.since < event.stamp else ""
        self._warn(f"{event.kind} {since}incomplete: {event.reason}")

    def add_hooks(self, event: HooksEvent) -> None:
        """Log the warning about hooks of other clients."""
        self._warn(event.warning)

    def show_source(self, source: DataSource) -> None:
        """Log which data the robot does not send."""
        for kind, reason in source.unavailable.items():
            self._add(f"{kind}: {reason}", "INFO", self._palette.faint)

    def add_connection(self, event: ConnectionEvent) -> None:
        """Log a change of the connection."""
        line = f"robot {event.state}" + (f": {event.detail}" if event.detail else "")
        self._add(line, "WARN" if event.state == "lost" else "INFO", self._palette.faint)

    def _warn(self, line: str) -> None:
        self._add(line, "WARN", self._palette.ink[RUNNING])

    def _add(self, line: str, level: str, colour: int) -> None:
        time = f"{self._rows.to_seconds(self._rows.stamp):9.2f}s " if self._shows_time else ""
        self._lines.add((f"{time}{line}", level, int(colour)))


def create_log_columns(values: list[tuple[str, str, int]]) -> Iterable[Any]:
    """Return columns with a line of a log in each row, from its text, its level and its colour."""
    text, level, colour = zip(*values, strict=True)
    return rr.TextLog.columns(text=text, level=level, color=np.array(colour, dtype=np.uint32))


def _create_number_columns(values: list[TransitionEvent]) -> Iterable[Any]:
    names = ("number", "tick", "uid", "previous", "status")
    columns: dict[str, Any] = {
        name: np.array([getattr(event, name) for event in values], dtype=np.int64) for name in names
    }
    return rr.AnyValues.columns(**columns)


class NowPanel:
    """A short table: running leaves, failed leaves, the robot's notes, its collisions, and the tick."""

    def __init__(self, rows: RowBuffer, tree: ObservedTree) -> None:
        self._rows = rows
        self._series: Series[str] = rows.create_series(NOW, create_markdown_columns)
        self._is_leaf = np.array([not node.children for node in tree.nodes])
        leaves = [node for node in tree.nodes if not node.children]
        self._names = dict(zip(np.flatnonzero(self._is_leaf).tolist(), distinct_names(leaves), strict=True))
        self._collisions_text = ""
        self._notes: dict[str, str] = {}
        self._last_document = ""
        self._source_lines: list[str] = []
        self._exception_text = ""
        self._root_text = STATUS_NAMES[IDLE]
        self._lost_transitions = self._gap_count = 0

    def show_source(self, source: DataSource) -> None:
        """Add lines for the data that the robot does not send."""
        self._source_lines = [f"| by | {source.name} |"] if source.unavailable else []
        if "exceptions" in source.unavailable:
            self._source_lines.append(f"| raised | {source.unavailable['exceptions']} |")

    def show_exception(self, event: ExceptionEvent, states: TickStates) -> None:
        """Show the last node that raised an exception.

        The panel is updated immediately, because a tick that raises may be the last tick.
        """
        path, message = escape_markdown(event.path), escape_markdown(shorten_message(event.message))
        self._exception_text = f"**{path}** raised at {self._rows.to_seconds(event.stamp):.2f} s: {message}"
        self._show(states, self._root_text)

    def count_missing(self, event: LostTransitionsEvent | MissingDataEvent) -> None:
        """Count missing transitions."""
        if isinstance(event, LostTransitionsEvent):
            self._lost_transitions += event.last - event.first + 1
        elif event.kind == "transitions":
            self._gap_count += 1

    def keep_notes(self, data: MovingScene) -> None:
        """Keep the notes and the collisions of *data* for the next update of the panel."""
        self._notes.update(data.notes)
        if data.collisions is not None:
            self._collisions_text = f"{data.collisions} collisions · {data.grazes or 0} grazes"

    def show_tick(self, event: TickEvent, states: TickStates) -> None:
        """Show the state after a tick."""
        self._show(states, f"{STATUS_NAMES[event.status]}, tick {event.tick}")

    def show_states(self, states: TickStates) -> None:
        """Show *states*, for a robot that does not report its ticks."""
        self._show(states, SHOWN_NAMES[int(states.shown[0])])

    def _show(self, states: TickStates, root_text: str) -> None:
        self._root_text = root_text
        is_running = states.shown == RUNNING
        failed = (states.shown == FAILURE) | (states.shown == RESET_OFFSET + FAILURE)
        short = {name: note for name, note in self._notes.items() if len(note) <= _MAX_CELL_CHARS}
        # Long texts are outside the table, because the viewer wraps only lines outside tables.
        lines = [self._exception_text, ""] if self._exception_text else []
        lines += [f"| runs | {self._format_leaves(is_running) or '–'} |", "|:--|:--|"]
        if (failed & self._is_leaf).any():
            lines.append(f"| failed | {self._format_leaves(failed)} |")
        lines += [f"| {name} | {note} |" for name, note in short.items()]
        if self._collisions_text:
            lines.append(f"| robot | {self._collisions_text} |")
        lines.append(f"| root | {root_text} |")
        lines += self._source_lines
        if self._lost_transitions:
            lines.append(f"| lost | {self._lost_transitions} transitions |")
        if self._gap_count:
            lines.append(f"| lost | transitions, {self._gap_count} times |")
        for name, note in self._notes.items():
            lines += [] if name in short else ["", f"{name}: {note}"]
        document = "\n".join(lines)
        if document != self._last_document:
            self._last_document = document
            self._series.add(document)

    def _format_leaves(self, chosen: NDArray[np.bool_]) -> str:
        indices = np.flatnonzero(chosen & self._is_leaf).tolist()
        text = ", ".join(f"**{escape_markdown(self._names[index])}**" for index in indices[:_MAX_NAMES])
        return text if len(indices) <= _MAX_NAMES else f"{text} and {len(indices) - _MAX_NAMES} more"


class StatisticsTable:
    """The observed results and running times of every node of a tree.

    Only the time during which the monitor is connected counts. The running time of a node that is RUNNING
    when the monitor connects starts at that moment. For a tree of more than MAX_TABLE_ROWS nodes, the table
    has only the leaves with the longest running times, and of equal times with the most results.
    """

    def __init__(self, rows: RowBuffer, tree: ObservedTree) -> None:
        self._rows = rows
        self._series: Series[str] = rows.create_series(STATISTICS, create_markdown_columns)
        self._nodes = tree.nodes
        self._depth = {node.uid: tree.depth(node.uid) for node in tree.nodes}
        self._results: dict[int, list[int]] = {node.uid: [0, 0, 0] for node in tree.nodes}
        self._running_ns = dict.fromkeys(self._results, 0)
        self._since: dict[int, int] = {}
        self._next_update: int | None = None
        self._last_update_stamp = 0
        self._has_changed = False

    def begin(self, statuses: Mapping[int, int]) -> None:
        """Begin with known statuses by uid. Transitions before the present time are unknown."""
        self._since = {uid: self._rows.stamp for uid, status in statuses.items() if status == RUNNING}
        self._has_changed = True
        self.update()

    def count_transition(self, event: TransitionEvent) -> None:
        """Count a transition."""
        counts = self._results.get(event.uid)
        if counts is None:
            return
        self._has_changed = True
        since = self._since.pop(event.uid, None)
        if since is not None:
            self._running_ns[event.uid] += max(0, event.stamp - since)
        if event.status == RUNNING:
            self._since[event.uid] = event.stamp
        elif event.status != IDLE:
            counts[event.status - SUCCESS] += 1

    def update_if_due(self) -> None:
        """Update the table, unless the last update was less than UPDATE_INTERVAL_NS ago."""
        if self._next_update is None or self._rows.stamp >= self._next_update:
            self.update()

    def update(self) -> None:
        """Update the table if a status has changed or a node is RUNNING."""
        stamp = self._rows.stamp
        if self._has_changed or (self._since and stamp != self._last_update_stamp):
            self._has_changed = False
            self._last_update_stamp = stamp
            self._next_update = stamp + UPDATE_INTERVAL_NS
            self._series.add(self.format_table(stamp))

    def format_table(self, stamp: int) -> str:
        """Return the table as of *stamp* (ns)."""
        running = {
            uid: ns + (max(0, stamp - self._since[uid]) if uid in self._since else 0)
            for uid, ns in self._running_ns.items()
        }
        nodes = list(self._nodes)
        indented = len(nodes) <= MAX_TABLE_ROWS
        if not indented:
            work = {
                node.uid: (running[node.uid], sum(self._results[node.uid])) for node in list_leaves(nodes)
            }
            ticked = [node for node in nodes if any(work.get(node.uid, ()))]
            nodes = sorted(ticked, key=lambda node: work[node.uid], reverse=True)[:MAX_TABLE_ROWS]
        lines = ["| node | results | success | running | a run |", "|:--|--:|--:|--:|--:|"]
        for node in nodes:
            succeeded, failed, skipped = self._results[node.uid]
            ended = succeeded + failed
            rate = f"{100 * succeeded / ended:.0f} %" if ended else "–"
            seconds = running[node.uid] / 1e9
            results = f"{ended}" + (f" + {skipped} skipped" if skipped else "")
            mean = f"{seconds / ended:.2f} s" if ended and seconds else "–"
            name = (
                _INDENT * self._depth[node.uid] + node.name if indented else elide(node.path, _MAX_PATH_CHARS)
            )
            ran = f"{seconds:.1f} s" if seconds else "–"
            lines.append(f"| {escape_markdown(name)} | {results} | {rate} | {ran} | {mean} |")
        if not indented:
            lines += ["", f"*the {len(nodes)} leaves that ran longest, of {len(self._nodes)} nodes*"]
        return "\n".join(lines)


class TickPlots:
    """The plots of the tick duration with its budget, and the tick rate by the tree's clock."""

    def __init__(self, rows: RowBuffer, palette: Palette) -> None:
        self._rows = rows
        self._duration: Series[float] = rows.create_series(TICK_MS, create_scalar_columns)
        self._budget: Series[float] = rows.create_series(BUDGET_MS, create_scalar_columns)
        self._rate: Series[float] = rows.create_series(RATE, create_scalar_columns)
        self._palette = palette
        self._before: TickEvent | None = None
        self._periods: deque[int] = deque(maxlen=21)
        self._worst = 0
        self._budget_ns = 0

    def draw(self) -> None:
        """Log the names and colours of the lines."""
        ink = self._palette.ink
        self._rows.log(BUDGET_MS, create_curve_style("budget", ink[FAILURE]), static=True)
        self._rows.log(RATE, create_curve_style("ticks a second", ink[SUCCESS]), static=True)

    def add_tick(self, event: TickEvent) -> None:
        """Add a tick. The budget is the median time between the latest ticks.

        The line of the budget is drawn once a tick has taken more than a tenth of the budget, because a line
        far above would flatten the curve. Until then only the legend shows the budget.
        """
        before, self._before = self._before, event
        self._duration.add(event.duration_ns / 1e6)
        self._worst = max(self._worst, event.duration_ns)
        if before is None or event.stamp <= before.stamp:
            return
        # Ticks may be lost on the way, so the time is divided by the difference of their numbers.
        self._periods.append((event.stamp - before.stamp) // max(1, event.tick - before.tick))
        self._rate.add(1e9 / self._periods[-1])
        budget = int(median(self._periods))
        if abs(budget - self._budget_ns) > self._budget_ns // 20:
            self._budget_ns = budget
            name = f"tick (budget {budget / 1e6:.4g} ms)"
            self._rows.log(TICK_MS, create_curve_style(name, self._palette.laser), static=True)
        if self._worst * 10 > self._budget_ns:
            self._budget.add(self._budget_ns / 1e6)


def escape_markdown(text: str) -> str:
    """Replace the characters of *text* that are markup in a markdown table."""
    return text.replace("|", "¦").replace("`", "'").replace("\n", " ")


def shorten_message(message: str) -> str:
    """Return the first line of an error's *message*, without the tree's file and the node's name.

    The panels show the path of the node beside the message.
    """
    line = message.partition("\n")[0]
    return re.sub(r"^\S+:\d+: (node '.*?' <.*?> raised while \w+: )?", "", line)


def create_markdown_columns(values: list[str]) -> Iterable[Any]:
    """Return columns with a markdown document in each row."""
    return rr.TextDocument.columns(text=values, media_type=["text/markdown"] * len(values))
