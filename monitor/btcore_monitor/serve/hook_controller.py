"""Control a running tree by Groot 2's requests: breakpoints and injected statuses.

A client that stops a robot must stay connected. After some time without any request of a client that inserted
a hook or released a breakpoint, the hooks are disabled, and a tick that waits at a breakpoint continues. The
timeout is the same as in BehaviorTree.CPP (`Groot2Publisher::heartbeatLoop`). There, the next request of
any client enables the hooks again, so that a client that only watches can stop the robot. Here, the hooks
stay disabled until a client inserts them again.
"""

import random
import threading
import time
from collections import deque
from typing import Final

from btcore.status import Status
from btcore.tree.hooks import Hook, HookMode, HookPosition
from btcore.tree.tree import Tree
from btcore_monitor.errors import MonitorError
from btcore_monitor.wire import groot2
from btcore_monitor.wire.groot2 import Request
from btcore_monitor.wire.hooks import (
    WireHook,
    decode_hooks,
    decode_place,
    decode_unlocking,
    encode_breakpoint_reached,
    encode_dump,
)

MAX_HEARTBEAT_DELAY_S: Final = 5.0
"""Seconds (wall clock) after which the hooks of silent clients are disabled: BehaviorTree.CPP's default."""

_MAX_NOTIFICATIONS: Final = 1000
"""Maximum notifications that wait for the publisher; the oldest are dropped."""


class RequestRejectedError(MonitorError):
    """A request is rejected. The message is the text of the error reply."""


class HookController:
    """Sets the hooks of one tree. Only the publisher's thread may use it, except for `close`.

    Args:
        tree: The tree to control.
        max_heartbeat_delay: Time in s (wall clock) without a request of a client that controls the tree,
            after which hooks are disabled.
    """

    def __init__(self, tree: Tree, max_heartbeat_delay: float = MAX_HEARTBEAT_DELAY_S) -> None:
        self._hooks = tree.hooks
        self._delay = max_heartbeat_delay
        # The last requests of the clients that inserted a hook or released a breakpoint.
        self._controlling: dict[bytes, float] = {}
        # A separate generator: leaves may seed the global generator to get the same numbers in every run.
        self._random = random.Random()
        self._fired_uids: deque[int] = deque(maxlen=_MAX_NOTIFICATIONS)
        self._lock = threading.Lock()
        self._is_closed = False
        self._unsubscribe = self._hooks.subscribe(lambda hook: self._fired_uids.append(hook.uid))

    def close(self) -> None:
        """Remove all hooks and reject later requests. Any thread may call this method."""
        with self._lock:
            if not self._is_closed:
                self._is_closed = True
                self._unsubscribe()
                self._hooks.remove_all()

    def on_request(self, client: bytes) -> None:
        """Restart the timeout of *client*, if it inserted a hook or released a breakpoint."""
        if client in self._controlling:
            self._controlling[client] = time.monotonic()

    def take_notifications(self) -> list[list[bytes]]:
        """Return the frames of new notifications.

        Disable the hooks if no client that controls the tree has sent a request within *max_heartbeat_delay*.
        """
        if self._controlling:
            oldest = time.monotonic() - self._delay
            self._controlling = {client: at for client, at in self._controlling.items() if at > oldest}
            if not self._controlling:
                self._hooks.enable_all(False)
        notifications = []
        while self._fired_uids:
            notifications.append(
                encode_breakpoint_reached(self._fired_uids.popleft(), self._random.getrandbits(32))
            )
        return notifications

    def answer(self, client: bytes, kind: Request, body: bytes) -> bytes | None:
        """Execute a request about hooks and return the second frame of its reply.

        Args:
            client: The client's connection.
            kind: The kind of request, a member of `HOOKS`.
            body: The request's second frame.

        Raises:
            RequestRejectedError: Hooks are disabled, or there is no such hook.
            JsonError: *body* is invalid (`JsonError`).
        """
        with self._lock:
            if self._is_closed:
                raise RequestRejectedError(groot2.HOOKS_DISABLED)
            if kind is Request.HOOKS_DUMP:
                return encode_dump(map(_to_wire_hook, self._hooks.all()))
            if kind is Request.REMOVE_ALL_HOOKS:
                self._hooks.remove_all()
            elif kind is Request.DISABLE_ALL_HOOKS:
                self._hooks.enable_all(False)
            elif kind is Request.HOOK_INSERT:
                hooks = decode_hooks(body)
                self._controlling[client] = time.monotonic()
                for hook in hooks:
                    # As in BehaviorTree.CPP, a hook of an unknown node is accepted and has no effect.
                    self._hooks.insert(_to_engine_hook(hook))
            elif kind is Request.HOOK_REMOVE:
                uid, position = decode_place(body)
                if not self._hooks.remove(uid, HookPosition(position)):
                    raise RequestRejectedError(groot2.NO_SUCH_NODE)
            else:
                unlock = decode_unlocking(body)
                status = Status[unlock.desired_status]
                if not self._hooks.unlock(
                    unlock.uid, HookPosition(unlock.position), status, unlock.remove_when_done
                ):
                    raise RequestRejectedError(groot2.NO_SUCH_NODE)
                self._controlling[client] = time.monotonic()
        return None


def _to_engine_hook(hook: WireHook) -> Hook:
    return Hook(
        hook.uid,
        HookPosition(hook.position),
        HookMode(hook.mode),
        Status[hook.desired_status],
        hook.once,
        hook.enabled,
    )


def _to_wire_hook(hook: Hook) -> WireHook:
    return WireHook(
        hook.uid, int(hook.position), int(hook.mode), hook.once, hook.desired_status.name, hook.enabled
    )
