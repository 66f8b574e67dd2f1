"""Set breakpoints and inject statuses in a running robot, for tests and for `btcore hook`.

    with BreakpointClient("tcp://robot.local:1667") as robot:
        robot.break_at("Patrol/Move*")
        reached = robot.wait()
        robot.release(reached.path, "FAILURE")

This works with every robot that supports Groot 2's protocol; a btcore robot also needs `allow_control`. A
robot disables the hooks of a client and continues after 5 s without its requests, so an open
`BreakpointClient` sends a request every second. Times are in s of wall clock.
"""

import contextlib
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator
from fnmatch import fnmatchcase
from typing import Final, NamedTuple

import zmq

from btcore.suggestions import did_you_mean
from btcore_monitor.closeable import Closeable
from btcore_monitor.errors import MonitorError
from btcore_monitor.events import STATUS_NAMES, ObservedNode, ObservedTree
from btcore_monitor.keys import ClientKeys
from btcore_monitor.watch.address import AddressError, parse_address
from btcore_monitor.watch.groot2_client import Groot1DetectedError, Groot2Client, NoReplyError
from btcore_monitor.watch.handshakes import ConnectionRefusedByRobotError
from btcore_monitor.wire import groot2
from btcore_monitor.wire.errors import ProtocolError, RobotRefusedError
from btcore_monitor.wire.fulltree import read_fulltree
from btcore_monitor.wire.groot2 import Request
from btcore_monitor.wire.hooks import (
    BREAKPOINT,
    NO_STATUS,
    OVERRIDING,
    POST,
    PRE,
    REPLACE,
    BreakpointUnlock,
    WireHook,
    decode_hooks,
    encode_hooks,
    encode_place,
    encode_unlocking,
)

__all__ = ["BreakpointClient", "BreakpointError", "HookReached", "RequestedHook", "find_nodes"]

DEFAULT_TIMEOUT_S: Final = 5.0
"""Default maximum time in s to connect to the robot, or until it reaches a breakpoint."""

KEEP_ALIVE_INTERVAL_S: Final = 1.0
"""Seconds between requests that keep the robot's hooks enabled."""

_POLL_INTERVAL_S: Final = 0.1
"""Maximum seconds until a thread that waits for notifications uses a new subscription."""

_MAX_NOTIFICATION_BYTES: Final = 1_000
"""Maximum bytes of a notification, because the other program may not be a robot."""

Socket = zmq.Socket[bytes]


class BreakpointError(MonitorError):
    """A request to a robot failed. The message has the reason and, if possible, a hint."""


class HookReached(NamedTuple):
    """The uid and the path of a node whose hook fired. If the hook is a breakpoint, the tree now waits.

    Attributes:
        uid: The number of the node in the tree.
        path: The path of the node.
    """

    uid: int
    path: str


class RequestedHook(NamedTuple):
    """A hook that was requested for all nodes that match *pattern*; the uid in *hook* is not used.

    The hook is set again if the robot comes back with another tree.
    """

    pattern: str
    hook: WireHook


def find_nodes(tree: ObservedTree, pattern: str) -> list[ObservedNode]:
    """Return the nodes whose path or name equals *pattern*, in the tree's order.

    If no path or name equals the pattern, return the nodes that match it as a wildcard pattern.

    Args:
        tree: The tree to search.
        pattern: A path or name, or a pattern with `*`, `?` and `[…]`.

    Raises:
        BreakpointError: No node matches. The message suggests a similar name.

    Examples:
        >>> from btcore_monitor.breakpoints import find_nodes
        >>> from btcore_monitor.events import ObservedNode, ObservedTree
        >>> door = ObservedNode(1, "door", "AlwaysSuccess", "action", "door")
        >>> tree = ObservedTree("0" * 32, "Main", (door,))
        >>> [node.path for node in find_nodes(tree, "d*")]
        ['door']
    """
    # Equality first: a name may itself contain a character of the pattern syntax.
    nodes = [node for node in tree.nodes if pattern in (node.path, node.name)]
    nodes = nodes or [
        node for node in tree.nodes if fnmatchcase(node.path, pattern) or fnmatchcase(node.name, pattern)
    ]
    if nodes:
        return nodes
    known = dict.fromkeys(text for node in tree.nodes for text in (node.path, node.name))
    hint = did_you_mean(pattern, known) or f" (it is called '{tree.name}')"
    raise BreakpointError(f"the tree has no node '{pattern}'{hint}")


