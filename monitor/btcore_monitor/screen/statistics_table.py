"""A table of each node's results, success rate and running time."""

from collections.abc import Mapping
from typing import Final

from btcore_monitor.events import IDLE, RUNNING, SUCCESS, ObservedTree, StatusChanged
from btcore_monitor.screen.font import elide
from btcore_monitor.screen.markdown_text import escape_markdown
from btcore_monitor.screen.now import markdown_columns
from btcore_monitor.screen.row_buffer import RowBuffer, Series
from btcore_monitor.screen.tree import leaves

STATISTICS: Final = "statistics"
EVERY_NS: Final = 1_000_000_000
"""Shortest time (ns of the tree's clock) between two updates."""
ROWS_AT_MOST: Final = 60
PATH_ROOM: Final = 56
"""Characters of a displayed path; big trees show paths to distinguish their leaves."""
_INDENT: Final = "\u2003"


class StatisticsTable:
    """The observed results and running times of every node of a tree.

    Only the time during which the monitor is connected counts. A node that is RUNNING at the connection
    counts from then on. Trees of more than ROWS_AT_MOST nodes show the leaves with the longest running time,
    then the leaves with the most results.
    """

    def __init__(self, rows: RowBuffer, tree: ObservedTree) -> None:
        self._series: Series[str] = rows.series(STATISTICS, markdown_columns)
        self._nodes = tree.nodes
        self._depth = {node.uid: tree.depth(node.uid) for node in tree.nodes}
        self._results: dict[int, list[int]] = {node.uid: [0, 0, 0] for node in tree.nodes}
        self._running_ns = dict.fromkeys(self._results, 0)
        self._since: dict[int, int] = {}
        self._next: int | None = None
        self._shown_at = 0
        self._fresh = False

    def start(self, t: int, wall: int, statuses: Mapping[int, int]) -> None:
        """Begin with known statuses; earlier changes are unknown.

        Args:
            t: Tree time (ns).
            wall: Wall time (ns).
            statuses: The nodes' statuses by uid.
        """
        self._since = {uid: t for uid, status in statuses.items() if status == RUNNING}
        self._fresh = True
        self.show(t, wall)

    def change(self, event: StatusChanged) -> None:
        """Count a transition."""
        counts = self._results.get(event.uid)
        if counts is None:
            return
        self._fresh = True
        since = self._since.pop(event.uid, None)
        if since is not None:
            self._running_ns[event.uid] += max(0, event.t - since)
        if event.status == RUNNING:
            self._since[event.uid] = event.t
        elif event.status != IDLE:
            counts[event.status - SUCCESS] += 1

    def look(self, t: int, wall: int) -> None:
        """Update the table at *t* (ns) if the last update is old enough."""
        if self._next is None or t >= self._next:
            self.show(t, wall)

    def show(self, t: int, wall: int) -> None:
        """Update the table at *t* (ns) if a node has changed or runs."""
        if self._fresh or (self._since and t != self._shown_at):
            self._fresh = False
            self._shown_at = t
            self._next = t + EVERY_NS
            self._series.add(t, wall, self.markdown(t))

    def markdown(self, t: int) -> str:
        """Return the table as of *t* (ns)."""
        running = {
            uid: ns + (max(0, t - self._since[uid]) if uid in self._since else 0)
            for uid, ns in self._running_ns.items()
        }
        nodes = list(self._nodes)
        indented = len(nodes) <= ROWS_AT_MOST
        if not indented:
            work = {one.uid: (running[one.uid], sum(self._results[one.uid])) for one in leaves(nodes)}
            seen = [one for one in nodes if any(work.get(one.uid, ()))]
            nodes = sorted(seen, key=lambda one: work[one.uid], reverse=True)[:ROWS_AT_MOST]
        lines = ["| node | results | success | running | a run |", "|:--|--:|--:|--:|--:|"]
        for node in nodes:
            succeeded, failed, skipped = self._results[node.uid]
            ended = succeeded + failed
            rate = f"{100 * succeeded / ended:.0f} %" if ended else "–"
            seconds = running[node.uid] / 1e9
            results = f"{ended}" + (f" + {skipped} skipped" if skipped else "")
            each = f"{seconds / ended:.2f} s" if ended and seconds else "–"
            name = _INDENT * self._depth[node.uid] + node.name if indented else elide(node.path, PATH_ROOM)
            ran = f"{seconds:.1f} s" if seconds else "–"
            lines.append(f"| {escape_markdown(name)} | {results} | {rate} | {ran} | {each} |")
        if not indented:
            lines += ["", f"*the {len(nodes)} leaves that ran longest, of {len(self._nodes)} nodes*"]
        return "\n".join(lines)
