"""Leaves that need no code: the XML names the message, service or action, and contains its fields as JSON."""

import logging
from collections.abc import Callable, Iterable, Mapping
from typing import Annotated, Any, ClassVar, Final

from btcore import (
    FAILURE,
    RUNNING,
    SUCCESS,
    Blackboard,
    Direction,
    In,
    LiteralProblem,
    NodeSpec,
    Port,
    StatefulAction,
    Status,
)
from btcore.clock import NS_PER_MS, NS_PER_S
from btcore.engine.node import read_clock
from btcore.values import STRING
from btcore_ros2.interfaces import interface_name
from btcore_ros2.leaves.action import ActionErrorCode, RosAction
from btcore_ros2.leaves.endpoint import Endpoint
from btcore_ros2.leaves.message_port import TYPE_PORT, MessagePort, load_type, message_problems
from btcore_ros2.leaves.qos import Durability, Qos, Reliability, profile_of, why_silent, why_unheard
from btcore_ros2.leaves.service import RosService, ServiceErrorCode
from btcore_ros2.message_values import MissingItemError, read_field
from btcore_ros2.session import RosSession

log = logging.getLogger(__name__)

WAIT_FOR_SERVER: Final = "the time (ms), after the client was created, in which the server must appear"
DISCOVERY_MS: Final = 5000
"""The default of this time: DDS repeats an announcement that was lost, as on a busy machine, after 3 s."""


def _type_port(example: str) -> Port:
    return Port(TYPE_PORT, type=STRING, description=f"the type, such as {example}; not an entry")


def message_input(name: str, about: str) -> Port:
    """Return an input port with the content of a message."""
    return Port(
        name, default="", description=f"{about}: json:{{…}}, or an entry with a message or dictionary"
    )


def output_port(name: str, about: str) -> Port:
    """Return an output port that the XML may omit."""
    return Port(name, Direction.OUT, description=about, optional=True)


def error_output(about: str) -> Port:
    """Return the output port for the reason of a failure."""
    return Port("error", Direction.OUT, type=STRING, description=about, optional=True)


def field_input(name: str, output: str) -> Port:
    """Return the input port with the path of the field that is written to the port *output*."""
    about = f"the field that is written to `{output}`, such as pose.position.x; default: the whole message"
    return Port(name, type=STRING, default="", description=about)


class NoCodeLeaf:
    """What the leaves without code have in common: outputs that the XML may omit, and a name of ROS."""

    config: Any
    get_input: Any
    spec: ClassVar[NodeSpec] = NodeSpec(writes=("error",))

    @property
    def default_name(self) -> str:
        """The name of the action, service or topic if its port is empty: the instance name in the XML."""
        name: str = self.config.name
        return "" if name == self.config.id else name

    def write(self, port: str, message: Any, field_port: str) -> str:
        """Write *message*, or its field that the port *field_port* names, to an output that is connected.

        Returns:
            Why nothing was written, if the field is an item that a list does not have; otherwise "".
        """
        output = self.config.outputs.get(port)
        if output is not None and output.key is not None:
            try:
                output.write(read_field(message, self.get_input(field_port)))
            except MissingItemError as error:
                return f"{field_port}={error}"
        return ""

    def write_error(self, text: str) -> None:
        """Write *text* to the output `error`, if it is connected."""
        output = self.config.outputs.get("error")
        if output is not None and output.key is not None:
            output.write(text)

    def complete(self, error: str) -> Status:
        """Write *error*, and return SUCCESS if there is none."""
        self.write_error(error)
        return FAILURE if error else SUCCESS


