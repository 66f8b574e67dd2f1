"""Breakpoints and injected statuses in a running robot, from code: for tests of it, and for ``btcore hook``.

    with BreakpointClient("tcp://robot.local:1667") as robot:
        robot.break_at("Patrol/Move*")
        reached = robot.wait()
        robot.release(reached.path, "FAILURE")

Any robot that speaks Groot 2's protocol will do; btcore's wants ``allow_control``. A robot disables its
hooks, and goes on, when it gets no request for 5 s: an open :class:`BreakpointClient` sends a request every
second.
Times are in s of wall clock.
"""

import contextlib
import threading
import time
from collections.abc import Iterable
from difflib import get_close_matches
from fnmatch import fnmatchcase
from typing import Final, NamedTuple

import zmq
from zmq.utils.monitor import recv_monitor_message

from btcore_monitor.closeable import Closeable
from btcore_monitor.errors import MonitorError
from btcore_monitor.events import STATUS_NAMES, ObservedNode, ObservedTree
from btcore_monitor.watch.address import AddressError, parse_address
from btcore_monitor.watch.groot2_client import Groot2Client, NoReplyError
from btcore_monitor.wire import groot2
from btcore_monitor.wire.errors import ProtocolError, RobotRefusedError
from btcore_monitor.wire.fulltree import read_fulltree
from btcore_monitor.wire.groot2 import Reply, Request
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

DEFAULT_TIMEOUT: Final = 5.0
"""How long the robot has to come, or to come to a breakpoint, if nothing else is said."""

KEEP_ALIVE_EVERY: Final = 1.0

Socket = zmq.Socket[bytes]


class BreakpointError(MonitorError):
    """What was asked of a robot can't be had; the message says why, and what may help."""


class HookReached(NamedTuple):
    """A hook of this node fired; if it is a breakpoint, the tree stands there."""

    uid: int
    path: str


class RequestedHook(NamedTuple):
    """What was asked for, to be set again where the robot comes back with another tree."""

    pattern: str
    hook: WireHook


def find_nodes(tree: ObservedTree, pattern: str) -> list[ObservedNode]:
    """The nodes whose path or name is *pattern*, or else fits it (``*``, ``?``, ``[…]``), in order.

    Raises :class:`BreakpointError`, with what may have been meant.
    """
    found = [one for one in tree.nodes if pattern in (one.path, one.name)]
    found = found or [
        one for one in tree.nodes if fnmatchcase(one.path, pattern) or fnmatchcase(one.name, pattern)
    ]
    if found:
        return found
    known = list(dict.fromkeys(text for one in tree.nodes for text in (one.path, one.name)))
    folded = {text.casefold(): text for text in reversed(known)}
    near = get_close_matches(pattern.casefold(), folded, n=1)
    hint = f"; did you mean '{folded[near[0]]}'?" if near else f" (it is called '{tree.name}')"
    raise BreakpointError(f"the tree has no node '{pattern}'{hint}")


