"""The panel with the present state as text: running leaves, failures, notes and contacts."""

from collections.abc import Iterable
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from btcore_monitor.events import (
    FAILURE,
    IDLE,
    RUNNING,
    STATUS_NAMES,
    DataMissed,
    DataSource,
    ExceptionRaised,
    ObservedTree,
    Ticked,
    TransitionsLost,
)
from btcore_monitor.screen.captions import distinct_names
from btcore_monitor.screen.markdown_text import brief, escape_markdown
from btcore_monitor.screen.row_buffer import RowBuffer, Series
from btcore_monitor.screen.tick_states import RESET_OFFSET, SHOWN_NAMES, TickStates
from btcore_scene import MovingScene

NOW: Final = "now"
_NAMES_AT_MOST: Final = 4
_CELL: Final = 28
"""Characters that always fit into a cell of the table; the viewer does not wrap cells."""


class NowPanel:
    """A few lines of text: running leaves, failed leaves, the robot's notes, its contacts, and the tick."""

    def __init__(self, rows: RowBuffer, tree: ObservedTree) -> None:
        self._series: Series[str] = rows.series(NOW, markdown_columns)
        self._leaf = np.array([not node.children for node in tree.nodes])
        leaves = [node for node in tree.nodes if not node.children]
        self._names = dict(zip(np.flatnonzero(self._leaf).tolist(), distinct_names(leaves), strict=True))
        self._contacts = ""
        self._notes: dict[str, str] = {}
        self._shown = ""
        self._source_lines: list[str] = []
        self._raised = ""
        self._root = STATUS_NAMES[IDLE]
        self._lost = self._holes = 0

    def show_source(self, source: DataSource) -> None:
        """Add lines for the data that the robot does not send."""
        self._source_lines = [f"| by | {source.name} |"] if source.unavailable else []
        if "exceptions" in source.unavailable:
            self._source_lines.append(f"| raised | {source.unavailable['exceptions']} |")

    def raised(self, event: ExceptionRaised, states: TickStates) -> None:
        """Show the last node that raised, immediately, because a tick that raises may be the last tick."""
        path, message = escape_markdown(event.path), escape_markdown(brief(event.message))
        self._raised = f"**{path}** raised at {event.t / 1e9:.2f} s: {message}"
        self._show(event.t, event.wall, states, self._root)

    def missing(self, event: TransitionsLost | DataMissed) -> None:
        """Count missing transitions."""
        if isinstance(event, TransitionsLost):
            self._lost += event.last - event.first + 1
        elif event.topic == "transitions":
            self._holes += 1

    def moving(self, data: MovingScene) -> None:
        """Keep the notes and the contacts of *data* for the next update."""
        self._notes.update(data.notes)
        if data.collisions is not None:
            self._contacts = f"{data.collisions} collisions · {data.grazes or 0} grazes"

    def tick(self, event: Ticked, states: TickStates) -> None:
        """Show the state after a tick."""
        self._show(event.t, event.wall, states, f"{STATUS_NAMES[event.status]}, tick {event.tick}")

    def moment(self, states: TickStates) -> None:
        """Show *states* of a robot that does not report its ticks."""
        self._show(states.t, states.wall, states, SHOWN_NAMES[int(states.shown[0])])

    def _show(self, t: int, wall: int, states: TickStates, root: str) -> None:
        self._root = root
        runs = states.shown == RUNNING
        failed = (states.shown == FAILURE) | (states.shown == RESET_OFFSET + FAILURE)
        short = {name: note for name, note in self._notes.items() if len(note) <= _CELL}
        # Long texts are outside the table, because the viewer wraps only lines outside tables.
        lines = [self._raised, ""] if self._raised else []
        lines += [f"| runs | {self._leaves(runs) or '–'} |", "|:--|:--|"]
        if (failed & self._leaf).any():
            lines.append(f"| failed | {self._leaves(failed)} |")
        lines += [f"| {name} | {note} |" for name, note in short.items()]
        if self._contacts:
            lines.append(f"| robot | {self._contacts} |")
        lines.append(f"| root | {root} |")
        lines += self._source_lines
        if self._lost:
            lines.append(f"| lost | {self._lost} transitions |")
        if self._holes:
            lines.append(f"| lost | transitions, {self._holes} times |")
        for name, note in self._notes.items():
            lines += [] if name in short else ["", f"{name}: {note}"]
        document = "\n".join(lines)
        if document != self._shown:
            self._shown = document
            self._series.add(t, wall, document)

    def _leaves(self, chosen: NDArray[np.bool_]) -> str:
        at = np.flatnonzero(chosen & self._leaf).tolist()
        text = ", ".join(f"**{escape_markdown(self._names[index])}**" for index in at[:_NAMES_AT_MOST])
        return text if len(at) <= _NAMES_AT_MOST else f"{text} and {len(at) - _NAMES_AT_MOST} more"


def markdown_columns(values: list[str]) -> Iterable[Any]:
    """Return columns with a markdown document in each row."""
    return rr.TextDocument.columns(text=values, media_type=["text/markdown"] * len(values))