class BreakpointClient(Closeable):
    """A client that sets and releases the hooks of a robot: its breakpoints and injected statuses.

    Use the client from one thread. Close it, or use it in a `with` statement.

    Args:
        address: The robot's address, as in `parse_address`.
        timeout: Maximum time in s (wall clock) to connect to the robot. Later requests wait for a reply for
            at most DEFAULT_TIMEOUT_S.
        keys: The keys of the client, if the robot requires keys.

    Raises:
        BreakpointError: The address is invalid, or no robot answers there. All methods raise this exception
            if a request fails, for example because the robot does not allow control.

    Examples:
        >>> import btcore
        >>> from btcore_monitor.breakpoints import BreakpointClient
        >>> from btcore_monitor.serve import serve
        >>> b = btcore.Builder()
        >>> tree = b.build(b.AlwaysSuccess(name="door"))
        >>> with serve(tree, groot2_port=0, allow_control=True) as publisher:
        ...     with BreakpointClient(publisher.address) as robot:
        ...         _ = robot.inject("door", "FAILURE")
        ...         status = tree.tick_once()
        >>> status
        <Status.FAILURE: 3>
    """

    def __init__(
        self, address: str = "", timeout: float = DEFAULT_TIMEOUT_S, keys: ClientKeys | None = None
    ) -> None:
        try:
            self.address = parse_address(address)
        except AddressError as error:
            raise BreakpointError(str(error)) from None
        self._client = Groot2Client(self.address, timeout, keys=keys)
        # Reentrant, because `tree` is used inside requests. The keep-alive thread sends requests, too.
        self._lock = threading.RLock()
        self._requested: list[RequestedHook] = []
        self._tree: ObservedTree | None = None
        self._closed = threading.Event()
        self._keys = keys
        self._context: zmq.Context[Socket] = zmq.Context()
        self._subscriptions: deque[Socket] = deque()
        """The present subscription to notifications, and those to later trees, which `poll` uses next."""
        self._thread = threading.Thread(target=self._keep_alive, name="btcore-breakpoints", daemon=True)
        try:
            # The first request raises an error if there is no robot, before the thread starts.
            _ = self.tree
            self._client.timeout = DEFAULT_TIMEOUT_S
            self._subscriptions.append(self._subscribe(timeout))
        except BaseException:
            self._free()
            raise
        self._thread.start()

    # --- reading

    @property
    def tree(self) -> ObservedTree:
        """The robot's tree. It is requested again after the robot has replaced it."""
        with self._lock, self._convert_errors():
            if self._tree is None:
                reply = self._client.request(Request.FULLTREE)
                self._tree = read_fulltree(reply.body, reply.tree_id)
            return self._tree

    def status(self, path: str) -> str:
        """Return the status of a node as text, such as `RUNNING`.

        Args:
            path: The path or the name of the node, or a pattern that matches only this node.

        Raises:
            BreakpointError: No node matches *path*, several nodes match it, or the request fails.
        """
        nodes = find_nodes(self.tree, path)
        if len(nodes) > 1:
            raise BreakpointError(
                f"'{path}' matches {len(nodes)} nodes: {', '.join(node.path for node in nodes[:8])}"
            )
        return self.statuses()[nodes[0].path]

    def statuses(self) -> dict[str, str]:
        """Return the status of every node as text, such as `RUNNING`, by the node's path."""
        with self._convert_errors():
            records = groot2.decode_statuses(self._ask(Request.STATUS))
        nodes = self.tree.by_uid
        return {
            nodes[uid].path: STATUS_NAMES[record.status] for uid, record in records.items() if uid in nodes
        }

    def hooks(self) -> list[WireHook]:
        """Return all hooks of the robot, also those of other clients. Hooks before a tick come first."""
        with self._convert_errors():
            return decode_hooks(self._ask(Request.HOOKS_DUMP))

    def path_of(self, uid: int) -> str:
        """Return the path of the node *uid*, or `node UID` if the tree has no such node."""
        node = self.tree.by_uid.get(uid)
        return f"node {uid}" if node is None else node.path

    # --- setting

    def break_at(self, *patterns: str, after: bool = False, once: bool = False) -> list[str]:
        """Set breakpoints at all matching nodes.

        If the robot comes back with another tree, the breakpoints are set again at matching nodes.

        Args:
            patterns: Paths, names or patterns, as in `find_nodes`.
            after: Whether to stop after the node's tick instead of before it.
            once: Whether each breakpoint is removed when it is released.

        Returns:
            The paths of the matching nodes.

        Raises:
            BreakpointError: No node matches a pattern, or the request fails.
        """
        hook = WireHook(0, POST if after else PRE, BREAKPOINT, once)
        return self._set([RequestedHook(pattern, hook) for pattern in patterns])

    def inject(self, pattern: str, status: str | int, *, after: bool = False, once: bool = True) -> list[str]:
        """Inject a status into all matching nodes.

        Args:
            pattern: A path, a name or a pattern, as in `find_nodes`.
            status: SUCCESS or FAILURE, as text or as the number of BehaviorTree.CPP's enum NodeStatus.
            after: Whether the node is ticked and *status* replaces its result. If false, the node returns
                *status* without being ticked.
            once: Whether *status* is injected only at the next tick of each node, instead of at every tick.

        Returns:
            The paths of the matching nodes.

        Raises:
            BreakpointError: *status* is invalid, no node matches, or the request fails.
        """
        hook = WireHook(0, POST if after else PRE, REPLACE, once, _to_status_text(status))
        return self._set([RequestedHook(pattern, hook)])

    def release(self, pattern: str = "*", status: str | int | None = None, remove: bool = False) -> list[str]:
        """Release the breakpoints of matching nodes.

        A tick that waits at a breakpoint continues. If no tick waits there, the next tick passes the
        breakpoint without stopping.

        Args:
            pattern: A path, a name or a pattern, as in `find_nodes`.
            status: SUCCESS or FAILURE, which replaces the node's tick (or, at a breakpoint after the tick,
                its result). None replaces nothing.
            remove: Whether to remove the breakpoints.

        Returns:
            The paths of the nodes with a released breakpoint.

        Raises:
            BreakpointError: *status* is invalid, there is no breakpoint at a matching node, or the request
                fails.
        """
        desired = NO_STATUS if status is None else _to_status_text(status)
        hooks = self._find_breakpoints(pattern)
        if not hooks:
            raise BreakpointError(f"there is no breakpoint at '{pattern}': {self._format_hooks()}")
        for hook in hooks:
            with contextlib.suppress(_HookGoneError):
                unlocking = BreakpointUnlock(hook.uid, hook.position, desired, remove)
                self._ask(Request.BREAKPOINT_UNLOCK, encode_unlocking(unlocking))
        return [self.path_of(hook.uid) for hook in hooks]

    def clear(self, pattern: str = "*") -> list[str]:
        """Remove the hooks of matching nodes. A tick that waits at a removed breakpoint continues.

        Args:
            pattern: A path, a name or a pattern, as in `find_nodes`. `*` removes all hooks of the robot.

        Returns:
            The path of the node of each removed hook.

        Raises:
            BreakpointError: There is no hook at a matching node, or the request fails.
        """
        if pattern == "*":
            hooks = self.hooks()
            self._requested.clear()
            self._ask(Request.REMOVE_ALL_HOOKS)
        else:
            hooks = self._find_hooks(pattern)
            if not hooks:
                raise BreakpointError(f"there is no hook at '{pattern}': {self._format_hooks()}")
            self._requested = [request for request in self._requested if request.pattern != pattern]
            for hook in hooks:
                with contextlib.suppress(_HookGoneError):
                    self._ask(Request.HOOK_REMOVE, encode_place(hook.uid, hook.position))
        return [self.path_of(hook.uid) for hook in hooks]

    # --- single nodes, by their uid in the present tree

    def break_before(self, uids: Iterable[int]) -> None:
        """Set breakpoints before nodes of the present tree. A new tree of the robot does not get them.

        Args:
            uids: The numbers of the nodes.

        Raises:
            BreakpointError: The request fails.
        """
        hooks = [WireHook(uid) for uid in uids]
        if hooks:
            self._ask(Request.HOOK_INSERT, encode_hooks(hooks))

    def release_node(self, uid: int, status: str = "") -> None:
        """Let a tree that waits before the node *uid* continue.

        Args:
            uid: The number of the node.
            status: SUCCESS or FAILURE, which replaces the node's tick; "" replaces nothing.

        Raises:
            BreakpointError: *status* is invalid, or the request fails.
        """
        desired = _to_status_text(status) if status else NO_STATUS
        with contextlib.suppress(_HookGoneError):
            self._ask(Request.BREAKPOINT_UNLOCK, encode_unlocking(BreakpointUnlock(uid, PRE, desired)))

    def clear_node(self, uid: int) -> None:
        """Remove the breakpoint before the node *uid*. A tree that waits there continues.

        Raises:
            BreakpointError: The request fails.
        """
        with contextlib.suppress(_HookGoneError):
            self._ask(Request.HOOK_REMOVE, encode_place(uid, PRE))

    def disable(self) -> None:
        """Disable all hooks. A tick that waits at a breakpoint continues."""
        self._ask(Request.DISABLE_ALL_HOOKS)

    # --- waiting

    def wait(self, timeout: float = DEFAULT_TIMEOUT_S) -> HookReached:
        """Wait for the next hook that fires, and return it.

        Hooks that have fired since the last call are returned first, without waiting.

        Raises:
            BreakpointError: No hook fired within *timeout* s.
        """
        reached = self.poll(timeout)
        if reached is None:
            raise BreakpointError(f"no breakpoint was reached within {timeout:g} s: {self._format_hooks()}")
        return reached

    def poll(self, timeout: float = 0.0) -> HookReached | None:
        """Return the next hook as `wait` does, or None if no hook fires within *timeout* s."""
        deadline = time.monotonic() + timeout
        while True:
            while len(self._subscriptions) > 1:
                self._subscriptions.popleft().close()
            notifications = self._subscriptions[0]
            remaining = max(0.0, deadline - time.monotonic())
            if notifications.poll(round(1000 * min(remaining, _POLL_INTERVAL_S)), zmq.POLLIN):
                with contextlib.suppress(ProtocolError):
                    uid = groot2.decode_breakpoint_reached(notifications.recv_multipart())
                    return HookReached(uid, self.path_of(uid))
            # The robot may send invalid notifications without end.
            if time.monotonic() >= deadline:
                return None

    def step(self, ticks: int = 1, timeout: float = DEFAULT_TIMEOUT_S) -> HookReached:
        """Execute *ticks* ticks of the root, then stop before the next tick.

        If there is no breakpoint before the root's tick yet, first set it and wait until the tree reaches it.

        Args:
            ticks: The number of ticks.
            timeout: Maximum time in s per tick.

        Returns:
            Where the tree stopped: before the root, or at an earlier breakpoint.

        Raises:
            BreakpointError: A tick takes longer than *timeout*, or a request fails.
        """
        root = self.tree.root
        breakpoints = self._find_breakpoints(root.path)
        if not any(hook.enabled for hook in breakpoints if hook.position == PRE):
            self._set([RequestedHook(root.path, WireHook(root.uid))])
            self._wait_for_breakpoint(timeout)
        reached = HookReached(root.uid, root.path)
        for _ in range(ticks):
            self._ask(Request.BREAKPOINT_UNLOCK, encode_unlocking(BreakpointUnlock(root.uid, PRE)))
            reached = self._wait_for_breakpoint(timeout)
            if reached.uid != root.uid:
                break
        return reached

    def _wait_for_breakpoint(self, timeout: float) -> HookReached:
        """Return the next breakpoint that is reached. Hooks that inject statuses are ignored."""
        deadline = time.monotonic() + timeout
        while True:
            reached = self.poll(max(0.0, deadline - time.monotonic()))
            # Other hooks may fire without end.
            if reached is None or time.monotonic() > deadline:
                raise BreakpointError(
                    f"no tick began within {timeout:g} s: the tree has ended, is not ticked, or is slow"
                )
            if any(hook.uid == reached.uid and hook.mode == BREAKPOINT for hook in self.hooks()):
                return reached

    # --- requests

    def _set(self, requested: list[RequestedHook]) -> list[str]:
        hooks = [hook for request in requested for hook in self._resolve(request)]
        self._ask(Request.HOOK_INSERT, encode_hooks(hooks))
        self._requested += [request for request in requested if not request.hook.once]
        return list(dict.fromkeys(self.path_of(hook.uid) for hook in hooks))

    def _resolve(self, request: RequestedHook) -> list[WireHook]:
        """Return a hook for each node of the current tree that matches *request*."""
        return [request.hook._replace(uid=node.uid) for node in find_nodes(self.tree, request.pattern)]

    def _find_hooks(self, pattern: str) -> list[WireHook]:
        """Return the hooks of matching nodes."""
        uids = {node.uid for node in find_nodes(self.tree, pattern)}
        return [hook for hook in self.hooks() if hook.uid in uids]

    def _find_breakpoints(self, pattern: str) -> list[WireHook]:
        return [hook for hook in self._find_hooks(pattern) if hook.mode == BREAKPOINT]

    def _format_hooks(self) -> str:
        paths = list(dict.fromkeys(self.path_of(hook.uid) for hook in self.hooks()))
        more = f" and {len(paths) - 8} more" if len(paths) > 8 else ""
        return f"the robot's hooks are at {', '.join(paths[:8])}{more}" if paths else "the robot has no hooks"

    def _ask(self, kind: Request, body: bytes | None = None) -> bytes:
        """Send a request about the tree, and return the body of the reply."""
        with self._lock, self._convert_errors():
            tree = self.tree
            reply = self._client.request(kind, body)
            if reply.tree_id != tree.tree_id:
                self._use_new_tree()
            return reply.body

    def _use_new_tree(self) -> None:
        """Set the requested hooks in a new tree of the robot, which has other uids and no hooks yet.

        The robot may have been restarted. A SUB socket subscribes again only when its thread uses it, so that
        notifications would be lost: a new socket subscribes before the hooks are set.
        """
        self._subscriptions.append(self._subscribe(DEFAULT_TIMEOUT_S))
        self._tree = None
        hooks: list[WireHook] = []
        for request in self._requested:
            with contextlib.suppress(BreakpointError):
                hooks += self._resolve(request)
        if hooks:
            self._client.request(Request.HOOK_INSERT, encode_hooks(hooks))

    @contextlib.contextmanager
    def _convert_errors(self) -> Iterator[None]:
        """Convert the errors of a request and of its reply to BreakpointError."""
        try:
            yield
        except NoReplyError:
            raise BreakpointError(
                f"no robot answers at {self.address}: is it running, with Groot 2's protocol at that port?"
            ) from None
        except RobotRefusedError as refusal:
            if groot2.HOOKS_DISABLED in str(refusal):
                raise BreakpointError(
                    f"the robot at {self.address} does not allow control: start it with "
                    "--allow-control, or serve(…, allow_control=True)"
                ) from None
            if groot2.NO_SUCH_NODE in str(refusal):
                raise _HookGoneError(f"the hook is no longer there ({refusal})") from None
            raise BreakpointError(str(refusal)) from None
        except (Groot1DetectedError, ConnectionRefusedByRobotError) as error:
            raise BreakpointError(str(error)) from None
        except ProtocolError as error:
            raise BreakpointError(f"{self.address} sent an invalid reply: {error}") from None

    def _keep_alive(self) -> None:
        while not self._closed.wait(KEEP_ALIVE_INTERVAL_S):
            with contextlib.suppress(BreakpointError):
                self._ask(Request.STATUS)

    def _subscribe(self, timeout: float) -> Socket:
        """Return a socket for notifications when its connection is ready.

        A PUB socket drops messages while no subscriber is connected: without waiting, a notification of the
        first hook could be lost.
        """
        notifications = self._context.socket(zmq.SUB)
        notifications.setsockopt(zmq.LINGER, 0)
        notifications.setsockopt(zmq.MAXMSGSIZE, _MAX_NOTIFICATION_BYTES)
        notifications.setsockopt(zmq.SUBSCRIBE, b"")
        if self._keys is not None:
            self._keys.secure(notifications)
        watching = notifications.get_monitor_socket(zmq.EVENT_HANDSHAKE_SUCCEEDED)
        try:
            notifications.connect(self.address.at(1))
            is_ready = watching.poll(max(1, round(1000 * timeout)))
        finally:
            notifications.disable_monitor()
            watching.close(linger=0)
        if not is_ready:
            notifications.close()
            raise BreakpointError(
                f"{self.address} answers, but port {self.address.port + 1} for notifications does "
                "not: does a firewall block this port?"
            )
        return notifications

    def close(self) -> None:
        """Close the connection. After 5 s without a request, the robot disables the hooks that are left."""
        if not self._closed.is_set():
            self._closed.set()
            self._thread.join()
            self._free()

    def _free(self) -> None:
        self._closed.set()
        self._client.close()
        self._context.destroy(linger=0)


class _HookGoneError(BreakpointError):
    """Another client removed the hook in the meantime."""


def _to_status_text(status: str | int) -> str:
    names = dict(enumerate(STATUS_NAMES))
    name = names.get(status, str(status)) if isinstance(status, int) else status.upper()
    if name not in OVERRIDING:
        raise BreakpointError(f"cannot inject '{status}': use SUCCESS or FAILURE")
    return name
