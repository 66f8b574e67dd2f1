"""Requests of btcore that change a running tree, at the port of Groot 2's requests.

BehaviorTree.CPP has no such requests: its robots reply `Request not recognized`. The header is that of
Groot 2 (groot2.py). The kinds are punctuation, because those of BehaviorTree.CPP are letters.
"""

import json
from collections.abc import Mapping
from enum import IntEnum
from typing import Any, Final, NamedTuple

from btcore_monitor.wire.errors import ProtocolError
from btcore_monitor.wire.nlohmann_json import read_json, require_member, require_type

MAX_VALUE_CHARS: Final = 10_000
"""Maximum characters of a new value."""

MAX_XML_BYTES: Final = 1_000_000
"""Maximum bytes of the XML of a tree: the frame of a request has at most 1 MB."""

_MAX_REFUSALS: Final = 20
_MAX_REASON_CHARS: Final = 300

BREAKPOINTS: Final = "breakpoints"
VALUES: Final = "values"
RELOAD: Final = "reload"


class ChangeRequest(IntEnum):
    """The kinds of requests. The values are ASCII characters on the wire."""

    REFUSALS = ord("?")
    """What the robot refuses to this client."""
    SET_ENTRY = ord("=")
    """Set an entry of a blackboard."""
    REPLACE_TREE = ord("<")
    """Replace the tree by another between two ticks. The second frame is the XML."""


class NewValue(NamedTuple):
    """The content of a SET_ENTRY request.

    Attributes:
        path: The path of the subtree whose blackboard has the entry; "" for the main tree.
        key: The key of the entry.
        text: The value as text, as in an attribute of a port.
    """

    path: str
    key: str
    text: str


def encode_new_value(new: NewValue) -> bytes:
    """Return the second frame of SET_ENTRY."""
    return json.dumps(new._asdict()).encode()


def decode_new_value(body: bytes) -> NewValue:
    """Return the content of a SET_ENTRY request.

    Raises:
        JsonError: *body* is not JSON, or a member is missing or has another type.
    """
    value: Any = read_json(body)
    return NewValue(*(require_type(require_member(value, name), str) for name in NewValue._fields))


def encode_refusals(refusals: Mapping[str, str]) -> bytes:
    """Return the second frame of the reply to REFUSALS: by the kind of change, why it is refused, or ""."""
    return json.dumps(refusals).encode()


def decode_refusals(body: bytes) -> dict[str, str]:
    """Return the reasons in the reply to REFUSALS.

    Raises:
        ProtocolError: *body* is not such a reply.
    """
    value: Any = read_json(body)
    if not isinstance(value, dict) or not all(isinstance(reason, str) for reason in value.values()):
        raise ProtocolError("expected an object with reasons as text")
    return {name: reason[:_MAX_REASON_CHARS] for name, reason in list(value.items())[:_MAX_REFUSALS]}
