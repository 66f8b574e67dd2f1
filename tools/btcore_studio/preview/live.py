"""The protocol by which another package connects the preview with running trees.

A package offers an extension under the entry point group `btcore.preview`:

    [project.entry-points."btcore.preview"]
    robot = "rover_driver.preview:RoverPreview"

The entry point names a class, which is created without arguments.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from btcore.errors import BtcoreError
from btcore_studio.preview.node_keys import KeyedNode

if TYPE_CHECKING:
    import click


class LiveError(BtcoreError):
    """Raised when a running tree cannot be watched or controlled; the message is shown on the page."""


class LiveState(NamedTuple):
    """The state of a running tree.

    Attributes:
        connection: "waiting", "connected", "lost" or "ended".
        detail: A sentence about the connection.
        nodes: The nodes of the tree, each after its parent.
        statuses: The number of the status of each node by its uid: 0 idle, 1 running, 2 success, 3 failure,
            4 skipped.
        results: The number of the last status of each node other than idle and running, by its uid.
        entries: The entries of the blackboards as (path of the subtree, key, value as text).
        breakpoints: The uids of the nodes with a breakpoint of this connection.
        stopped_at: The uid of the node before which the tree waits, or 0.
        problem: Why the last breakpoint could not be set, or "".
    """

    connection: str = "waiting"
    detail: str = ""
    nodes: tuple[KeyedNode, ...] = ()
    statuses: Mapping[int, int] = {}
    results: Mapping[int, int] = {}
    entries: tuple[tuple[str, str, str], ...] = ()
    breakpoints: frozenset[int] = frozenset()
    stopped_at: int = 0
    problem: str = ""


class LiveConnection(Protocol):
    """A connection to a running tree, used by one thread."""

    def poll(self, timeout: float) -> LiveState:
        """Return the state after *timeout* s, the same object if nothing has changed.

        Raises:
            LiveError: The tree can never be watched, for example because it refuses the keys.
        """
        ...

    def set_breakpoints(self, uids: Sequence[int]) -> None:
        """Set breakpoints before these nodes, and remove all others of this connection.

        A failure is reported in `LiveState.problem`.
        """
        ...

    def release(self) -> None:
        """Let a tree that waits at a breakpoint continue."""
        ...

    def close(self) -> None:
        """End the connection and remove its breakpoints. The tree continues."""
        ...


class PreviewExtension(Protocol):
    """A package that connects the preview with running trees."""

    options: Sequence["click.Option"]
    """The options that the extension adds to `btcore preview`."""

    def check(self, settings: Mapping[str, Any]) -> str:
        """Check the options, and return the address of the running tree to watch from the start, or "".

        Args:
            settings: The options of the command by their click names.

        Raises:
            click.UsageError: An option has an invalid value.
        """
        ...

    def connect(self, address: str, settings: Mapping[str, Any]) -> LiveConnection:
        """Return a connection to the running tree at *address*. It need not run yet.

        Args:
            address: The address, as a user wrote it.
            settings: The options of the command by their click names.

        Raises:
            LiveError: The address is invalid.
        """
        ...
