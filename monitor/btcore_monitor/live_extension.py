"""The monitor's part of `btcore studio`: watch a running tree, set breakpoints in it, and change it.

Statuses and entries come from a `Feed`, so from any robot. Breakpoints need Groot 2's protocol, and changes a
robot of btcore.
"""

import json
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Final

from btcore.options import option
from btcore.runs.live_state import LiveState
from btcore.runs.settings import Settings
from btcore.suggestions import shortened
from btcore_monitor import events
from btcore_monitor.client_options import KeyOptions
from btcore_monitor.environment_checks import check_installed
from btcore_monitor.errors import MonitorError
from btcore_monitor.plan_view import PlanView
from btcore_monitor.wire.groot2 import DEFAULT_ADDRESS

if TYPE_CHECKING:
    from btcore_monitor.breakpoints import BreakpointClient
    from btcore_monitor.keys import ClientKeys
    from btcore_monitor.watch.change_client import ChangeClient

_PACKAGES: Final = ("zmq", "msgpack", "lxml")
_CONNECT_TIMEOUT_S: Final = 2.0
"""Maximum time (s) to connect for breakpoints. Meanwhile the statuses are not updated."""
_SCENE_INTERVAL_S: Final = 0.2
"""Minimum time (s) between two scenes."""
_MAX_ENTRIES: Final = 1_000
_MAX_VALUE: Final = 200
"""Maximum number of characters of a value."""


class RobotExtension(KeyOptions, Settings):
    """Connects the studio with any robot that the monitor can watch.

    It satisfies the protocol of the entry point group `btcore.live`, which the language server declares.

    Raises:
        SettingsError: An option has an invalid value.
        MonitorError: A package is not installed.
    """

    live: (
        Annotated[
            str,
            option(
                f"Watch the running tree at this address.  [address: {DEFAULT_ADDRESS}]",
                metavar="[ADDRESS]",
                bare_value=DEFAULT_ADDRESS,
            ),
        ]
        | None
    ) = None

    def __post_init__(self) -> None:
        if self.live or self.key_file is not None:
            check_installed(*_PACKAGES)
            self.read()

    @property
    def address(self) -> str:
        """The address of the running tree to watch from the start, or ""."""
        return self.live or ""

    def connect(self, address: str) -> "RobotConnection":
        """Return a connection to the robot at *address*.

        Raises:
            MonitorError: The address is invalid, or a package is not installed.
        """
        check_installed(*_PACKAGES)
        [keys] = self.read()
        return RobotConnection(address, keys)