class BreakpointClient(Closeable):
    """Control of the robot at *address*; use it from one thread, and close it, or use ``with``.

    The robot may come *timeout* s later. Raises :class:`BreakpointError`, as every method does: no robot
    there, hooks not allowed, no such node.
    """

    def __init__(self, address: str = "", timeout: float = DEFAULT_TIMEOUT) -> None:
        try:
            self.address = parse_address(address)
        except AddressError as fault:
            raise BreakpointError(str(fault)) from None
        self._client = Groot2Client(self.address, timeout)
        self._asking = threading.RLock()
        self._requested: list[RequestedHook] = []
        self._tree: ObservedTree | None = None
        self._closed = threading.Event()
        self._context: zmq.Context[Socket] = zmq.Context()
        self._notices = self._context.socket(zmq.SUB)
        self._notices.setsockopt(zmq.LINGER, 0)
        self._notices.setsockopt(zmq.SUBSCRIBE, b"")
        self._thread = threading.Thread(target=self._keep_alive, name="btcore-breakpoints", daemon=True)
        try:
            _ = self.tree
            self._client.timeout = DEFAULT_TIMEOUT
            self._subscribe(timeout)
        except BaseException:
            self._free()
            raise
        self._thread.start()

    # --- looking

    @property
    def tree(self) -> ObservedTree:
        """The tree that the robot runs."""
        with self._asking:
            if self._tree is None:
                reply = self._reply(Request.FULLTREE, None)
                self._tree = read_fulltree(reply.body, reply.tree_id)
            return self._tree

    def status(self, path: str) -> str:
        """The status of the one node of that path or name: ``RUNNING``, …"""
        found = find_nodes(self.tree, path)
        if len(found) > 1:
            raise BreakpointError(
                f"'{path}' is {len(found)} nodes: {', '.join(one.path for one in found[:8])}"
            )
        return self.statuses()[found[0].path]

    def statuses(self) -> dict[str, str]:
        """Path → status, of all nodes."""
        records = groot2.decode_statuses(self._ask(Request.STATUS).body)
        nodes = self.tree.by_uid
        return {nodes[uid].path: STATUS_NAMES[one.status] for uid, one in records.items() if uid in nodes}

    def hooks(self) -> list[WireHook]:
        """All hooks of the robot, whoever set them: those before a tick first."""
        return decode_hooks(self._ask(Request.HOOKS_DUMP).body)

    def path_of(self, uid: int) -> str:
        """The path of node *uid*."""
        node = self.tree.by_uid.get(uid)
        return f"node {uid}" if node is None else node.path

    # --- setting

    def break_at(self, *patterns: str, after: bool = False, once: bool = False) -> list[str]:
        """Set a breakpoint before (or *after*) every tick of the nodes that fit; returns their paths.

        With *once* each goes when it was released. In a robot that comes back with another tree they
        are set again, as far as they fit.
        """
        hook = WireHook(0, POST if after else PRE, BREAKPOINT, once)
        return self._set([RequestedHook(pattern, hook) for pattern in patterns])

    def inject(self, pattern: str, status: str | int, *, after: bool = False, once: bool = True) -> list[str]:
        """Let the next tick (without *once*: every tick) of the nodes that fit end with *status*.

        *status* is SUCCESS or FAILURE (as text or number); it takes the place of the tick, or, with
        *after*, of the tick's result. Returns their paths.
        """
        hook = WireHook(0, POST if after else PRE, REPLACE, once, _overriding(status))
        return self._set([RequestedHook(pattern, hook)])

    def release(self, pattern: str = "*", status: str | int | None = None, remove: bool = False) -> list[str]:
        """Let go the tick that stands at a breakpoint of the nodes that fit, or comes there next.

        With *status* (SUCCESS or FAILURE) its node gets that from then on; with *remove* the breakpoint
        goes. Returns the paths of the nodes.
        """
        wanted = NO_STATUS if status is None else _overriding(status)
        found = self._found(pattern, BREAKPOINT)
        if not found:
            raise BreakpointError(f"there is no breakpoint at '{pattern}': {self._told()}")
        for one in found:
            with contextlib.suppress(_HookGoneError):
                unlocking = BreakpointUnlock(one.uid, one.position, wanted, remove)
                self._ask(Request.BREAKPOINT_UNLOCK, encode_unlocking(unlocking))
        return [self.path_of(one.uid) for one in found]

    def clear(self, pattern: str = "*") -> list[str]:
        """Take the hooks of the nodes that fit away; a tick that stands there goes on. Returns the paths."""
        if pattern == "*":
            found = self.hooks()
            self._requested.clear()
            self._ask(Request.REMOVE_ALL_HOOKS)
        else:
            found = self._found(pattern)
            if not found:
                raise BreakpointError(f"there is no hook at '{pattern}': {self._told()}")
            self._requested = [request for request in self._requested if request.pattern != pattern]
            for one in found:
                with contextlib.suppress(_HookGoneError):
                    self._ask(Request.HOOK_REMOVE, encode_place(one.uid, one.position))
        return [self.path_of(one.uid) for one in found]

    def disable(self) -> None:
        """Disable all hooks; a tick that stands at one goes on."""
        self._ask(Request.DISABLE_ALL_HOOKS)

    # --- waiting

    def wait(self, timeout: float = DEFAULT_TIMEOUT) -> HookReached:
        """The next hook that fires, or has fired since the last call. Raises after *timeout* s too."""
        reached = self.poll(timeout)
        if reached is None:
            raise BreakpointError(f"no breakpoint was reached within {timeout:g} s: {self._told()}")
        return reached

    def poll(self, timeout: float = 0.0) -> HookReached | None:
        """As :meth:`wait`, but None after *timeout* s."""
        deadline = time.monotonic() + timeout
        while self._notices.poll(max(0, round(1000 * (deadline - time.monotonic()))), zmq.POLLIN):
            with contextlib.suppress(ProtocolError):
                uid = groot2.decode_breakpoint_reached(self._notices.recv_multipart())
                return HookReached(uid, self.path_of(uid))
        return None

    def step(self, ticks: int = 1, timeout: float = DEFAULT_TIMEOUT) -> HookReached:
        """Let the tree do *ticks* ticks of its root, then stand before the next one.

        The first call lets the tree come to a stand. Returns where it stands then: before the root, or at
        another breakpoint on the way. Raises if that takes longer than *timeout* s a tick.
        """
        root = self.tree.root
        if not any(one.enabled for one in self._found(root.path, BREAKPOINT) if one.position == PRE):
            self._set([RequestedHook(root.path, WireHook(root.uid))])
            self._stand(timeout)
        reached = HookReached(root.uid, root.path)
        for _ in range(ticks):
            self._ask(Request.BREAKPOINT_UNLOCK, encode_unlocking(BreakpointUnlock(root.uid, PRE)))
            reached = self._stand(timeout)
            if reached.uid != root.uid:
                break
        return reached

    def _stand(self, timeout: float) -> HookReached:
        """Wait for a breakpoint, passing over injected statuses."""
        deadline = time.monotonic() + timeout
        while True:
            reached = self.poll(max(0.0, deadline - time.monotonic()))
            if reached is None:
                raise BreakpointError(
                    f"the tree came to no other tick within {timeout:g} s: it is done, not ticked, or slow"
                )
            if any(one.uid == reached.uid and one.mode == BREAKPOINT for one in self.hooks()):
                return reached

    # --- asking

    def _set(self, requested: list[RequestedHook]) -> list[str]:
        paths: dict[str, None] = {}
        hooks: list[WireHook] = []
        for request in requested:
            nodes = find_nodes(self.tree, request.pattern)
            hooks += [request.hook._replace(uid=node.uid) for node in nodes]
            paths |= dict.fromkeys(node.path for node in nodes)
        self._ask(Request.HOOK_INSERT, encode_hooks(hooks))
        self._requested += [request for request in requested if not request.hook.once]
        return list(paths)

    def _found(self, pattern: str, *modes: int) -> list[WireHook]:
        """The hooks of nodes that fit *pattern*, of these modes (none: all)."""
        uids = {node.uid for node in find_nodes(self.tree, pattern)}
        return [one for one in self.hooks() if one.uid in uids and (not modes or one.mode in modes)]

    def _told(self) -> str:
        found = list(dict.fromkeys(self.path_of(one.uid) for one in self.hooks()))
        return f"the robot's hooks are at {_listed(found)}" if found else "the robot has no hooks"

    def _ask(self, kind: Request, body: bytes | None = None) -> Reply:
        with self._asking:
            tree = self.tree
            reply = self._reply(kind, body)
            if reply.tree_id != tree.tree_id:
                self._tree = None
                self._set_again()
            return reply

    def _set_again(self) -> None:
        """The robot came back with another tree: its hooks are gone."""
        hooks: list[WireHook] = []
        for request in self._requested:
            with contextlib.suppress(BreakpointError):
                nodes = find_nodes(self.tree, request.pattern)
                hooks += [request.hook._replace(uid=node.uid) for node in nodes]
        if hooks:
            self._reply(Request.HOOK_INSERT, encode_hooks(hooks))

    def _reply(self, kind: Request, body: bytes | None) -> Reply:
        try:
            return self._client.request(kind, body)
        except NoReplyError:
            raise BreakpointError(
                f"no robot answers at {self.address}: is it running, with Groot 2's protocol at that port?"
            ) from None
        except RobotRefusedError as refusal:
            if groot2.HOOKS_DISABLED in str(refusal):
                raise BreakpointError(
                    f"the robot at {self.address} doesn't let itself be controlled: start it with "
                    "--allow-control, or serve(…, allow_control=True)"
                ) from None
            if groot2.NO_SUCH_NODE in str(refusal):
                raise _HookGoneError(f"the hook is no longer there ({refusal})") from None
            raise BreakpointError(str(refusal)) from None
        except ProtocolError as fault:
            raise BreakpointError(str(fault)) from None

    def _keep_alive(self) -> None:
        while not self._closed.wait(KEEP_ALIVE_EVERY):
            with contextlib.suppress(BreakpointError, ProtocolError):
                self._ask(Request.STATUS)

    def _subscribe(self, timeout: float) -> None:
        """Connect to the notifications, and return when they would come."""
        watching = self._notices.get_monitor_socket(zmq.EVENT_HANDSHAKE_SUCCEEDED)
        try:
            self._notices.connect(self.address.at(1))
            if not watching.poll(max(1, round(1000 * timeout))):
                raise BreakpointError(
                    f"{self.address} answers, but its notifications at port {self.address.port + 1} can't be "
                    "had: does a firewall let only one port through?"
                )
            recv_monitor_message(watching)
        finally:
            self._notices.disable_monitor()
            watching.close(linger=0)

    def close(self) -> None:
        """Leave the robot; hooks that are not cleared are disabled by the robot itself, after 5 s."""
        if not self._closed.is_set():
            self._closed.set()
            self._thread.join()
            self._free()

    def _free(self) -> None:
        self._closed.set()
        self._client.close()
        self._notices.close(linger=0)
        self._context.term()


class _HookGoneError(BreakpointError):
    """A hook that somebody else took away meanwhile."""


def _overriding(status: str | int) -> str:
    names = dict(enumerate(STATUS_NAMES))
    name = names.get(status, str(status)) if isinstance(status, int) else status.upper()
    if name not in OVERRIDING:
        raise BreakpointError(f"'{status}' can't be injected: SUCCESS and FAILURE can")
    return name


def _listed(paths: Iterable[str]) -> str:
    known = list(paths)
    return ", ".join(known[:8]) + (f" and {len(known) - 8} more" if len(known) > 8 else "")