class RosActionCall(NoCodeLeaf, RosAction):
    """Sends a goal to an action server of ROS 2, and waits for the result: SUCCESS if the goal succeeded.

    `type` names the action, and `goal` holds its goal. In the JSON a text "{key}" stands for the entry `key`
    of the blackboard. The name of the action is `action_name`; without it, the instance name (`name`) is the
    name of the action.

    The leaf fails if there is no server after `wait_for_server_timeout`, if the server does not accept the
    goal within `server_timeout`, or if the goal is aborted or cancelled. Then `error` gets the reason, and
    `result` the result of the aborted goal. If the leaf is halted, the goal is cancelled.

    Args:
        session: The session, a resource of the tree.
        board: The blackboard. Because of this parameter, checks know that the leaf can read any entry.
    """

    action_name: Annotated[In[str], "the action; default: the instance name"] = ""
    server_timeout: Annotated[In[int], "the time (ms) that the server has to accept the goal"] = 1000
    wait_for_server_timeout: Annotated[In[int], WAIT_FOR_SERVER] = DISCOVERY_MS
    spec = NodeSpec(symbol="⇄", writes=("error", "feedback"))

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return [
            _type_port("nav2_msgs/action/NavigateToPose"),
            message_input("goal", "the goal"),
            output_port("result", "the result"),
            field_input("result_field", "result"),
            output_port("feedback", "the newest feedback"),
            field_input("feedback_field", "feedback"),
            error_output("why the goal failed, or an empty text"),
        ]

    @classmethod
    def check_literals(cls, literals: Mapping[str, str]) -> Iterable[LiteralProblem]:
        """Return the problems of the goal and of the fields."""
        fields = {"result_field": "Result", "feedback_field": "Feedback"}
        return message_problems(literals, "action", {"goal": "Goal"}, fields)

    def __init__(self, session: RosSession, board: Blackboard) -> None:
        self.action_type = load_type(self, "action")
        self._goal_port = MessagePort(self, "goal", self.action_type.Goal, session)
        super().__init__(session)

    def make_goal(self) -> Any:
        """Return the goal in the port."""
        return self._goal_port.read()

    def on_feedback(self, feedback: Any) -> Any:
        """Write the feedback. While a list has no such item, the last value remains."""
        self.write("feedback", feedback, "feedback_field")

    def on_result(self, result: Any) -> Any:
        """Write the result."""
        return self.complete(self.write("result", result, "result_field"))

    def on_failure(self, error: ActionErrorCode) -> Any:
        """Write the error, and the result of an aborted goal."""
        if error in (ActionErrorCode.ACTION_ABORTED, ActionErrorCode.ACTION_CANCELLED):
            self.write("result", self.last_result, "result_field")
        return self.complete(self.error_message)


def _refusals(response: Any) -> list[str]:
    """Return the reasons of a server that did not do what was requested, which may be empty texts.

    A response has the fields `success` and `message`, as in std_srvs, or contains results with the fields
    `successful` and `reason`, as those of rcl_interfaces, which set parameters.
    """
    results = getattr(response, "results", None)
    reports = [getattr(response, "result", None), *(results if isinstance(results, list) else ())]
    refusals = [getattr(item, "reason", "") for item in reports if getattr(item, "successful", True) is False]
    if getattr(response, "success", True) is False:
        refusals.append(getattr(response, "message", ""))
    return refusals


class RosServiceCall(NoCodeLeaf, RosService):
    """Calls a service of ROS 2, and waits for the response.

    `type` names the service, and `request` holds its request. In the JSON a text "{key}" stands for the entry
    `key` of the blackboard. The name of the service is `service_name`; without it, the instance name (`name`)
    is the name of the service.

    The leaf succeeds when the response has arrived. It fails if the response has a boolean field `success`
    that is false, as in std_srvs, or a result whose field `successful` is false, as when a parameter is set.
    It also fails if there is no server after `wait_for_server_timeout`, or if the server does not answer
    within `server_timeout`. `error` then gets the reason.

    Args:
        session: The session, a resource of the tree.
        board: The blackboard. Because of this parameter, checks know that the leaf can read any entry.
    """

    service_name: Annotated[In[str], "the service; default: the instance name"] = ""
    server_timeout: Annotated[In[int], "the time (ms) that the server has to answer"] = 1000
    wait_for_server_timeout: Annotated[In[int], WAIT_FOR_SERVER] = DISCOVERY_MS
    spec = NodeSpec(symbol="⇄")

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return [
            _type_port("std_srvs/srv/SetBool"),
            message_input("request", "the request"),
            output_port("response", "the response"),
            field_input("response_field", "response"),
            error_output("why the call failed, or an empty text"),
        ]

    @classmethod
    def check_literals(cls, literals: Mapping[str, str]) -> Iterable[LiteralProblem]:
        """Return the problems of the request and of the field."""
        return message_problems(literals, "srv", {"request": "Request"}, {"response_field": "Response"})

    def __init__(self, session: RosSession, board: Blackboard) -> None:
        self.service_type = load_type(self, "srv")
        self._request_port = MessagePort(self, "request", self.service_type.Request, session)
        super().__init__(session)

    def make_request(self) -> Any:
        """Return the request in the port."""
        return self._request_port.read()

    def on_response(self, response: Any) -> Any:
        """Write the response."""
        problem = self.write("response", response, "response_field")
        reasons = _refusals(response)
        if reasons:
            problem = f"the service '{self._endpoint.name}' did not succeed"
            problem = ": ".join([problem, *filter(None, reasons)])
        return self.complete(problem)

    def on_failure(self, error: ServiceErrorCode) -> Any:
        """Write the error."""
        return self.complete(self.error_message)