class RobotConnection:
    """A connection of a page to a robot. Use it from one thread.

    Args:
        address: The robot's address, as in `parse_address`.
        keys: The keys of the client, if the robot requires keys.

    Raises:
        AddressError: *address* is invalid.
    """

    def __init__(self, address: str, keys: "ClientKeys | None" = None) -> None:
        # Imported here, because `btcore studio --help` needs no ZeroMQ.
        from btcore_monitor.watch.feed import Feed

        # Another monitor may read the recording of transitions, which only one client can read.
        self._feed = Feed(address, record=False, keys=keys)
        self._keys = keys
        self._robot: BreakpointClient | None = None
        self._changes: ChangeClient | None = None
        self._state = LiveState()
        self._tree_id: str | None = None
        self._statuses: dict[int, int] = {}
        self._results: dict[int, int] = {}
        self._last_root_status = 0
        self._error = ""
        self._has_new_status = False
        self._plan: PlanView | None = None
        self._has_moved = False
        self._next_scene = 0.0

    def poll(self, timeout: float) -> LiveState:
        """Return the state after *timeout* s, the same object if nothing has changed.

        Raises:
            MonitorError: The robot refuses the keys.
        """
        deadline = time.monotonic() + timeout
        while (left := deadline - time.monotonic()) > 0:
            for event in self._feed.poll(left):
                self._take(event)
        if self._has_new_status:
            self._has_new_status = False
            self._state = self._state._replace(statuses=dict(self._statuses), results=dict(self._results))
        self._poll_breakpoints()
        if self._plan is not None and self._has_moved and time.monotonic() >= self._next_scene:
            self._has_moved, self._next_scene = False, time.monotonic() + _SCENE_INTERVAL_S
            self._state = self._state._replace(scene=self._plan.data())
        if self._changes is not None and not self._state.refusals:
            self._state = self._state._replace(refusals=self._changes.read_refusals() or {})
        return self._state

    def _take(self, event: events.Event) -> None:
        state = self._state
        if isinstance(event, events.ConnectionEvent):
            detail = f"{event.detail}: {self._end()}" if event.state == "ended" else event.detail
            self._state = state._replace(connection=event.state, detail=detail)
        elif isinstance(event, events.TreeEvent):
            if event.tree.tree_id != self._tree_id:
                self._begin(event.tree)
            elif state.raised_at:
                self._state = state._replace(raised_at=0)
            self._error, self._last_root_status = "", 0
            self._note_root(event.statuses)
            self._statuses = dict(event.statuses)
            self._take_results(event.results)
            self._take_results(event.statuses)
            self._has_new_status = True
        elif isinstance(event, events.TransitionEvent):
            self._statuses[event.uid] = event.status
            self._take_results({event.uid: event.status})
            self._note_root({event.uid: event.status})
            self._has_new_status = True
        elif isinstance(event, events.ExceptionEvent):
            self._error = event.message
            raised_at = next((node.uid for node in state.nodes if node.path == event.path), 0)
            self._state = state._replace(raised_at=raised_at)
        elif isinstance(event, events.BlackboardEvent):
            self._state = state._replace(entries=_list_entries(event.boards))
        elif isinstance(event, events.StaticSceneEvent):
            self._plan, self._has_moved = PlanView(event.data), True
        elif isinstance(event, events.MovingSceneEvent) and self._plan is not None:
            self._plan.take_moving(event.data)
            self._has_moved = True
        elif isinstance(event, events.HooksEvent) and not state.breakpoints:
            self._state = state._replace(problem=event.warning)

    def _take_results(self, statuses: Mapping[int, int]) -> None:
        """Keep the statuses that are results, of nodes by their uid."""
        for uid, status in statuses.items():
            if status not in (events.IDLE, events.RUNNING):
                self._results[uid] = status

    def _note_root(self, statuses: Mapping[int, int]) -> None:
        """Note the last status of the root other than idle, which may be running."""
        status = statuses.get(self._state.nodes[0].uid, 0) if self._state.nodes else 0
        if status:
            self._last_root_status = status
        if status in (events.SUCCESS, events.FAILURE):
            self._error = ""

    def _end(self) -> str:
        """Return how the run has ended."""
        if self._error:
            return self._error.partition("\n")[0]
        if self._last_root_status in (events.IDLE, events.RUNNING):
            return "the tree did not complete"
        return f"the tree returned {events.STATUS_NAMES[self._last_root_status]}"

    def _begin(self, tree: events.ObservedTree) -> None:
        from btcore_monitor.watch.change_client import ChangeClient

        self._leave_robot()
        self._end_changes()
        self._changes = ChangeClient(self._feed.address, self._keys)
        self._tree_id, self._results = tree.tree_id, {}
        connection, detail, scene = self._state.connection, self._state.detail, self._state.scene
        calls = {node.uid: tree.subtrees.get(node.path, "") for node in tree.nodes if node.type == "subtree"}
        self._state = LiveState(connection, detail, tree.nodes, calls, scene=scene)

    # --- breakpoints

    def set_breakpoints(self, uids: Sequence[int]) -> None:
        """Set breakpoints before these nodes, and remove all others of this connection."""
        from btcore_monitor.breakpoints import BreakpointClient

        before = self._state.breakpoints
        if not uids and not before:
            return
        problem, present = "", before
        try:
            if self._robot is None:
                self._robot = BreakpointClient(str(self._feed.address), _CONNECT_TIMEOUT_S, self._keys)
            for uid in before.difference(uids):
                self._robot.clear_node(uid)
            self._robot.break_before(uid for uid in uids if uid not in before)
            present = frozenset(uids)
        except MonitorError as error:
            problem = str(error)
            self._leave_robot()
            present = frozenset()
        stopped = self._state.stopped_at if self._state.stopped_at in present else 0
        self._state = self._state._replace(breakpoints=present, stopped_at=stopped, problem=problem)

    def release(self, status: str = "") -> None:
        """Let a tree that waits at a breakpoint continue.

        Args:
            status: SUCCESS or FAILURE, which the node returns without being ticked; "" = it is ticked.
        """
        if self._robot is None or not self._state.stopped_at:
            return
        try:
            self._robot.release_node(self._state.stopped_at, status)
            self._state = self._state._replace(stopped_at=0, problem="")
        except MonitorError as error:
            self._state = self._state._replace(stopped_at=0, problem=str(error))

    def _poll_breakpoints(self) -> None:
        if self._robot is None:
            return
        reached = self._robot.poll()
        if reached is not None and reached.uid in self._state.breakpoints:
            self._state = self._state._replace(stopped_at=reached.uid)

    # --- changes

    def set_entry(self, path: str, key: str, text: str) -> None:
        """Set an entry of a blackboard, as `ChangeClient.set_entry`."""
        self._connected().set_entry(path, key, text)

    def replace_tree(self, xml: str) -> None:
        """Replace the tree, as `ChangeClient.replace_tree`."""
        self._connected().replace_tree(xml)

    def _connected(self) -> "ChangeClient":
        if self._changes is None or not self._state.refusals:
            raise MonitorError("no robot is connected")
        return self._changes

    def _end_changes(self) -> None:
        changes, self._changes = self._changes, None
        if changes is not None:
            changes.close()

    def _leave_robot(self) -> None:
        robot, self._robot = self._robot, None
        if robot is None:
            return
        try:
            for uid in self._state.breakpoints:
                robot.clear_node(uid)
        except MonitorError:
            pass  # the robot is gone, or disables the hooks itself after 5 s
        finally:
            robot.close()

    def close(self) -> None:
        """End the connection and remove its breakpoints. The robot continues."""
        self._leave_robot()
        self._end_changes()
        self._feed.close()


def _list_entries(boards: Mapping[str, Mapping[str, Any]]) -> tuple[tuple[str, str, str], ...]:
    """Return the entries as texts that are short enough for the page."""
    entries = [
        (path, key, "—" if value is None else _format_value(value))
        for path, board in boards.items()
        for key, value in sorted(board.items())
    ]
    return tuple(entries[:_MAX_ENTRIES])


def _format_value(value: object) -> str:
    return shortened(json.dumps(value, ensure_ascii=False, default=str), _MAX_VALUE)
