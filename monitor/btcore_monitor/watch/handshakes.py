"""Detects that a robot refuses a connection: a key that it does not know, or keys on one side only."""

import socket
import time
from typing import Any, Final

import zmq
from zmq.utils.monitor import parse_monitor_message

from btcore_monitor.errors import MonitorError
from btcore_monitor.keys import ClientKeys
from btcore_monitor.watch.address import Address

_EVENTS: Final = (
    zmq.EVENT_HANDSHAKE_SUCCEEDED
    | zmq.EVENT_HANDSHAKE_FAILED_AUTH
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
)
_PROBE_AFTER_FAILURES: Final = 3
"""Successive connections that the other program closes during the handshake before its mechanism is read."""

_PROBE_TIMEOUT_S: Final = 1.0
"""Maximum seconds (wall clock) to connect, and then to read the mechanism."""

_GREETING: Final = b"\xff\0\0\0\0\0\0\0\x01\x7f\x03"
"""The beginning of a greeting in ZMTP 3 (RFC 23): the signature and the version."""
_MECHANISM: Final = slice(12, 32)

Socket = zmq.Socket[bytes]


class ConnectionRefusedByRobotError(MonitorError):
    """The robot refused the connection because of the keys. Another attempt has the same result."""


class Handshakes:
    """Watches the handshakes of the connections to one robot.

    Args:
        address: The robot's address.
        keys: The keys of the client, if it uses keys.
    """

    def __init__(self, address: Address, keys: ClientKeys | None) -> None:
        self.events: Socket | None = None
        """The socket on which events arrive, for a poller; None before `watch`."""
        self._address = address
        self._keys = keys
        self._closed = 0

    def watch(self, connection: Socket) -> None:
        """Watch the connections of the socket *connection*, which is not connected yet."""
        self.events = connection.get_monitor_socket(_EVENTS)

    def leave(self, connection: Socket) -> None:
        """Stop watching *connection*, which the caller closes afterwards."""
        connection.disable_monitor()
        if self.events is not None:
            self.events.close(linger=0)
            self.events = None

    def check(self) -> None:
        """Process the events since the last call.

        Raises:
            ConnectionRefusedByRobotError: The robot refuses the connection.
        """
        while self.events is not None and self.events.poll(0):
            message: dict[str, Any] = dict(parse_monitor_message(self.events.recv_multipart()))
            reason = self._describe_refusal(message["event"])
            if reason:
                raise ConnectionRefusedByRobotError(f"{self._address} refused the connection: {reason}")

    def _describe_refusal(self, event: int) -> str:
        if event == zmq.EVENT_HANDSHAKE_SUCCEEDED:
            self._closed = 0
        elif event == zmq.EVENT_HANDSHAKE_FAILED_AUTH and self._keys is not None:
            return f"the robot does not know this key; the public key for --allow-key is {self._keys.public}"
        else:
            # If one side uses keys and the other does not, or if the client has the key of another robot, the
            # robot closes the connection without a reason. So does a tunnel to a robot that is not running.
            self._closed += 1
            if self._closed >= _PROBE_AFTER_FAILURES or event == zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL:
                self._closed = 0
                return self._compare(_read_mechanism(self._address))
        return ""

    def _compare(self, mechanism: str) -> str:
        if mechanism == "CURVE":
            if self._keys is None:
                return "the robot requires keys: use --key-file and --robot-key"
            return "--robot-key is not the public key of this robot"
        if mechanism == "NULL" and self._keys is not None:
            return "this port of the robot does not use keys: omit --key-file and --robot-key"
        return ""


def _read_mechanism(address: Address) -> str:
    """Return the security mechanism of the ZeroMQ socket at *address*; "" if there is no such socket."""
    greeting = b""
    try:
        place = (address.host.strip("[]"), address.port)
        with socket.create_connection(place, _PROBE_TIMEOUT_S) as connection:
            # libzmq sends its mechanism in reply to the version, and closes the connection only after it has
            # received another mechanism.
            connection.sendall(_GREETING)
            deadline = time.monotonic() + _PROBE_TIMEOUT_S
            while len(greeting) < _MECHANISM.stop:
                connection.settimeout(max(0.001, deadline - time.monotonic()))
                data = connection.recv(_MECHANISM.stop - len(greeting))
                if not data:
                    return ""
                greeting += data
    except OSError:
        return ""
    return greeting[_MECHANISM].rstrip(b"\0").decode("ascii", "replace")
