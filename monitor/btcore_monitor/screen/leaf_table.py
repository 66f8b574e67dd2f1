"""The panel of the leaves of a recording: what each leaf read, wrote and returned in a tick."""

from collections.abc import Mapping
from typing import Final

from btcore_monitor.events import IDLE, STATUS_NAMES, LeavesEvent, ObservedTree
from btcore_monitor.screen.blackboard_table import format_value
from btcore_monitor.screen.captions import distinct_names
from btcore_monitor.screen.panels import create_markdown_columns, escape_markdown
from btcore_monitor.screen.row_buffer import RowBuffer, Series

LEAVES: Final = "leaves"
_MAX_LEAVES: Final = 40


class LeafTable:
    """The leaves of a tick as a table, in the order in which they were ticked."""

    def __init__(self, rows: RowBuffer, tree: ObservedTree) -> None:
        self._series: Series[str] = rows.create_series(LEAVES, create_markdown_columns)
        self._names = dict(zip((node.uid for node in tree.nodes), distinct_names(tree.nodes), strict=True))
        self.has_leaves = False
        """Whether leaves have been shown."""

    def show(self, event: LeavesEvent) -> None:
        """Show the leaves of a tick."""
        self.has_leaves = True
        lines = [f"| **tick {event.tick}** | result | inputs | outputs |", "|:--|:--|:--|:--|"]
        errors = []
        for uid, _, status, inputs, outputs, error in event.leaves[:_MAX_LEAVES]:
            name = escape_markdown(self._names.get(uid, "?"))
            result = STATUS_NAMES[status] if status != IDLE else "raised"
            lines.append(f"| {name} | {result} | {_format_values(inputs)} | {_format_values(outputs)} |")
            if error:
                errors += ["", f"**{name}** raised: {escape_markdown(error)}"]
        if len(event.leaves) > _MAX_LEAVES:
            errors += ["", f"*and {len(event.leaves) - _MAX_LEAVES} more leaves*"]
        self._series.add("\n".join([*lines, *errors]))


def _format_values(values: Mapping[str, str]) -> str:
    texts = (f"{name}: {format_value(value)}" for name, value in values.items())
    return ", ".join(f"`{escape_markdown(text)}`" for text in texts)
