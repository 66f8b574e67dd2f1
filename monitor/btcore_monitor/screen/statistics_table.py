"""How often each node came to which result, and how long it ran: a table beside the tree."""

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
"""The least time (of the tree's clock) between two tables."""
ROWS_AT_MOST: Final = 60
PATH_ROOM: Final = 56
"""Characters of a path, which tells leaves of a big tree apart."""
_INDENT: Final = "\u2003"


class StatisticsTable:
    """Counts results and time running of every node of a tree, as seen.

    What happened while nobody looked isn't counted; a node that was RUNNING when it was first seen runs from
    then on. Trees of more than ROWS_AT_MOST nodes show the leaves that ran longest, then the most frequent.
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
        """The nodes stand as in *statuses* from *t* on; what went before is not known."""
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
        """A row for *t* if it is time for one."""
        if self._next is None or t >= self._next:
            self.show(t, wall)

    def show(self, t: int, wall: int) -> None:
        """A row for *t* if anything changed, or runs."""
        if self._fresh or (self._since and t != self._shown_at):
            self._fresh = False
            self._shown_at = t
            self._next = t + EVERY_NS
            self._series.add(t, wall, self.markdown(t))

    def markdown(self, t: int) -> str:
        """The table as of *t* (ns)."""
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
            told = f"{ended}" + (f" + {skipped} skipped" if skipped else "")
            each = f"{seconds / ended:.2f} s" if ended and seconds else "–"
            name = _INDENT * self._depth[node.uid] + node.name if indented else elide(node.path, PATH_ROOM)
            ran = f"{seconds:.1f} s" if seconds else "–"
            lines.append(f"| {escape_markdown(name)} | {told} | {rate} | {ran} | {each} |")
        if not indented:
            lines += ["", f"*the {len(nodes)} leaves that ran longest, of {len(self._nodes)} nodes*"]
        return "\n".join(lines)
