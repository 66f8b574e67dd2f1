"""The running tree that a page watches, and the protocol by which another package connects with it.

A package offers an extension under the entry point group `btcore.live`:

    [project.entry-points."btcore.live"]
    robot = "rover_driver.watching:RoverWatch"

The entry point names a class of settings. It needs no import of this module: the language server uses what
the protocols list, and `btcore.runs.live_state.LiveState`.
"""

import asyncio
import threading
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from types import MappingProxyType
from typing import Any, Final, Protocol

from btcore import entry_points
from btcore.errors import BtcoreError
from btcore.extras import install_command
from btcore.runs.live_state import LiveState
from btcore_studio.language.node_keys import KeyedNode, RunningCall, node_keys, running_calls

GROUP: Final = "btcore.live"
_POLL_S: Final = 0.1
"""Minimum time (s) between two states of the running tree."""
_END_S: Final = 20.0
"""Maximum time (s) for the end of a connection."""
_MAX_BREAKPOINTS: Final = 1_000
_MAX_ADDRESS: Final = 300
_MAX_COMMANDS: Final = 10
"""Maximum commands of a page that wait for the running tree."""
NOT_CONNECTED: Final = "no running tree is connected"


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

    def release(self, status: str = "") -> None:
        """Let a tree that waits at a breakpoint continue.

        Args:
            status: SUCCESS or FAILURE, which the node returns without being ticked; "" = it is ticked.
        """
        ...

    def set_entry(self, path: str, key: str, text: str) -> None:
        """Set an entry of a blackboard.

        Args:
            path: The path of the subtree; "" for the main tree.
            key: The key of the entry.
            text: The value, as in an attribute of a port.

        Raises:
            BtcoreError: The value is refused.
        """
        ...

    def replace_tree(self, xml: str) -> None:
        """Replace the tree between two ticks. It keeps its blackboard.

        Raises:
            BtcoreError: The XML is refused.
        """
        ...

    def close(self) -> None:
        """End the connection and remove its breakpoints. The tree continues."""
        ...


