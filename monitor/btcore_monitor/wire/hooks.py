"""Hooks on Groot 2's wire: breakpoints and injected statuses as JSON.

The format is that of BehaviorTree.CPP's ``groot2_protocol.h``.
"""

import json
from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

from btcore_monitor.events import STATUS_NAMES
from btcore_monitor.wire.groot2 import Request, RequestHeader
from btcore_monitor.wire.nlohmann_json import (
    JsonError,
    read_json,
    require_boolean,
    require_member,
    require_number,
    require_string,
)

PRE: Final = 0
"""Before the tick."""
POST: Final = 1
"""After the tick."""

BREAKPOINT: Final = 0
"""The tick stands until it is let go."""
REPLACE: Final = 1
"""The tick gets the desired status at once."""

NO_STATUS: Final = "SKIPPED"
"""As a desired status: the node is left to itself."""

OVERRIDING: Final = ("SUCCESS", "FAILURE")
"""The desired statuses that replace something."""


class WireHook(NamedTuple):
    """One hook: at most one before (*position* 0) and one after (1) the tick of a node."""

    uid: int
    position: int = PRE
    mode: int = BREAKPOINT
    once: bool = False
    desired_status: str = NO_STATUS
    enabled: bool = True


class HookLocation(NamedTuple):
    """Where a hook is."""

    uid: int
    position: int


class BreakpointUnlock(NamedTuple):
    """How a tick that stands at a breakpoint goes on."""

    uid: int
    position: int
    desired_status: str = NO_STATUS
    remove_when_done: bool = False


# requests


def encode_hooks(hooks: Sequence[WireHook]) -> bytes:
    """The second frame of HOOK_INSERT: an object for one hook, an array for several."""
    found = [
        {
            "enabled": one.enabled,
            "uid": one.uid,
            "mode": one.mode,
            "once": one.once,
            "desired_status": one.desired_status,
            "position": one.position,
        }
        for one in hooks
    ]
    return json.dumps(found[0] if len(found) == 1 else found).encode()


def encode_place(uid: int, position: int) -> bytes:
    """The second frame of HOOK_REMOVE."""
    return json.dumps({"uid": uid, "position": position}).encode()


def encode_unlocking(unlocking: BreakpointUnlock) -> bytes:
    """The second frame of BREAKPOINT_UNLOCK."""
    return json.dumps(unlocking._asdict()).encode()


def decode_hooks(body: bytes) -> list[WireHook]:
    """The hooks of a HOOK_INSERT; also those of a HOOKS_DUMP's reply. Raises :class:`JsonError`.

    A C++ publisher inserts those before the one that is wrong; here all is read before anything is done.
    """
    read = read_json(body)
    return [_hook(one) for one in (read if isinstance(read, list) else [read])]


def decode_place(body: bytes) -> HookLocation:
    """Where a HOOK_REMOVE wants a hook away. Raises :class:`JsonError`."""
    read = read_json(body)
    return HookLocation(require_number(require_member(read, "uid")), _position(read))


def decode_unlocking(body: bytes) -> BreakpointUnlock:
    """What a BREAKPOINT_UNLOCK asks for; any status but SUCCESS and FAILURE is NO_STATUS.

    Raises :class:`JsonError`.
    """
    read = read_json(body)
    uid = require_number(require_member(read, "uid"))
    status = require_string(require_member(read, "desired_status"))
    position = _position(read)
    remove = require_boolean(require_member(read, "remove_when_done"))
    return BreakpointUnlock(uid, position, status if status in OVERRIDING else NO_STATUS, remove)


def _hook(read: Any) -> WireHook:
    uid, position = require_number(require_member(read, "uid")), _position(read)
    enabled = require_boolean(require_member(read, "enabled"))
    mode = REPLACE if require_number(require_member(read, "mode")) else BREAKPOINT
    once = require_boolean(require_member(read, "once"))
    status = require_string(require_member(read, "desired_status"))
    if status not in STATUS_NAMES:
        raise JsonError(f"Cannot convert this to NodeStatus: {status}")
    return WireHook(uid, position, mode, once, status, enabled)


def _position(read: Any) -> int:
    return POST if require_number(require_member(read, "position")) else PRE


# replies and notifications


def encode_dump(hooks: Iterable[WireHook]) -> bytes:
    """The second frame of a HOOKS_DUMP's reply."""
    return json.dumps([one._asdict() for one in hooks], sort_keys=True, separators=(",", ":")).encode()


def encode_breakpoint_reached(uid: int, unique_id: int) -> list[bytes]:
    """The frames of the notification that a hook of node *uid* fires; *unique_id* is any 32 bits."""
    return [RequestHeader(Request.BREAKPOINT_REACHED, unique_id).encode(), str(uid).encode()]