class _TopicLeaf(NoCodeLeaf, StatefulAction):
    """What the leaves with a topic have in common: its name, type and quality of service."""

    topic_name: Annotated[In[str], "the topic; default: the instance name"] = ""
    qos: Annotated[In[Qos], "the quality of service: reliable, sensor_data or latched"] = Qos.reliable
    depth: Annotated[In[int], "the number of messages that are kept; 0 = that of qos"] = 0
    reliability: Annotated[In[Reliability], "reliable or best_effort; default: that of qos"] = (
        Reliability.as_qos
    )
    durability: Annotated[In[Durability], "volatile or transient_local; default: that of qos"] = (
        Durability.as_qos
    )
    spec = NodeSpec(state_fields=None, may_complete_on_start=True)

    def __init__(self, session: RosSession) -> None:
        self.session = session
        self._message_type = load_type(self, "msg")
        self._profile = profile_of(self.qos, self.depth, self.reliability, self.durability)
        profile = (self._profile.depth, self._profile.reliability, self._profile.durability)
        key = (type(self).__name__, self._message_type, profile)
        self._endpoint: Endpoint[Any] = Endpoint(self, session, "topic_name", key, self._connect)

    def _connect(self, name: str) -> Any:
        """Create the publisher or the subscription."""
        raise NotImplementedError

    def on_halted(self) -> None:
        """Stop waiting."""
        self.cancel_wake_up()


class RosTopicPublish(_TopicLeaf):
    """Publishes a message to a topic of ROS 2, and succeeds.

    The first message waits for a subscriber, because ROS 2 needs some time to find it. If there is none after
    `wait_for_subscriber_timeout`, the message is published nevertheless, and `error` has the reason.

    `type` names the message, and `message` holds its fields. In the JSON a text "{key}" stands for the entry
    `key` of the blackboard. The name of the topic is `topic_name`; without it, the instance name (`name`) is
    the name of the topic.

    Args:
        session: The session, a resource of the tree.
        board: The blackboard. Because of this parameter, checks know that the leaf can read any entry.
    """

    wait_for_subscriber_timeout: Annotated[
        In[int], "the time (ms), after the publisher was created, in which a subscriber must appear"
    ] = DISCOVERY_MS
    spec = NodeSpec(symbol="↑", results=frozenset({SUCCESS}), uses=frozenset())

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return [
            _type_port("geometry_msgs/msg/Twist"),
            message_input("message", "the message"),
            error_output("why no subscriber gets the message, or an empty text"),
        ]

    @classmethod
    def check_literals(cls, literals: Mapping[str, str]) -> Iterable[LiteralProblem]:
        """Return the problems of the message."""
        return message_problems(literals, "msg", {"message": ""}, {})

    def __init__(self, session: RosSession, board: Blackboard) -> None:
        super().__init__(session)
        self._message_port = MessagePort(self, "message", self._message_type, session)
        self._message: Any = None
        self._unheard = ("", "")  # the topic without a subscriber, and the error

    def _connect(self, name: str) -> Any:
        return self.session.node.create_publisher(self._message_type, name, self._profile)

    def on_start(self) -> Status:
        """Read the message, and publish it if there is a subscriber."""
        self._message = self._message_port.read()
        return self.on_running()

    def on_running(self) -> Status:
        """Publish the message if there is a subscriber, or continue to wait."""
        self.session.refresh()
        publisher = self._endpoint.get()
        is_heard = publisher.get_subscription_count() > 0
        settling = self._endpoint.settling_time(is_visible=is_heard)
        limit = self._endpoint.created + self.wait_for_subscriber_timeout * NS_PER_MS
        must_wait = settling > 0 if is_heard else not self.has_passed(limit)
        if must_wait and self.wait_for_subscriber_timeout > 0:
            self.wake_at(read_clock(self) + settling if is_heard else limit)
            return RUNNING
        self.on_halted()
        publisher.publish(self._message)
        self.write_error("" if is_heard else self._report_unheard())
        if is_heard:
            self._unheard = ("", "")
        return SUCCESS

    def _report_unheard(self) -> str:
        """Return why no subscriber gets the message, and log it once."""
        from rclpy.qos import DurabilityPolicy

        name = self._endpoint.name
        if self._profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:  # later subscribers get the message
            return ""
        if name != self._unheard[0]:
            reason = why_unheard(self.session.node, name, interface_name(self._message_type))
            self._unheard = (name, f"no subscriber of the topic '{name}' gets the message: {reason}")
            log.warning("%s: %s", self.config.path, self._unheard[1])
        return self._unheard[1]


