"""Trace events: a file that Perfetto and chrome://tracing open (groot2.md §13).

As BehaviorTree.CPP 4's MinitraceLogger writes it, with names escaped, every slice ended, and the file
complete after each tick.
"""

import json
import os
from pathlib import Path
from typing import Final

from btcore.clock import NS_PER_US
from btcore.logs.files import create, write_whole
from btcore.logs.log import Log
from btcore.status import (
    FAILURE,
    RUNNING,
    SUCCESS,
    NodeType,
    Status,
    Transition,
)
from btcore.tree.tree import Tree

_HEAD: Final = b'{"traceEvents":[\n'
_TAIL: Final = b"\n]}\n"
_CATEGORIES: Final = {
    NodeType.ACTION: "Action",
    NodeType.CONDITION: "Condition",
    NodeType.CONTROL: "Control",
    NodeType.DECORATOR: "Decorator",
    NodeType.SUBTREE: "SubTree",
    NodeType.UNDEFINED: "Undefined",
}


class TraceLog(Log):
    """Writes to *path* what the nodes of *tree* do.

    A slice shows a node that is RUNNING, an instant a result that came at once.

    Times are µs of the tree's clock since the log began. A slice ends when its node leaves RUNNING,
    also when it is halted; ``args`` tell the node's path and uid, and the status it came to. Nodes that
    run at the same time are on lanes (threads) of their own. Raises LogError if the file can't be written.
    """

    def __init__(self, tree: Tree, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._labels = {
            node.uid: (
                _CATEGORIES[node.type],
                json.dumps(node.name),
                f'"uid":{node.uid},"path":{json.dumps(node.path)}',
            )
            for node in tree.nodes
        }
        parents = {child.uid: node.uid for node in tree.nodes for child in node.children}
        self._lanes = SliceLanes(parents)
        self._pid = os.getpid()
        self._end = len(_HEAD)
        super().__init__(tree, str(self.path))
        self._file = create(self.path, _HEAD + _TAIL)
        self.attach()

    def write(self, changes: list[Transition]) -> None:
        """Put the events of *changes* before the end of the document, which moves on."""
        events: list[str] = []
        for change in changes:
            self._tell(change, (change.stamp - self.start) // NS_PER_US, events)
        self._append(events)

    def finish(self) -> None:
        """End what is still RUNNING."""
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
        self._file.seek(self._end)
        write_whole(self._file, data + _TAIL)
        self._end += len(data)

    def _tell(self, change: Transition, now: int, events: list[str]) -> None:
        _, _, _, uid, previous, status = change
        if status is RUNNING:
            events.append(self._event(uid, "B", self._lanes.begin(uid), now))
        elif uid in self._lanes:
            self._close(uid, status, now, events)
        elif previous is not RUNNING and (status is SUCCESS or status is FAILURE):
            lane = self._lanes.lane(uid)
            events.append(self._event(uid, "I", lane, now, f'"status":"{status.name}"'))

    def _close(self, uid: int, status: Status, now: int, events: list[str]) -> None:
        lane, within = self._lanes.end(uid)
        for one in reversed(within):
            events.append(self._event(one, "E", lane, now, f'"status":"{RUNNING.name}"'))
        events.append(self._event(uid, "E", lane, now, f'"status":"{status.name}"'))
        for one in within:
            events.append(self._event(one, "B", self._lanes.begin(one), now))

    def _event(self, uid: int, phase: str, lane: int, now: int, more: str = "") -> str:
        category, name, address = self._labels[uid]
        known = address if phase == "B" else more if phase == "E" else f"{address},{more}"
        return (
            f'{{"cat":"{category}","pid":{self._pid},"tid":{lane},"ts":{now},"ph":"{phase}",'
            f'"name":{name},"args":{{{known}}}}}'
        )


class SliceLanes:
    """The lane of each node's open slice; lanes count from 1.

    In trace events, slices of the same thread must be properly nested. Slices of nodes need not be: the
    first child of a Parallel may complete before the second. So a slice is on its parent's lane only while
    the parent is innermost there, else on a free lane.
    """

    def __init__(self, parents: dict[int, int]) -> None:
        self._parents = parents
        self._stacks: list[list[int]] = []
        self._lane: dict[int, int] = {}

    def lane(self, uid: int) -> int:
        """Where something of node *uid* that takes no time is shown: with its parent, if that is open."""
        if uid in self._lane:
            return self._lane[uid]
        return self._lane.get(self._parents.get(uid, 0), 1)

    def begin(self, uid: int) -> int:
        """Open the slice of node *uid*; returns its lane."""
        parent = self._parents.get(uid, 0)
        place = self._lane.get(parent, 0)
        if not place or self._stacks[place - 1][-1] != parent:
            place = self._free()
        self._stacks[place - 1].append(uid)
        self._lane[uid] = place
        return place

    def end(self, uid: int) -> tuple[int, list[int]]:
        """Close the slice of node *uid*; returns its lane, and which slices lie within, the outermost first.

        Those are cut: they end with it, and may begin again elsewhere.
        """
        place = self._lane[uid]
        stack = self._stacks[place - 1]
        depth = stack.index(uid)
        within = stack[depth + 1 :]
        del stack[depth:]
        for one in (uid, *within):
            del self._lane[one]
        return place, within

    def open(self) -> list[tuple[int, int]]:
        """Every open slice as (node, lane), such that closing them in this order keeps the nesting."""
        return [(uid, place) for place, stack in enumerate(self._stacks, 1) for uid in reversed(stack)]

    def __contains__(self, uid: int) -> bool:
        return uid in self._lane

    def _free(self) -> int:
        for place, stack in enumerate(self._stacks, 1):
            if not stack:
                return place
        self._stacks.append([])
        return len(self._stacks)
