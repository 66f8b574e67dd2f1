"""A client that changes a running tree: entries of its blackboards, and the tree itself."""

from collections.abc import Mapping
from typing import Final

from btcore_monitor.closeable import Closeable
from btcore_monitor.errors import MonitorError
from btcore_monitor.keys import ClientKeys
from btcore_monitor.watch.address import Address
from btcore_monitor.watch.groot2_client import Groot1DetectedError, Groot2Client, NoReplyError
from btcore_monitor.wire import groot2
from btcore_monitor.wire.changes import (
    BREAKPOINTS,
    MAX_XML_BYTES,
    RELOAD,
    VALUES,
    ChangeRequest,
    NewValue,
    decode_refusals,
    encode_new_value,
)
from btcore_monitor.wire.errors import ProtocolError, RobotRefusedError

_TIMEOUT_S: Final = 8.0
"""Maximum time (s, wall clock) for a reply: the robot refuses a change after 5 s."""

_MAX_REASON_CHARS: Final = 2_000

GROOT1: Final = "the robot uses Groot 1's protocol, which only shows the tree"
FOREIGN: Final = "only robots of btcore can do this: BehaviorTree.CPP's protocol has no such request"


class ChangeError(MonitorError):
    """A change was refused. The message has the reason."""


class ChangeClient(Closeable):
    """Requests changes of one robot. Use it from one thread.

    Args:
        address: The robot's address.
        keys: The keys of the client, if the robot requires keys.
    """

    def __init__(self, address: Address, keys: ClientKeys | None = None) -> None:
        self._client = Groot2Client(address, _TIMEOUT_S, keys=keys)
        self._client.send_request(ChangeRequest.REFUSALS)

    def read_refusals(self) -> Mapping[str, str] | None:
        """Return the reply to the request for refusals, which was sent at first, or None while it is pending.

        Returns:
            Why the robot refuses each kind of change (`BREAKPOINTS`, `VALUES`, `RELOAD`); "" if it does not.

        Raises:
            ConnectionRefusedByRobotError: The robot refuses the connection because of the keys.
        """
        try:
            reply = self._client.receive_reply()
            return None if reply is None else decode_refusals(reply.body)
        except RobotRefusedError:  # "Request not recognized"
            return {BREAKPOINTS: "", VALUES: FOREIGN, RELOAD: FOREIGN}
        except Groot1DetectedError:
            return dict.fromkeys((BREAKPOINTS, VALUES, RELOAD), GROOT1)
        except (NoReplyError, ProtocolError) as error:
            return dict.fromkeys((BREAKPOINTS, VALUES, RELOAD), str(error))

    def set_entry(self, path: str, key: str, text: str) -> None:
        """Set an entry of a blackboard.

        Args:
            path: The path of the subtree; "" for the main tree.
            key: The key of the entry.
            text: The value, as in an attribute of a port.

        Raises:
            ChangeError: The robot refuses the value, or does not reply.
        """
        self._request(ChangeRequest.SET_ENTRY, encode_new_value(NewValue(path, key, text)))

    def replace_tree(self, xml: str) -> None:
        """Replace the tree between two ticks. It keeps its blackboard.

        Raises:
            ChangeError: The XML has errors, or the robot refuses it or does not reply.
        """
        body = xml.encode("utf-8", "replace")
        if len(body) > MAX_XML_BYTES:
            raise ChangeError(f"the XML has more than {MAX_XML_BYTES:,} bytes")
        self._request(ChangeRequest.REPLACE_TREE, body)

    def _request(self, kind: ChangeRequest, body: bytes) -> None:
        try:
            self._client.request(kind, body)
        except RobotRefusedError as refusal:
            reason = FOREIGN if refusal.sentence == groot2.NOT_RECOGNIZED else refusal.sentence
            raise ChangeError(reason[:_MAX_REASON_CHARS]) from None
        except (NoReplyError, ProtocolError) as error:
            raise ChangeError(str(error)) from None

    def close(self) -> None:
        """Close the connection."""
        self._client.close()
