"""The base classes of leaves that publish to a topic, or read a topic."""

from typing import Annotated, Any

from btcore import Condition, In, NodeError, NodeSpec
from btcore_ros2.leaves.endpoint import Endpoint, interface_of
from btcore_ros2.leaves.results import completed
from btcore_ros2.session import RosSession


class RosPublisher(Condition):
    """Publish a message at each tick: SUCCESS, or FAILURE if there is no message.

    A subclass sets `message_type`, a default for the port `topic_name`, and implements `make_message`. As in
    BehaviorTree.ROS2, the node type is CONDITION.

    Args:
        session: The session, a resource of the tree.

    Examples:
        >>> from btcore import In
        >>> from btcore_ros2.leaves import RosPublisher
        >>> class Say(RosPublisher):
        ...     topic_name = "speech"
        ...     message_type = "std_msgs/msg/String"
        ...     text: In[str]
        ...     def make_message(self):
        ...         return self.message_type(data=self.text)
    """

    topic_name: Annotated[In[str], "Topic name."] = ""

    message_type: Any = None
    """The class of the messages, or its name, such as `std_msgs/msg/String`."""
    qos: Any = 1
    """A `rclpy.qos.QoSProfile`, or the depth of a reliable profile."""

    spec = NodeSpec(state_fields=())

    def __init__(self, session: RosSession) -> None:
        self.session = session
        self.message_type = interface_of(self, "message_type", "msg")
        self._endpoint = Endpoint(
            self, session, "topic_name", ("publisher", self.message_type, repr(self.qos)), self._connect
        )

    def _connect(self, name: str) -> Any:
        return self.session.node.create_publisher(self.message_type, name, self.qos)

    def make_message(self) -> Any:
        """Return the message, or None to publish nothing and fail.

        Raises:
            NodeError: The subclass does not implement the method.
        """
        raise NodeError(f"{type(self).__name__} has no make_message()")

    def tick(self) -> bool:
        """Publish the message."""
        self.session.refresh()
        publisher = self._endpoint.get()
        message = self.make_message()
        if message is None:
            return False
        if not isinstance(message, self.message_type):
            raise NodeError(
                f"make_message() must return a {self.message_type.__name__} or None, "
                f"not a {type(message).__name__}"
            )
        publisher.publish(message)
        return True


class _Topic:
    """A subscription that several leaves share. Each leaf knows which messages it has read."""

    def __init__(self, session: RosSession, message_type: Any, name: str, qos: Any) -> None:
        self.message: Any = None
        self.count = 0
        subscription = session.node.create_subscription(
            message_type, name, self._take, qos, callback_group=session.callback_group
        )
        self.parts = (subscription,)

    def _take(self, message: Any) -> None:
        self.message = message
        self.count += 1


class RosSubscriber(Condition):
    """Read a topic: the result of a callback, which gets the newest message since the last tick.

    A subclass sets `message_type`, a default for the port `topic_name`, and implements `on_message`. As in
    BehaviorTree.ROS2, the node type is CONDITION.

    Args:
        session: The session, a resource of the tree.

    Examples:
        >>> from btcore import In
        >>> from btcore_ros2.leaves import RosSubscriber
        >>> class BatteryOk(RosSubscriber):
        ...     topic_name = "battery_state"
        ...     message_type = "sensor_msgs/msg/BatteryState"
        ...     latch = True
        ...     minimum: In[float] = 0.2
        ...     def on_message(self, message):
        ...         return message is not None and message.percentage > self.minimum
    """

    topic_name: Annotated[In[str], "Topic name."] = ""

    message_type: Any = None
    """The class of the messages, or its name, such as `sensor_msgs/msg/BatteryState`."""
    qos: Any = 1
    """A `rclpy.qos.QoSProfile`, or the depth of a reliable profile."""
    latch: bool = False
    """Whether a message is passed to `on_message` again until a newer message arrives."""

    spec = NodeSpec(state_fields=())

    _listening: _Topic | None = None
    _read = 0  # of the messages of _listening

    def __init__(self, session: RosSession) -> None:
        self.session = session
        self.message_type = interface_of(self, "message_type", "msg")
        self._endpoint = Endpoint(
            self, session, "topic_name", ("subscription", self.message_type, repr(self.qos)), self._connect
        )
        if self._endpoint.name:
            self._listen()

    def _connect(self, name: str) -> _Topic:
        return _Topic(self.session, self.message_type, name, self.qos)

    def _listen(self) -> _Topic:
        topic: _Topic = self._endpoint.get()
        if topic is not self._listening:
            self._listening = topic
            self._read = topic.count
        return topic

    def on_message(self, message: Any) -> Any:
        """Process a message.

        Args:
            message: The newest message that arrived since the last tick; None if there is none.

        Returns:
            SUCCESS (True) or FAILURE (False), the result of the leaf.

        Raises:
            NodeError: The subclass does not implement the method.
        """
        raise NodeError(f"{type(self).__name__} has no on_message()")

    def tick(self) -> Any:
        """Pass the newest message to `on_message`."""
        topic = self._listen()
        self.session.refresh()
        message = topic.message if topic.count > self._read else None
        if not self.latch:
            self._read = topic.count
        return completed(self.on_message(message), "on_message()")
