"""Hooks in Groot 2's protocol: breakpoints and injected statuses as JSON.

The format is defined by `include/behaviortree_cpp/loggers/groot2_protocol.h` of BehaviorTree.CPP.
"""

import json
from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

from btcore_monitor.events import STATUS_NAMES
from btcore_monitor.wire.groot2 import Request, RequestHeader
from btcore_monitor.wire.nlohmann_json import (
    JsonError,
    read_json,
    require_member,
    require_number,
    require_type,
)

PRE: Final = 0
"""Before the tick."""
POST: Final = 1
"""After the tick."""

BREAKPOINT: Final = 0
"""The tick waits until a client releases the breakpoint."""
REPLACE: Final = 1
"""The tick returns the desired status immediately."""

NO_STATUS: Final = "SKIPPED"
"""The desired status that replaces nothing: the node is ticked as usual."""

OVERRIDING: Final = ("SUCCESS", "FAILURE")
"""The desired statuses that replace the node's status."""


class WireHook(NamedTuple):
    """A hook of the node *uid*, with the *position* PRE or POST and the *mode* BREAKPOINT or REPLACE.

    A node has at most one hook before its tick and one hook after its tick.
    """

    uid: int
    position: int = PRE
    mode: int = BREAKPOINT
    once: bool = False
    desired_status: str = NO_STATUS
    enabled: bool = True


class BreakpointUnlock(NamedTuple):
    """The content of a BREAKPOINT_UNLOCK request: how a tick that waits at a breakpoint continues."""

    uid: int
    position: int
    desired_status: str = NO_STATUS
    remove_when_done: bool = False


# requests


def encode_hooks(hooks: Sequence[WireHook]) -> bytes:
    """Return the second frame of HOOK_INSERT: an object for one hook, an array for several."""
    # in the order of the recorded requests in tests/monitor/captures
    keys = ("enabled", "uid", "mode", "once", "desired_status", "position")
    objects = [{key: getattr(hook, key) for key in keys} for hook in hooks]
    return json.dumps(objects[0] if len(objects) == 1 else objects).encode()


def encode_place(uid: int, position: int) -> bytes:
    """Return the second frame of HOOK_REMOVE, for the hook of the node *uid* at *position* (PRE or POST)."""
    return json.dumps({"uid": uid, "position": position}).encode()


def encode_unlocking(unlocking: BreakpointUnlock) -> bytes:
    """Return the second frame of BREAKPOINT_UNLOCK."""
    return json.dumps(unlocking._asdict()).encode()


def decode_hooks(body: bytes) -> list[WireHook]:
    """Return the hooks in a HOOK_INSERT request or in the reply to HOOKS_DUMP.

    A C++ publisher inserts hooks while it reads them, so an invalid hook leaves the earlier hooks inserted.
    This function reads all hooks before the caller inserts any.

    Raises:
        JsonError: *body* is not JSON, or a hook is invalid.
    """
    value = read_json(body)
    return [_decode_hook(item) for item in (value if isinstance(value, list) else [value])]


def decode_place(body: bytes) -> tuple[int, int]:
    """Return the node's uid and the position (PRE or POST) of the hook that a HOOK_REMOVE request removes.

    Raises:
        JsonError: *body* is not JSON, or a member is missing or invalid.
    """
    value = read_json(body)
    return require_number(require_member(value, "uid")), _decode_position(value)


def decode_unlocking(body: bytes) -> BreakpointUnlock:
    """Return the content of a BREAKPOINT_UNLOCK request.

    Every status except SUCCESS and FAILURE becomes NO_STATUS, as in `groot2_publisher.cpp`.

    Raises:
        JsonError: *body* is not JSON, or a member is missing or invalid.
    """
    value = read_json(body)
    uid = require_number(require_member(value, "uid"))
    # In the order of groot2_publisher.cpp, which decides the first error of a request with several.
    status = require_type(require_member(value, "desired_status"), str)
    position = _decode_position(value)
    remove = require_type(require_member(value, "remove_when_done"), bool)
    return BreakpointUnlock(uid, position, status if status in OVERRIDING else NO_STATUS, remove)


def _decode_hook(value: Any) -> WireHook:
    uid, position = require_number(require_member(value, "uid")), _decode_position(value)
    enabled = require_type(require_member(value, "enabled"), bool)
    mode = REPLACE if require_number(require_member(value, "mode")) else BREAKPOINT
    once = require_type(require_member(value, "once"), bool)
    status = require_type(require_member(value, "desired_status"), str)
    if status not in STATUS_NAMES:
        raise JsonError(f"Cannot convert this to NodeStatus: {status}")
    return WireHook(uid, position, mode, once, status, enabled)


def _decode_position(value: Any) -> int:
    return POST if require_number(require_member(value, "position")) else PRE


# replies and notifications


def encode_dump(hooks: Iterable[WireHook]) -> bytes:
    """Return the second frame of the reply to HOOKS_DUMP."""
    # nlohmann::json sorts keys and writes no spaces
    return json.dumps([hook._asdict() for hook in hooks], sort_keys=True, separators=(",", ":")).encode()


def describe_hook(hook: WireHook, path: str) -> str:
    """Return *hook* as a phrase for users, such as `breakpoint before Main/Move (disabled)`.

    Args:
        path: The path of the hook's node.
    """
    words = [
        "breakpoint" if hook.mode == BREAKPOINT else "injects",
        "before" if hook.position == PRE else "after",
        path,
        hook.desired_status if hook.desired_status in OVERRIDING else "",
        "once" if hook.once else "",
        "" if hook.enabled else "(disabled)",
    ]
    return " ".join(filter(None, words))


def encode_breakpoint_reached(uid: int, unique_id: int) -> list[bytes]:
    """Return the frames of a notification that a hook has fired.

    Args:
        uid: The uid of the hook's node.
        unique_id: Any number of 32 bits.
    """
    return [RequestHeader(Request.BREAKPOINT_REACHED, unique_id).encode(), str(uid).encode()]
