"""The state of a running tree, which extensions of the entry point group `btcore.live` return."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol


class LiveNode(Protocol):
    """A node of a running tree."""

    @property
    def uid(self) -> int:
        """The number of the node."""

    @property
    def parent(self) -> int:
        """The number of its parent, or 0."""

    @property
    def id(self) -> str:
        """The registration ID."""

    @property
    def name(self) -> str:
        """The instance name."""

    @property
    def path(self) -> str:
        """The full path."""

    @property
    def type(self) -> str:
        """ "subtree" if the node calls a tree, otherwise any other text."""


class LiveState(NamedTuple):
    """The state of a running tree.

    Attributes:
        connection: "waiting", "connected", "lost" or "ended".
        detail: A sentence about the connection; after the end of the run, also the result of the tree.
        nodes: The nodes of the tree in pre-order; another object if the tree is another.
        trees: The ID of the called tree by the uid of each SubTree node.
        statuses: The number of the status of each node by its uid: 0 is idle, 1 running, 2 success, 3 failure
            and 4 skipped.
        results: The number of the last status of each node other than idle and running, by its uid.
        entries: The entries of the blackboards as (path of the subtree, key, value as text).
        breakpoints: The uids of the nodes with a breakpoint of this connection.
        stopped_at: The uid of the node before which the tree waits, or 0.
        problem: Why the last breakpoint could not be set, or "".
        raised_at: The uid of the node that raised the last error, or 0.
        refusals: By "breakpoints", "values" and "reload", why the robot refuses them to this connection, or
            ""; empty until the robot has replied.
        scene: The robot and its world from above as JSON data, or None: "bodies", the lowest first, as (RGBA
            colour, [x, y, …]); "places" as (name, x, y); "poses" as (kind, [x, y, yaw, …]); and "scan", the
            echoes of the laser as [x, y, …]. Lengths are in m. Another object if something has moved.
    """

    connection: str = "waiting"
    detail: str = ""
    nodes: Sequence[LiveNode] = ()
    trees: Mapping[int, str] = {}
    statuses: Mapping[int, int] = {}
    results: Mapping[int, int] = {}
    entries: Sequence[tuple[str, str, str]] = ()
    breakpoints: frozenset[int] = frozenset()
    stopped_at: int = 0
    problem: str = ""
    raised_at: int = 0
    refusals: Mapping[str, str] = {}
    scene: Mapping[str, Any] | None = None
