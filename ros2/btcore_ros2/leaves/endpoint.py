"""The ROS entity of a leaf: an action client, a service client, a publisher or a subscription."""

import time
from collections.abc import Callable
from typing import Any, Final, Generic, TypeVar

from btcore import NodeError, TreeNode
from btcore_robot.robot import NS_PER_S
from btcore_robot.schedule import SimulatedTime
from btcore_ros2.interfaces import InterfaceError, InterfaceKind, load_interface
from btcore_ros2.session import RosSession

Entity = TypeVar("Entity")

PLACEHOLDER: Final = "__default__placeholder__"
"""The text that stands for the default in BehaviorTree.ROS2, as an empty text does. Groot may write it."""


SETTLING_NS: Final = NS_PER_S // 10
"""The time (ns) between the creation of a client, or the appearance of its server, and the first message.

The server has to find the client, too: its answer to an earlier message would be lost.
"""


class Endpoint(Generic[Entity]):
    """The entity of one leaf. Its name is the value of a port.

    With a literal as the name, the entity is created together with the leaf. With a blackboard entry, it is
    created by the first `get`, and replaced when the entry has another value. Leaves that need the same
    entity share it.

    Args:
        node: The leaf.
        session: The session of the leaf.
        port: The name of the port with the name of the entity.
        key: What two leaves with the same entity have in common, in addition to the name.
        create: Creates the entity for a name.

    Attributes:
        name: The name of the entity; "" before it is created.
        created: The time (ns, tree's clock) at which the leaf first used the entity.

    Raises:
        NodeError: The port is empty, or its literal is not a valid name.
    """

    def __init__(
        self,
        node: TreeNode,
        session: RosSession,
        port: str,
        key: tuple[Any, ...],
        create: Callable[[str], Entity],
    ) -> None:
        self._node = node
        self._session = session
        self._port = port
        self._key = key
        self._create = create
        self._entity: Entity | None = None
        self._shared_key: tuple[Any, ...] = ()
        self._binding = node.config.input(port)
        self.name = ""
        self.created = 0
        if self._binding.key is None:
            self._open(self._binding.text)

    def get(self) -> Entity:
        """Return the entity for the present value of the port.

        Raises:
            NodeError: The value is not a valid name.
            BlackboardError: The port is a blackboard entry that was never written.
        """
        if self._binding.key is not None:
            name = str(self._node.get_input(self._port))
            if self._entity is None or name != self.name:
                self._open(name)
        entity = self._entity
        assert entity is not None
        return entity

    def settling_time(self, *, is_visible: bool) -> int:
        """Return for how long (ns) the first message has to wait, because the server may not know the client.

        Args:
            is_visible: Whether the server is visible.
        """
        shared, key = self._session.shared, ("settled", *self._shared_key)
        if isinstance(self._session.clock, SimulatedTime):
            return 0  # a wait in real time would let an unpredictable simulated time pass
        now = time.monotonic_ns()
        if not is_visible:
            shared[key] = now + SETTLING_NS
        settled: int = shared[key]
        return max(0, settled - now)

    def _open(self, name: str) -> None:
        from rclpy.exceptions import NameValidationException
        from rclpy.validate_topic_name import validate_topic_name

        # As in BehaviorTree.ROS2, an empty text stands for the default. A class may compute the default.
        default_name: str | None = getattr(self._node, "default_name", None)
        if name in ("", PLACEHOLDER):
            name = self._binding.port.default or default_name or ""
        if not name:
            otherwise = f'give the class {type(self._node).__name__} a default, {self._port} = "…"'
            if default_name is not None:
                otherwise = "give the node a name"
            raise NodeError(f"port [{self._port}] is empty: set it in the XML, or {otherwise}")
        key = (*self._key, name)
        entity = self._session.shared.get(key)
        if entity is None:
            try:
                validate_topic_name(name)
            except NameValidationException as error:
                reason = str(error).splitlines()[0]
                raise NodeError(f"port [{self._port}] = '{name}' is not a valid ROS name: {reason}") from None
            entity = self._create(name)
            self._session.shared[key] = entity
            self._session.shared["settled", *key] = time.monotonic_ns() + SETTLING_NS
        self._entity = entity
        self._shared_key = key
        self.name = name
        self.created = self._node.now()


def interface_of(node: TreeNode, attribute: str, kind: InterfaceKind) -> Any:
    """Return the message, service or action class in a class attribute of *node*.

    Args:
        node: The leaf.
        attribute: The name of the attribute, which contains the class or its ROS name.
        kind: The kind of interface.

    Raises:
        NodeError: The attribute is not set, is of another kind, or names a class that is not installed.
    """
    value = getattr(node, attribute)
    owner = type(node).__name__
    if isinstance(value, str):
        try:
            return load_interface(value, kind)
        except InterfaceError as error:
            raise NodeError(f"{attribute} of the class {owner}: {error}") from None
    if value is None or not hasattr(value, _PARTS[kind]):
        given = "is not set" if value is None else f"is {value!r}"
        raise NodeError(
            f"{attribute} of the class {owner} {given}: assign a class that was generated by ROS 2, or its "
            f"name, such as {_EXAMPLES[kind]}"
        )
    return value


_PARTS: Final = {"action": "Goal", "srv": "Request", "msg": "get_fields_and_field_types"}
_EXAMPLES: Final = {
    "action": "'nav2_msgs/action/NavigateToPose'",
    "srv": "'std_srvs/srv/Trigger'",
    "msg": "'std_msgs/msg/String'",
}
