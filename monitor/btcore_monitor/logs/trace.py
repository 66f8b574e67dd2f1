"""Writing trace events, a JSON file for Perfetto and chrome://tracing.

The events are those of BehaviorTree.CPP 4's MinitraceLogger (src/loggers/bt_minitrace_logger.cpp). Unlike
there, names are escaped, all slices are closed, and the file is valid JSON after each tick.
"""

import json
import os
from pathlib import Path
from typing import Final

from btcore.clock import NS_PER_US
from btcore.logs.files import create, write_whole
from btcore.logs.formats import LogFormat
from btcore.logs.log import Log
from btcore.status import FAILURE, RUNNING, SUCCESS, NodeType, Status, Transition
from btcore.tree.tree import Tree, parents_of
from btcore.xml.models.tree_nodes_model import TAG_OF

_HEAD: Final = b'{"traceEvents":[\n'
_TAIL: Final = b"\n]}\n"
_CATEGORIES: Final = {**TAG_OF, NodeType.UNDEFINED: "Undefined"}


class TraceLog(Log):
    """A log of a tree as trace events.

    A slice is a period in which a node is RUNNING; it also ends when the node is halted. An instant is a
    SUCCESS or FAILURE of a node that was not RUNNING before. Times are µs of the tree's clock since the start
    of the log. `args` contains the node's path and UID, and its new status. A slice is on the lane
    (thread of the trace) of its parent if it can be nested there, else on a separate lane.

    Args:
        tree: The tree to log.
        path: The file; an existing file is overwritten.

    Raises:
        LogError: The file cannot be written.

    Examples:
        >>> import btcore
        >>> from btcore_monitor.logs import TraceLog
        >>> b = btcore.Builder()
        >>> tree = b.build(b.AlwaysSuccess())
        >>> with TraceLog(tree, "trace.json"):
        ...     tree.tick_while_running()
        <Status.SUCCESS: 2>
    """

    def __init__(self, tree: Tree, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._labels = {
            node.config.uid: (
                _CATEGORIES[node.spec.node_type],
                json.dumps(node.name),
                f'"uid":{node.config.uid},"path":{json.dumps(node.config.path)}',
            )
            for node in tree.nodes
        }
        self._lanes = SliceLanes(parents_of(tree))
        self._pid = os.getpid()
        self._end = len(_HEAD)
        super().__init__(tree, str(self.path))
        self._file = create(self.path, _HEAD + _TAIL)
        self.attach()

    def write(self, changes: list[Transition]) -> None:
        """Append the events for the transitions *changes*."""
        events: list[str] = []
        for change in changes:
            self._add_events(change, (change.stamp - self.start) // NS_PER_US, events)
        self._append(events)

    def finish(self) -> None:
        """Close the slices of nodes that are still RUNNING."""
        now = (self.tree.clock.now() - self.start) // NS_PER_US
        events = [
            self._event(uid, "E", lane, now, f'"status":"{RUNNING.name}"') for uid, lane in self._lanes.open()
        ]
        self._append(events)

    def release(self) -> None:
        """Close the file."""
        self._file.close()

    def _append(self, events: list[str]) -> None:
        if not events:
            return
        begin = b"" if self._end == len(_HEAD) else b",\n"
        data = begin + ",\n".join(events).encode("ascii")
        # The end of the JSON document is overwritten, and written again in the same call.
        self._file.seek(self._end)
        write_whole(self._file, data + _TAIL)
        self._end += len(data)

    def _add_events(self, change: Transition, now: int, events: list[str]) -> None:
        _, _, _, uid, previous, status = change
        if status is RUNNING:
            events.append(self._event(uid, "B", self._lanes.begin(uid), now))
        elif uid in self._lanes:
            self._close(uid, status, now, events)
        elif previous is not RUNNING and (status is SUCCESS or status is FAILURE):
            lane = self._lanes.lane(uid)
            events.append(self._event(uid, "I", lane, now, f'"status":"{status.name}"'))

    def _close(self, uid: int, status: Status, now: int, events: list[str]) -> None:
        lane, inner = self._lanes.end(uid)
        # Slices inside the closed slice must end before it; they continue as new slices on other lanes.
        for inner_uid in reversed(inner):
            events.append(self._event(inner_uid, "E", lane, now, f'"status":"{RUNNING.name}"'))
        events.append(self._event(uid, "E", lane, now, f'"status":"{status.name}"'))
        for inner_uid in inner:
            events.append(self._event(inner_uid, "B", self._lanes.begin(inner_uid), now))

    def _event(self, uid: int, phase: str, lane: int, now: int, status: str = "") -> str:
        category, name, address = self._labels[uid]
        # Perfetto merges the arguments of the begin (B) and end (E) events of a slice.
        arguments = address if phase == "B" else status if phase == "E" else f"{address},{status}"
        return (
            f'{{"cat":"{category}","pid":{self._pid},"tid":{lane},"ts":{now},"ph":"{phase}",'
            f'"name":{name},"args":{{{arguments}}}}}'
        )


class SliceLanes:
    """The assignment of open slices to lanes, which are numbered from 1.

    In trace events, slices of the same thread must be properly nested. Slices of nodes need not be: the
    first child of a Parallel may complete before the second. Therefore a new slice is placed on its parent's
    lane only if the parent is the innermost slice there, else on a free lane.

    Args:
        parents: The UID of each node's parent.
    """

    def __init__(self, parents: dict[int, int]) -> None:
        self._parents = parents
        self._stacks: list[list[int]] = []
        self._lane: dict[int, int] = {}

    def lane(self, uid: int) -> int:
        """Return the lane for an instant of node *uid*: its own lane, its parent's, or 1."""
        if uid in self._lane:
            return self._lane[uid]
        return self._lane.get(self._parents.get(uid, 0), 1)

    def begin(self, uid: int) -> int:
        """Open the slice of node *uid*, and return its lane."""
        parent = self._parents.get(uid, 0)
        lane = self._lane.get(parent, 0)
        if not lane or self._stacks[lane - 1][-1] != parent:
            lane = next((lane for lane, stack in enumerate(self._stacks, 1) if not stack), 0)
            if not lane:
                self._stacks.append([])
                lane = len(self._stacks)
        self._stacks[lane - 1].append(uid)
        self._lane[uid] = lane
        return lane

    def end(self, uid: int) -> tuple[int, list[int]]:
        """Close the slice of node *uid* and all slices inside it.

        Returns:
            The lane, and the nodes of the inner slices, the outermost first. The caller may open new slices
            for them.
        """
        lane = self._lane[uid]
        stack = self._stacks[lane - 1]
        depth = stack.index(uid)
        inner = stack[depth + 1 :]
        del stack[depth:]
        for closed in (uid, *inner):
            del self._lane[closed]
        return lane, inner

    def open(self) -> list[tuple[int, int]]:
        """Return the open slices as (UID, lane), in an order in which they can be closed."""
        return [(uid, lane) for lane, stack in enumerate(self._stacks, 1) for uid in reversed(stack)]

    def __contains__(self, uid: int) -> bool:
        return uid in self._lane


FORMAT: Final = LogFormat(TraceLog, None)
