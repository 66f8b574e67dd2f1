"""The panels beside the tree: log of transitions, blackboard, tick duration and tick rate."""

from collections import deque
from collections.abc import Iterable, Mapping
from statistics import median
from typing import Any, Final

import numpy as np
import rerun as rr

from btcore_monitor.events import (
    STATUS_NAMES,
    ConnectionChanged,
    DataMissed,
    DataSource,
    ExceptionRaised,
    ObservedTree,
    StatusChanged,
    Ticked,
    TransitionsLost,
)
from btcore_monitor.screen.font import elide
from btcore_monitor.screen.levels import OF_STATUS
from btcore_monitor.screen.markdown_text import brief, escape_markdown
from btcore_monitor.screen.now import markdown_columns
from btcore_monitor.screen.row_buffer import RowBuffer, Series, scalars
from btcore_monitor.screen.style import Palette

LOG: Final = "log"
BLACKBOARD: Final = "blackboard"
TICK_MS: Final = "tick/duration"
BUDGET_MS: Final = "tick/budget"
RATE: Final = "rate/ticks"
UNSENT: Final = "tick/unsent"
"""Entity of the text that replaces the tick duration if the robot does not send it."""
NAME_WIDTH: Final = 24
_VALUE_ROOM: Final = 60


class TransitionLog:
    """The log of transitions, exceptions, gaps and connection changes."""

    def __init__(self, rows: RowBuffer, tree: ObservedTree, palette: Palette) -> None:
        width = min(NAME_WIDTH, max(len(node.name) for node in tree.nodes))
        self._names = {node.uid: f"{elide(node.name, width):{width}}" for node in tree.nodes}
        self._width = width
        self._palette = palette
        self._lines: Series[tuple[str, str, int]] = rows.series(LOG, _lines)
        self._numbers: Series[StatusChanged] = rows.series(f"{LOG}/numbers", _numbers)

    def change(self, event: StatusChanged) -> None:
        """Log a transition as a line ``time  #number  name  PREVIOUS → STATUS``, and as numbers."""
        line = (
            f"{event.t / 1e9:9.2f}s #{event.number:<6d} {self._names.get(event.uid, '?' * self._width)} "
            f"{STATUS_NAMES[event.previous]:>7} → {STATUS_NAMES[event.status]}"
        )
        colour = int(self._palette.ink[event.status])
        self._lines.add(event.t, event.wall, (line, OF_STATUS[event.status], colour))
        self._numbers.add(event.t, event.wall, event)

    def not_found(self, pattern: str, t: int, wall: int) -> None:
        """Log that no node matches a search pattern, at tree time *t* and wall time *wall* (ns)."""
        line = f"{t / 1e9:9.2f}s no node's name or path matches '{pattern}'"
        self._lines.add(t, wall, (line, "WARN", int(self._palette.ink[1])))

    def raised(self, event: ExceptionRaised) -> None:
        """Log the exception of a node."""
        line = f"{event.t / 1e9:9.2f}s {event.path} raised: {brief(event.message)}"
        self._lines.add(event.t, event.wall, (line, "ERROR", int(self._palette.ink[3])))

    def gap(self, event: TransitionsLost, t: int, wall: int) -> None:
        """Log a gap in the transitions at tree time *t* and wall time *wall* (ns)."""
        line = f"{t / 1e9:9.2f}s transitions #{event.first} to #{event.last} are missing: they never arrived"
        self._lines.add(t, wall, (line, "WARN", int(self._palette.ink[1])))

    def unseen(self, event: DataMissed) -> None:
        """Log missing data of unknown amount."""
        since = f"since {event.since / 1e9:.2f}s " if event.since < event.t else ""
        line = f"{event.t / 1e9:9.2f}s {event.topic} {since}incomplete: {event.reason}"
        self._lines.add(event.t, event.wall, (line, "WARN", int(self._palette.ink[1])))

    def show_source(self, source: DataSource, t: int, wall: int) -> None:
        """Log which data the robot does not send, at tree time *t* and wall time *wall* (ns)."""
        for topic, sentence in source.unavailable.items():
            line = f"{t / 1e9:9.2f}s {topic}: {sentence}"
            self._lines.add(t, wall, (line, "INFO", self._palette.faint))

    def link(self, event: ConnectionChanged, t: int, wall: int) -> None:
        """Log a change of the connection at tree time *t* and wall time *wall* (ns)."""
        line = f"{t / 1e9:9.2f}s robot {event.state}" + (f": {event.detail}" if event.detail else "")
        level = "WARN" if event.state == "lost" else "INFO"
        self._lines.add(t, wall, (line, level, self._palette.faint))


def _lines(values: list[tuple[str, str, int]]) -> Iterable[Any]:
    text, level, colour = zip(*values, strict=True)
    return rr.TextLog.columns(text=text, level=level, color=np.array(colour, dtype=np.uint32))


