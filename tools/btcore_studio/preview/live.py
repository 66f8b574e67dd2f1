"""The protocol by which another package connects the preview with running trees.

A package offers an extension under the entry point group `btcore.preview`:

    [project.entry-points."btcore.preview"]
    robot = "rover_driver.preview:RoverPreview"

The entry point names a class of settings. It needs no import of this module: the preview uses what the
protocols list.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Protocol


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
    def type(self) -> str:
        """ "subtree" if the node calls a tree, otherwise any other text."""


class LiveState(Protocol):
    """The state of a running tree."""

    @property
    def connection(self) -> str:
        """ "waiting", "connected", "lost" or "ended"."""

    @property
    def detail(self) -> str:
        """A sentence about the connection."""

    @property
    def nodes(self) -> Sequence[LiveNode]:
        """The nodes of the tree, each after its parent; another object if the tree is another."""

    @property
    def statuses(self) -> Mapping[int, int]:
        """The number of the status of each node by its uid.

        0 is idle, 1 running, 2 success, 3 failure and 4 skipped.
        """

    @property
    def results(self) -> Mapping[int, int]:
        """The number of the last status of each node other than idle and running, by its uid."""

    @property
    def entries(self) -> Sequence[tuple[str, str, str]]:
        """The entries of the blackboards as (path of the subtree, key, value as text)."""

    @property
    def breakpoints(self) -> Collection[int]:
        """The uids of the nodes with a breakpoint of this connection."""

    @property
    def stopped_at(self) -> int:
        """The uid of the node before which the tree waits, or 0."""

    @property
    def problem(self) -> str:
        """Why the last breakpoint could not be set, or ""."""


class LiveConnection(Protocol):
    """A connection to a running tree, used by one thread."""

    def poll(self, timeout: float) -> LiveState:
        """Return the state after *timeout* s, the same object if nothing has changed.

        Raises:
            BtcoreError: The tree can never be watched, for example because it refuses the keys.
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
    """The settings of a package that connects the preview with running trees.

    The class is derived from `btcore.Settings`: its fields are options of `btcore preview`, and
    `__post_init__` checks them.
    """

    @property
    def address(self) -> str:
        """The address of the running tree to watch from the start, or ""."""

    def connect(self, address: str) -> LiveConnection:
        """Return a connection to the running tree at *address*. It need not run yet.

        Args:
            address: The address, as a user wrote it.

        Raises:
            BtcoreError: The address is invalid, or a package is not installed.
        """
        ...
