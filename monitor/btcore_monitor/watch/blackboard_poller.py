"""Request the blackboards of a robot periodically, also of a robot that rejects a request for all of them."""

from typing import Any

from btcore_monitor.events import ObservedTree
from btcore_monitor.wire.groot2 import boards_by_path, encode_names
from btcore_monitor.wire.msgpack_values import Boards, decode_boards


class BlackboardPoller:
    """Creates the requests for a robot's blackboards, *rate* times per second (0: never).

    A request asks for the blackboards of all subtrees. BehaviorTree.CPP rejects this request if a subtree is
    named `ROOT` or if there are two outermost blackboards (`Groot2Publisher::generateBlackboardsDump`).
    Then the poller requests each blackboard separately.
    """

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self.next_request_at = 0.0
        """When the next request is due (monotonic s)."""
        self._interval = 1 / rate if rate > 0 else float("inf")
        self._main = ""
        self._groups: list[list[str]] = []
        self._remaining: list[list[str]] = []
        self._requested: list[str] = []
        self._received: dict[str, dict[str, Any]] = {}
        self._last_boards: Boards | None = None

    def begin(self, tree: ObservedTree) -> None:
        """Poll the blackboards of *tree* from now on."""
        self._main = tree.name
        self._groups = [[path or tree.name for path in tree.subtrees]]
        self._remaining.clear()
        self._last_boards = None
        self.next_request_at = 0.0 if self.rate > 0 else float("inf")

    def create_request(self, now: float) -> bytes:
        """Return the body of the next request, which the caller sends at *now* (monotonic s)."""
        if not self._remaining:
            self._remaining = list(self._groups)
            self._received = {}
        self._requested = self._remaining.pop(0)
        # Every blackboard is requested `rate` times per second, whether together or separately.
        self.next_request_at = now + self._interval / len(self._groups)
        return encode_names(self._requested)

    def store_reply(self, body: bytes) -> Boards | None:
        """Store a reply to a request.

        Args:
            body: The body of the reply.

        Returns:
            All blackboards by path. None while replies for other blackboards are missing, or if no value has
            changed.

        Raises:
            ProtocolError: *body* is not a BLACKBOARD reply.
        """
        self._received |= decode_boards(body)
        if self._remaining:
            return None
        boards = boards_by_path(self._received, self._main)
        if boards == self._last_boards:
            return None
        self._last_boards = boards
        return boards

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
