"""Request the blackboards of a robot periodically, also of a robot that rejects a request for all of them."""

from typing import Any

from btcore_monitor.events import ObservedTree
from btcore_monitor.wire.groot2 import boards_by_path, encode_names
from btcore_monitor.wire.msgpack_values import Boards


class BlackboardPoller:
    """Creates the requests for the blackboards of *tree*, *rate* times per second (0: never).

    A request asks for the blackboards of all subtrees. BehaviorTree.CPP rejects this request if a subtree is
    named `ROOT` or if there are two outermost blackboards (`Groot2Publisher::generateBlackboardsDump`).
    Then the poller requests each blackboard separately.
    """

    def __init__(self, tree: ObservedTree, rate: float) -> None:
        self.next_request_at = 0.0 if rate > 0 else float("inf")
        """When the next request is due (monotonic s)."""
        self._interval = 1 / rate if rate > 0 else float("inf")
        self._main = tree.name
        self._groups = [[path or tree.name for path in tree.subtrees]]
        self._remaining: list[list[str]] = []
        self._requested: list[str] = []
        self._received: dict[str, dict[str, Any]] = {}
        self._last_boards: Boards | None = None

    def create_request(self, now: float) -> bytes:
        """Return the body of the next request, which the caller sends at *now* (monotonic s)."""
        if not self._remaining:
            self._remaining = list(self._groups)
            self._received = {}
        self._requested = self._remaining.pop(0)
        # Every blackboard is requested `rate` times per second, whether together or separately.
        self.next_request_at = now + self._interval / len(self._groups)
        return encode_names(self._requested)

    def store_reply(self, boards: dict[str, dict[str, Any]]) -> Boards | None:
        """Store the blackboards of a reply, by their names.

        Returns:
            All blackboards by path. None while replies for other blackboards are missing, or if no value has
            changed.
        """
        self._received |= boards
        if self._remaining:
            return None
        before, self._last_boards = self._last_boards, boards_by_path(self._received, self._main)
        return None if self._last_boards == before else self._last_boards

    def adapt_to_rejection(self) -> list[str]:
        """Change the requests after the robot rejected the last request.

        Returns:
            The names that are no longer requested.
        """
        self._remaining.clear()
        if len(self._requested) > 1:
            self._groups = [[name] for name in self._requested]
            self.next_request_at = 0.0
            return []
        self._groups = [group for group in self._groups if group != self._requested]
        if not self._groups:
            self.next_request_at = float("inf")
        return self._requested
