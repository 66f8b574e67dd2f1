"""Control of a running tree by Groot 2's requests: breakpoints and injected statuses.

Whoever stops a robot has to stay with it: after a while without any request the hooks are disabled,
and a tick that stands at a breakpoint goes on. The next request enables them again.
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

MAX_HEARTBEAT_DELAY: Final = 5.0
"""Seconds (wall clock) without a request after which hooks are disabled: BehaviorTree.CPP's default."""

_NOTICES_AT_MOST: Final = 1000
"""Notifications that wait for the publisher; older ones are dropped."""


class RequestRejectedError(MonitorError):
    """A request that gets an error reply; the message is its text."""


class HookController:
    """Sets the hooks of one tree. Belongs to the publisher's thread, but for :meth:`close`.

    *max_heartbeat_delay* is in s of wall clock.
    """

    def __init__(self, tree: Tree, max_heartbeat_delay: float = MAX_HEARTBEAT_DELAY) -> None:
        self._hooks = tree.hooks
        self._delay = max_heartbeat_delay
        self._heard_at = time.monotonic()
        self._alone = False
        # Its own: the robot's leaves may want the same random numbers in every run.
        self._random = random.Random()
        self._fired: deque[int] = deque(maxlen=_NOTICES_AT_MOST)
        self._lock = threading.Lock()
        self._closed = False
        self._leave = self._hooks.subscribe(self._note)

    def _note(self, hook: Hook) -> None:
        self._fired.append(hook.uid)

    def close(self) -> None:
        """Take all hooks away, for good; from any thread."""
        with self._lock:
            if not self._closed:
                self._closed = True
                self._leave()
                self._hooks.remove_all()

    def on_request(self) -> None:
        """A request came, whichever."""
        self._heard_at = time.monotonic()
        if self._alone:
            self._alone = False
            self._hooks.enable_all(True)

    def notices(self) -> list[list[bytes]]:
        """The notifications that are due; also looks whether somebody is still there."""
        if not self._alone and time.monotonic() - self._heard_at >= self._delay:
            self._alone = True
            self._hooks.enable_all(False)
        found = []
        while self._fired:
            found.append(encode_breakpoint_reached(self._fired.popleft(), self._random.getrandbits(32)))
        return found

    def answer(self, kind: Request, body: bytes) -> bytes | None:
        """Do what a request of :data:`~btcore_monitor.wire.groot2.HOOKS` asks; the second frame of its reply.

        Raises :class:`RequestRejectedError`, or :class:`~btcore_monitor.wire.nlohmann_json.JsonError`.
        """
        with self._lock:
            if self._closed:
                raise RequestRejectedError(groot2.HOOKS_DISABLED)
            if kind is Request.HOOKS_DUMP:
                return encode_dump(map(_on_wire, self._hooks.all()))
            if kind is Request.REMOVE_ALL_HOOKS:
                self._hooks.remove_all()
            elif kind is Request.DISABLE_ALL_HOOKS:
                self._hooks.enable_all(False)
            elif kind is Request.HOOK_INSERT:
                for one in decode_hooks(body):
                    # as the original, which accepts a hook for a node that is not there
                    self._hooks.insert(_in_engine(one))
            elif kind is Request.HOOK_REMOVE:
                place = decode_place(body)
                if not self._hooks.remove(place.uid, HookPosition(place.position)):
                    raise RequestRejectedError(groot2.NO_SUCH_NODE)
            else:
                asked = decode_unlocking(body)
                status = Status[asked.desired_status]
                if not self._hooks.unlock(
                    asked.uid, HookPosition(asked.position), status, asked.remove_when_done
                ):
                    raise RequestRejectedError(groot2.NO_SUCH_NODE)
        return None


def _in_engine(hook: WireHook) -> Hook:
    return Hook(
        hook.uid,
        HookPosition(hook.position),
        HookMode(hook.mode),
        Status[hook.desired_status],
        hook.once,
        hook.enabled,
    )


def _on_wire(hook: Hook) -> WireHook:
    return WireHook(
        hook.uid, int(hook.position), int(hook.mode), hook.once, hook.desired_status.name, hook.enabled
    )
