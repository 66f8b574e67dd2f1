"""What the leaves that send a message to a server have in common: waiting for the server, and failures."""

import enum
import logging
from collections.abc import Mapping
from typing import Any

from btcore import FAILURE, RUNNING, NodeError, NodeSpec, StatefulAction, Status
from btcore.clock import NS_PER_MS
from btcore.engine.node import read_clock
from btcore.status import PossibleResults
from btcore_ros2.leaves.endpoint import Endpoint
from btcore_ros2.leaves.results import completed
from btcore_ros2.session import RosSession

log = logging.getLogger(__name__)


class ServerLeaf(StatefulAction):
    """Base of the leaves that send a message to a server when it is ready, and wait for the answer."""

    server_timeout: int = 1000
    """The time (ms) that the server has to answer: to accept or reject a goal, or to respond to a request."""
    wait_for_server_timeout: int = 500
    """The time (ms), after the client was created, in which the server must appear.

    Meanwhile the leaf is RUNNING. Afterwards, a missing server is a failure at once.
    """

    error_message: str = ""
    """The description of the last failure; "" if the last goal or call did not fail."""

    spec = NodeSpec(state_fields=None)  # the goal or response belongs to the server

    session: RosSession
    """The session."""

    _endpoint: Endpoint[Any]
    _unsent: Any = None
    _sent = 0
    _logged = ""

    @classmethod
    def possible_results(
        cls, children: list[PossibleResults], literals: Mapping[str, object]
    ) -> PossibleResults:
        """Return that the leaf can fail in its first tick, and ends later otherwise."""
        return PossibleResults(cls.spec.results & {FAILURE}, cls.spec.results, True)

    def on_failure(self, error: Any) -> Any:
        """Process a failure, and return the result of the leaf; see the subclasses."""
        raise NotImplementedError

    # --- for the base classes of goals and requests

    def _is_ready(self, client: Any) -> bool:
        """Return whether the server of *client* is visible."""
        raise NotImplementedError

    def _unreachable(self, name: str) -> tuple[enum.Enum, str]:
        """Return the code and the message for the missing server *name*."""
        raise NotImplementedError

    def _transmit(self, client: Any, message: Any) -> None:
        """Send *message* to the server of *client*."""
        raise NotImplementedError

    def _check_and_send(self, interface: Any, part: str, message: Any, invalid: enum.Enum) -> Any:
        """Check and send the *message* of a leaf that starts: the *part* Goal or Request of *interface*.

        *invalid* is the code of the failure without a message.
        """
        noun = part.lower()
        if message is None:
            return self._fail(invalid, f"make_{noun}() returned None: no {noun} was sent")
        if not isinstance(message, getattr(interface, part)):
            raise NodeError(
                f"make_{noun}() must return a {interface.__name__}.{part} or None, "
                f"not a {type(message).__name__}"
            )
        self._unsent = message
        return self._send()

    def _send(self) -> Any:
        """Send the message if the server is ready, or wait for the server."""
        client = self._endpoint.get()
        now = read_clock(self)
        is_ready = self._is_ready(client)
        settling = self._endpoint.settling_time(is_visible=is_ready)
        if not is_ready:
            limit = self._endpoint.created + self.wait_for_server_timeout * NS_PER_MS
            if self.wait_for_server_timeout > 0 and not self.has_passed(limit):
                self.wake_at(limit)
                return RUNNING
            return self._fail(*self._unreachable(self._endpoint.name))
        if settling:
            self.wake_at(now + settling)
            return RUNNING
        message, self._unsent = self._unsent, None
        self._sent = now
        self._transmit(client, message)
        self.wake_at(now + self.server_timeout * NS_PER_MS + 1)
        return RUNNING

    def _is_late(self) -> bool:
        """Return whether the server's time to answer is over."""
        return self.has_passed(self._sent + self.server_timeout * NS_PER_MS + 1)

    def _fail(self, code: enum.Enum, message: str) -> Status:
        """Log *message* unless it was logged last, and return the result of `on_failure`."""
        self.error_message = message
        if message != self._logged:
            self._logged = message
            log.warning("%s: %s: %s", self.config.path, code.name, message)
        self._end()
        return completed(self.on_failure(code), "on_failure()")

    def _end(self) -> None:
        """Forget the message and its answer."""
        self.cancel_wake_up()
        self._unsent = None
