"""Asking for blackboards, again and again, and what to do about a robot that refuses."""

from typing import Any

from btcore_monitor.events import ObservedTree
from btcore_monitor.wire.groot2 import blackboard_name, boards_by_path, encode_names
from btcore_monitor.wire.msgpack_values import Boards, decode_boards


class BlackboardPoller:
    """The questions of one robot's blackboards, *rate* times a second (0: never).

    All subtrees are asked for at once. BehaviorTree.CPP refuses that where a subtree is called ``ROOT``
    or where there are two outermost blackboards; then each is asked for by itself.
    """

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self.due = 0.0
        """When the next question is due (monotonic s)."""
        self._every = 1 / rate if rate > 0 else float("inf")
        self._main = ""
        self._groups: list[list[str]] = []
        self._left: list[list[str]] = []
        self._asked: list[str] = []
        self._found: dict[str, dict[str, Any]] = {}
        self._shown: Boards | None = None

    def begin(self, tree: ObservedTree) -> None:
        """Ask for the blackboards of *tree* from now on."""
        self._main = tree.name
        self._groups = [[blackboard_name(path, tree.name) for path in tree.subtrees]]
        self._left.clear()
        self._shown = None
        self.due = 0.0 if self.rate > 0 else float("inf")

    def next_request(self, now: float) -> bytes:
        """What to ask for at *now* (monotonic s)."""
        if not self._left:
            self._left = list(self._groups)
            self._found = {}
        self._asked = self._left.pop(0)
        self.due = now + self._every / len(self._groups)
        return encode_names(self._asked)

    def answer(self, body: bytes) -> Boards | None:
        """All boards by path, if *body* was the last answer needed and they are others than before."""
        self._found |= decode_boards(body)
        if self._left:
            return None
        boards = boards_by_path(self._found, self._main)
        if boards == self._shown:
            return None
        self._shown = boards
        return boards

    def refused(self) -> list[str]:
        """The robot refused: ask otherwise. The names that will not be asked for any more."""
        self._left.clear()
        if len(self._asked) > 1:
            self._groups = [[name] for name in self._asked]
            self.due = 0.0
            return []
        self._groups = [group for group in self._groups if group != self._asked]
        if not self._groups:
            self.due = float("inf")
        return self._asked
