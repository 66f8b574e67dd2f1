"""The base class of leaves that call a service."""

import enum
import logging
from collections.abc import Callable
from typing import Annotated, Any

from btcore import FAILURE, RUNNING, SUCCESS, In, NodeError
from btcore_ros2.interfaces import interface_name
from btcore_ros2.leaves.endpoint import Endpoint, interface_of
from btcore_ros2.leaves.results import completed
from btcore_ros2.leaves.server_leaf import ServerLeaf
from btcore_ros2.leaves.visible_names import hint_for_service
from btcore_ros2.session import RosSession

log = logging.getLogger(__name__)


class ServiceErrorCode(enum.Enum):
    """Why a service call failed. The names are those of BehaviorTree.ROS2's `ServiceNodeErrorCode`."""

    SERVICE_UNREACHABLE = enum.auto()
    """No server offers the service."""
    SERVICE_TIMEOUT = enum.auto()
    """The server has not answered in time."""
    INVALID_REQUEST = enum.auto()
    """`make_request` returned None."""


class RosService(ServerLeaf):
    """Call a service: RUNNING until the response arrives, then the result of a callback.

    A subclass sets `service_type`, a default for the port `service_name`, and implements `make_request`. It
    may override `on_response` and `on_failure`. The callbacks run during ticks of the leaf. When the leaf is
    halted, a later response is ignored.

    Args:
        session: The session, a resource of the tree.

    Examples:
        >>> from btcore import In
        >>> from btcore_ros2.leaves import RosService
        >>> class EnableMotors(RosService):
        ...     service_name = "enable_motors"
        ...     service_type = "std_srvs/srv/SetBool"
        ...     on: In[bool] = True
        ...     def make_request(self):
        ...         return self.service_type.Request(data=self.on)
        ...     def on_response(self, response):
        ...         return response.success
    """

    service_name: Annotated[In[str], "Service name."] = ""

    service_type: Any = None
    """The class of the service, or its name, such as `std_srvs/srv/Trigger`."""
    _client: Any = None
    _response: Any = None
    _stop_watching: Callable[[], None] | None = None

    def __init__(self, session: RosSession) -> None:
        self.session = session
        self.service_type = interface_of(self, "service_type", "srv")
        self._endpoint = Endpoint(
            self, session, "service_name", ("service", self.service_type), self._connect
        )

    def _connect(self, name: str) -> Any:
        return self.session.node.create_client(
            self.service_type, name, callback_group=self.session.callback_group
        )

    # --- for subclasses

    def make_request(self) -> Any:
        """Return the request, or None to fail with INVALID_REQUEST. Called when the leaf starts.

        Raises:
            NodeError: The subclass does not implement the method.
        """
        raise NodeError(f"{type(self).__name__} has no make_request()")

    def on_response(self, response: Any) -> Any:
        """Process the response.

        Args:
            response: The response message.

        Returns:
            SUCCESS (True) or FAILURE (False), the result of the leaf.
        """
        return SUCCESS

    def on_failure(self, error: ServiceErrorCode) -> Any:
        """Process a failure. `error_message` describes it, and is logged already.

        Args:
            error: The kind of failure.

        Returns:
            SUCCESS (True) or FAILURE (False), the result of the leaf.
        """
        return FAILURE

    # --- the engine

    def on_start(self) -> Any:
        """Create the request, and send it if the server is ready."""
        self.session.refresh()
        self._response = None
        self._endpoint.get()
        request = self.make_request()
        return self._check_and_send(self.service_type, "Request", request, ServiceErrorCode.INVALID_REQUEST)

    def on_running(self) -> Any:
        """Process the response, if it has arrived."""
        self.session.refresh()
        if self._response is None:
            return self._send()
        if self._response.done():
            response = self._response.result()
            self.error_message = self._logged = ""
            self._end()
            return completed(self.on_response(response), "on_response()")
        if not self._is_late():
            return RUNNING
        return self._fail(
            ServiceErrorCode.SERVICE_TIMEOUT,
            f"the service '{self._endpoint.name}' did not answer within {self.server_timeout} ms: "
            "check that its server runs and is not blocked, or increase server_timeout",
        )

    def on_halted(self) -> None:
        """Ignore the response when it arrives."""
        self._end()

    def _is_ready(self, client: Any) -> bool:
        return bool(client.service_is_ready())

    def _unreachable(self, name: str) -> tuple[enum.Enum, str]:
        type_name = interface_name(self.service_type)
        return (
            ServiceErrorCode.SERVICE_UNREACHABLE,
            f"no service '{name}' ({type_name}): {hint_for_service(self.session.node, name, type_name)}",
        )

    def _transmit(self, client: Any, message: Any) -> None:
        self._client = client
        self._response = client.call_async(message)
        self._stop_watching = self.session.after_drain(self._watch)

    def _watch(self) -> None:
        """Wake the tree when the response has arrived."""
        if self._response.done() and self._stop_watching is not None:
            self._stop_watching()
            self._stop_watching = None
            self.wake_up()

    def _end(self) -> None:
        super()._end()
        if self._stop_watching is not None:
            self._stop_watching()
            self._stop_watching = None
        if self._response is not None and not self._response.done():
            self._client.remove_pending_request(self._response)
        self._response = None