def _numbers(values: list[StatusChanged]) -> Iterable[Any]:
    def column(name: str) -> Any:
        return np.array([getattr(one, name) for one in values], dtype=np.int64)

    names = ("number", "tick", "uid", "previous", "status")
    return rr.AnyValues.columns(**{name: column(name) for name in names})


class BlackboardTable:
    """The blackboards as a table, with entries in bold that changed since the last update.

    *note* is a text above the table, for data that the robot does not send.
    """

    def __init__(self, rows: RowBuffer, note: str = "") -> None:
        self._series: Series[str] = rows.series(BLACKBOARD, markdown_columns)
        self.note = note
        self._last: Mapping[str, Mapping[str, Any]] = {}
        self._shown = ""

    def blank(self, t: int, wall: int) -> None:
        """Show only the note, until a blackboard is received."""
        if not self._shown:
            self._series.add(t, wall, f"*{escape_markdown(self.note)}*")

    def show(self, t: int, wall: int, boards: Mapping[str, Mapping[str, Any]]) -> None:
        """Show the table of *boards*, unless it is unchanged."""
        document = markdown(boards, self._last)
        if self.note:
            document = f"*{escape_markdown(self.note)}*\n\n{document}"
        self._last = boards
        if document != self._shown:
            self._shown = document
            self._series.add(t, wall, document)


def markdown(boards: Mapping[str, Mapping[str, Any]], before: Mapping[str, Mapping[str, Any]]) -> str:
    """Return *boards* as a markdown table; entries that differ from *before* are bold."""
    lines: list[str] = []
    for path, board in boards.items():
        if not board:
            continue
        lines += ["", f"| **{escape_markdown(path)}** | |" if path else "| key | value |", "|:--|:--|"]
        known = before.get(path, {})
        for key, value in board.items():
            new = key not in known or known[key] != value
            text = "–" if value is None else f"`{escape_markdown(_short(value))}`"
            lines.append(
                f"| **{escape_markdown(key)}** | {text} |"
                if new and before
                else f"| {escape_markdown(key)} | {text} |"
            )
    return "\n".join(lines[1:]) if lines else "*no entries*"


def _short(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        parts = (f"{key}={_short(part)}" for key, part in value.items() if key != "__type")
        text = f"{value.get('__type', '')}({', '.join(parts)})"
    elif isinstance(value, list | tuple):
        parts = (_short(part) for part in value[:_VALUE_ROOM])
        text = f"[{', '.join(parts)}]"
    else:
        text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return text if len(text) <= _VALUE_ROOM else text[: _VALUE_ROOM - 1] + "…"


class TickCost:
    """The tick duration with its budget, and the tick rate by the tree's clock."""

    def __init__(self, rows: RowBuffer, palette: Palette) -> None:
        self._rows = rows
        self._duration: Series[float] = rows.series(TICK_MS, scalars)
        self._budget: Series[float] = rows.series(BUDGET_MS, scalars)
        self._rate: Series[float] = rows.series(RATE, scalars)
        self._palette = palette
        self._before: Ticked | None = None
        self._periods: deque[int] = deque(maxlen=21)
        self._worst = 0
        self._budget_ns = 0

    def draw(self) -> None:
        """Log the names and colours of the lines."""
        log, palette = self._rows.log, self._palette
        log(
            BUDGET_MS,
            rr.SeriesLines(colors=[int(palette.ink[3])], names=["budget"], widths=[1.6]),
            static=True,
        )
        log(
            RATE,
            rr.SeriesLines(colors=[int(palette.ink[2])], names=["ticks a second"], widths=[1.6]),
            static=True,
        )

    def tick(self, event: Ticked) -> None:
        """Add a tick. The budget is the usual time between ticks.

        The budget's line is drawn once a tick has taken a tenth of it, because a line far above would flatten
        the curve. Until then only the legend shows the budget.
        """
        before, self._before = self._before, event
        self._duration.add(event.t, event.wall, event.duration_ns / 1e6)
        self._worst = max(self._worst, event.duration_ns)
        if before is None or event.t <= before.t:
            return
        self._periods.append((event.t - before.t) // max(1, event.tick - before.tick))
        self._rate.add(event.t, event.wall, 1e9 / self._periods[-1])
        budget = int(median(self._periods))
        if abs(budget - self._budget_ns) > self._budget_ns // 20:
            self._budget_ns = budget
            name = f"tick (budget {budget / 1e6:.4g} ms)"
            look = rr.SeriesLines(colors=[self._palette.laser], names=[name], widths=[1.6])
            self._rows.log(TICK_MS, look, static=True)
        if self._worst * 10 > self._budget_ns:
            self._budget.add(event.t, event.wall, self._budget_ns / 1e6)