class _Newest:
    """The newest message of a topic, and the time (ns) at which it arrived."""

    def __init__(self, now: Callable[[], int]) -> None:
        self.parts: tuple[Any, ...] = ()
        self.message: Any = None
        self.stamp = 0
        self.waiting: set[RosTopicRead] = set()
        self._now = now

    def take(self, message: Any) -> None:
        """Keep *message*, and wake the leaves that wait for it."""
        self.message = message
        self.stamp = self._now()
        for leaf in self.waiting:
            leaf.wake_up()


class RosTopicRead(_TopicLeaf):
    """Reads the newest message of a topic of ROS 2, or waits for a message and fails after `timeout`.

    If a message has arrived since the tree was loaded, the leaf succeeds at once. With `max_age`, an older
    message does not count. After a failure, `error` has the reason.

    After the tree was loaded, ROS 2 needs some time to find the publisher. `timeout` counts as soon as there
    is a publisher, or `wait_for_publisher_timeout` is over. With `timeout="0"` the leaf never waits.

    `type` names the message. The name of the topic is `topic_name`; without it, the instance name (`name`) is
    the name of the topic. The quality of service must be compatible with the publishers.

    Args:
        session: The session, a resource of the tree.
    """

    timeout: Annotated[In[int], "how long (ms) the leaf waits for a message"] = 1000
    wait_for_publisher_timeout: Annotated[
        In[int], "the time (ms), after the subscription was created, in which a publisher must appear"
    ] = DISCOVERY_MS
    max_age: Annotated[In[float], "the maximum time (s) since the message arrived; 0 = no limit"] = 0.0
    spec = NodeSpec(symbol="↓")

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return [
            _type_port("sensor_msgs/msg/BatteryState"),
            output_port("message", "the message, or its field"),
            field_input("field", "message"),
            error_output("why there is no message, or an empty text"),
        ]

    @classmethod
    def check_literals(cls, literals: Mapping[str, str]) -> Iterable[LiteralProblem]:
        """Return the problems of the type and of the field."""
        return message_problems(literals, "msg", {}, {"field": ""})

    def __init__(self, session: RosSession) -> None:
        super().__init__(session)
        self._deadline = 0
        self._logged = ""

    def _connect(self, name: str) -> _Newest:
        from rclpy.event_handler import SubscriptionEventCallbacks

        newest = _Newest(self.session.clock.now)
        # The default callbacks log incompatible publishers, which why_silent() describes.
        callbacks = SubscriptionEventCallbacks(use_default_callbacks=False)
        subscription = self.session.node.create_subscription(
            self._message_type,
            name,
            newest.take,
            self._profile,
            callback_group=self.session.callback_group,
            event_callbacks=callbacks,
        )
        newest.parts = (subscription,)
        return newest

    def on_start(self) -> Status:
        """Read the message, or begin to wait."""
        self._deadline = read_clock(self) + self.timeout * NS_PER_MS
        return self.on_running()

    def on_running(self) -> Status:
        """Read the message, or continue to wait."""
        newest = self._endpoint.get()
        self.session.refresh()
        if newest.message is not None:
            age = self.session.clock.now() - newest.stamp
            if self.max_age <= 0 or age <= self.max_age * NS_PER_S:
                self.on_halted()
                return self.complete(self.write("message", newest.message, "field"))
        elif self._is_undiscovered():
            self._deadline = read_clock(self) + self.timeout * NS_PER_MS
        if self.timeout > 0 and not self.has_passed(self._deadline):
            newest.waiting.add(self)
            self.wake_at(self._deadline)
            return RUNNING
        self.on_halted()
        name = self._endpoint.name
        reason = why_silent(self.session.node, name, interface_name(self._message_type), self._profile)
        error = f"no message on the topic '{name}' within {self.timeout} ms: {reason}"
        if newest.message is None and error != self._logged:
            self._logged = error
            log.warning("%s: %s", self.config.path, error)
        return self.complete(error)

    def _is_undiscovered(self) -> bool:
        """Return whether there is no publisher, but may be one that ROS 2 has not found yet."""
        limit = self._endpoint.created + self.wait_for_publisher_timeout * NS_PER_MS
        return not self.has_passed(limit) and not self.session.node.count_publishers(self._endpoint.name)

    def on_halted(self) -> None:
        """Stop waiting."""
        super().on_halted()
        self._endpoint.get().waiting.discard(self)