class LiveExtension(Protocol):
    """The settings of a package that connects pages with running trees.

    The class is derived from `btcore.Settings`: its fields are options of `btcore studio`, and
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


def find_extension() -> LiveExtension | None:
    """Return the extension of an installed package with its default settings, or None."""
    loaded, _ = entry_points.load(GROUP)
    return loaded[0].value() if loaded else None


class LiveTree:
    """The connection of a page with a running tree. All methods are called by the event loop's thread.

    Args:
        extension: Connects with running trees; None uses the installed extension.
        notify: Called with the parameters of `btcore/live` after each change.

    Attributes:
        refusal: Why the page may not change a running tree, or "".
    """

    def __init__(self, extension: LiveExtension | None, notify: Callable[[dict[str, Any]], None]) -> None:
        self.refusal = ""
        self._extension = extension
        self._notify_page = notify
        self._followed: _FollowedTree | None = None
        self._wanted: frozenset[str] = frozenset()

    def watch(self, address: str) -> None:
        """Connect with the running tree at *address*; "" ends the connection.

        Raises:
            BtcoreError: The address is invalid, or no installed package can connect.
        """
        connection = None
        if address:
            if self._extension is None:
                self._extension = find_extension()
            if self._extension is None:
                raise BtcoreError(f"running trees need btcore's monitor: {install_command('zmq')}")
            connection = self._extension.connect(address[:_MAX_ADDRESS])
        self.end()
        if connection is None:
            self._notify(_live_data("", None, {}, self._wanted, ""))
        else:
            self._followed = _FollowedTree(address, connection, self._wanted, self._notify, self._followed)

    def set_breakpoints(self, keys: Collection[str]) -> None:
        """Set breakpoints before the nodes with these keys, and remove all others of the page."""
        self._wanted = frozenset(sorted(keys)[:_MAX_BREAKPOINTS])
        if self._followed is None or self._followed.is_ended:
            self._notify(_live_data("", None, {}, self._wanted, ""))
        else:
            self._followed.set_breakpoints(self._wanted)

    async def release(self, status: str = "") -> None:
        """Let a tree that waits at a breakpoint continue.

        Args:
            status: SUCCESS or FAILURE, which the node returns without being ticked; "" = it is ticked.

        Raises:
            BtcoreError: No tree is connected, or *status* is given and the page may not change the tree.
        """
        if status and self.refusal:
            raise BtcoreError(self.refusal)
        await self._execute(lambda connection: connection.release(status))

    async def change(self, change: Callable[[LiveConnection], None]) -> None:
        """Change the running tree.

        Args:
            change: Changes it, on the thread of the connection.

        Raises:
            BtcoreError: The change is refused, or no tree is connected.
        """
        if self.refusal:
            raise BtcoreError(self.refusal)
        await self._execute(change)

    async def _execute(self, command: "_Command") -> None:
        if self._followed is None or self._followed.is_ended:
            raise BtcoreError(NOT_CONNECTED)
        await asyncio.wrap_future(self._followed.execute(command))

    def _notify(self, data: dict[str, Any]) -> None:
        if self.refusal:
            data["refusals"] = {
                **data["refusals"],
                **dict.fromkeys(("force", "values", "reload"), self.refusal),
            }
        self._notify_page(data)

    def end(self) -> None:
        """Let the connection end soon, which removes its breakpoints."""
        if self._followed is not None:
            self._followed.end()

    async def close(self) -> None:
        """End the connection, and wait for its end."""
        self.end()
        if self._followed is not None:
            await asyncio.to_thread(self._followed.wait)


_Command = Callable[[LiveConnection], None]


class _FollowedTree:
    """A running tree that a thread follows until `end` or a failure of the connection.

    Before it begins, the tree *before* ends.
    """

    def __init__(
        self,
        address: str,
        connection: LiveConnection,
        wanted: frozenset[str],
        notify: Callable[[dict[str, Any]], None],
        before: "_FollowedTree | None",
    ) -> None:
        self._before = before
        self._address = address
        self._connection = connection
        self._wanted = wanted
        self._notify = notify
        # What the page wants of the connection; the thread takes it.
        self._commands: deque[tuple[_Command, Future[None]]] = deque()
        self._ended = threading.Event()  # set by the event loop's thread only
        self._loop = asyncio.get_running_loop()
        notify({**_live_data(address, None, {}, wanted, ""), "scene": None})
        self._thread = threading.Thread(target=self._follow, daemon=True)
        self._thread.start()

    def set_breakpoints(self, wanted: frozenset[str]) -> None:
        self._wanted = wanted

    def execute(self, command: _Command) -> Future[None]:
        """Execute a command on the thread, unless the tree ends before."""
        if len(self._commands) >= _MAX_COMMANDS:
            raise BtcoreError("earlier commands still wait for the running tree")
        future: Future[None] = Future()
        self._commands.append((command, future))
        return future

    def end(self) -> None:
        self._ended.set()

    @property
    def is_ended(self) -> bool:
        return self._ended.is_set()

    def wait(self) -> None:
        self._thread.join(_END_S)

    def _follow(self) -> None:
        if self._before is not None:
            self._before.wait()
            self._before = None
        keys: dict[int, str] = {}
        calls: list[RunningCall] = []
        state: LiveState | None = None
        # What was published and set.
        shown: tuple[LiveState | None, frozenset[str]] = (None, frozenset())
        scene: object = None
        has_set: frozenset[str] = frozenset()
        try:
            while not self._ended.is_set():
                before, state = state, self._connection.poll(_POLL_S)
                wanted, has_other_nodes = self._wanted, before is None or state.nodes is not before.nodes
                if has_other_nodes:
                    nodes = [
                        KeyedNode(node.uid, node.parent, node.id, node.name, node.type == "subtree")
                        for node in state.nodes
                    ]
                    keys = node_keys(nodes)
                    calls = running_calls(nodes, keys, state.trees)
                    has_set = frozenset()
                if keys and wanted != has_set:
                    self._connection.set_breakpoints([uid for uid, key in keys.items() if key in wanted])
                    has_set = wanted
                self._execute_commands()
                if state is not shown[0] or wanted != shown[1]:
                    shown = state, wanted
                    moved, scene = state.scene is not scene, state.scene
                    more = {"scene": scene} if moved else {}
                    self._publish(state, keys, wanted, calls if has_other_nodes else None, more=more)
        except BtcoreError as error:
            self._publish(state, keys, self._wanted, calls, str(error))
        finally:
            try:
                self._connection.close()
            finally:
                self._call_soon(self._finish)

    def _execute_commands(self) -> None:
        while self._commands:
            command, future = self._commands.popleft()
            if not future.set_running_or_notify_cancel():
                continue
            try:
                command(self._connection)
            except Exception as error:
                future.set_exception(error)
            else:
                future.set_result(None)

    def _finish(self) -> None:
        """Refuse further commands, and those that the thread left."""
        self._ended.set()
        for _, future in self._commands:
            if future.set_running_or_notify_cancel():
                future.set_exception(BtcoreError(NOT_CONNECTED))

    def _call_soon(self, function: Callable[[], None]) -> None:
        """Call a function on the event loop's thread."""
        with suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(function)

    def _publish(
        self,
        state: LiveState | None,
        keys: dict[int, str],
        wanted: frozenset[str],
        calls: list[RunningCall] | None,
        failure: str = "",
        more: Mapping[str, object] = MappingProxyType({}),
    ) -> None:
        data = {**_live_data(self._address, state, keys, wanted, failure), **more}
        if calls is not None:
            data["calls"] = [call._asdict() for call in calls]
            data["keys"] = [keys.get(node.uid, "") for node in state.nodes] if state is not None else []

        def notify() -> None:
            if not self._ended.is_set():
                self._notify(data)

        self._call_soon(notify)


def _live_data(
    address: str, state: LiveState | None, keys: Mapping[int, str], wanted: Collection[str], failure: str
) -> dict[str, Any]:
    """Return the parameters of `btcore/live`, except the keys and the calls."""
    data: dict[str, Any] = {
        "address": address,
        "connection": "waiting" if address else "",
        "detail": "",
        "problem": "",
        "statuses": "",
        "results": "",
        "entries": [],
        "wanted": sorted(wanted),
        "breakpoints": [],
        "stopped": "",
        "raised": "",
        "refusals": {},
    }
    if state is not None:
        uids = [node.uid for node in state.nodes]
        data |= {
            "connection": state.connection,
            "detail": state.detail,
            "problem": state.problem,
            "statuses": "".join(str(state.statuses.get(uid, 0)) for uid in uids),
            "results": "".join(str(state.results.get(uid, 0)) for uid in uids),
            "entries": list(state.entries),
            "breakpoints": [keys[uid] for uid in sorted(state.breakpoints) if uid in keys],
            "stopped": keys.get(state.stopped_at, ""),
            "raised": keys.get(state.raised_at, ""),
            # A status is forced at a breakpoint.
            "refusals": {**state.refusals, "force": state.refusals.get("breakpoints", "")}
            if state.refusals
            else {},
        }
    if failure:
        data |= {"connection": "lost", "detail": failure}
    return data
