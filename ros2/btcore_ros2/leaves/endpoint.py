"""The ROS entity of a leaf: an action client, a service client, a publisher or a subscription."""

import functools
from collections.abc import Callable
from typing import Any, Final, Generic, TypeVar

from btcore import NodeError, TreeNode
from btcore.engine.node import read_clock
from btcore_robot.schedule import SimulatedSchedule
from btcore_ros2.interfaces import InterfaceError, InterfaceKind, load_interface
from btcore_ros2.session import RosSession
from btcore_ros2.shared_entities import SharedEntity

Entity = TypeVar("Entity")

PLACEHOLDER: Final = "__default__placeholder__"
"""The text that stands for the default in BehaviorTree.ROS2, as an empty text does. Groot may write it."""


class Endpoint(Generic[Entity]):
    """The entity of one leaf. Its name is the value of a port.

    With a literal as the name, the entity is created together with the leaf. With a blackboard entry, it is
    created by the first `get`, and replaced when the entry has another value. Leaves that need the same
    entity share it; see `SharedEntities` for its end.

    Args:
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
        self._shared: SharedEntity | None = None
        self._binding = node.config.input(port)
        self._value = ""
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
        shared = self._shared
        if self._binding.key is not None:
            name = str(self._node.get_input(self._port))
            if shared is None or name != self._value or shared.is_destroyed:
                shared = self._open(name)
        elif shared is None or shared.is_destroyed:
            shared = self._open(self._binding.text)
        entity: Entity = shared.entity
        return entity

    def settling_time(self, *, is_visible: bool) -> int:
        """Return for how long (ns) the first message has to wait; see `SharedEntity.settling_time`."""
        shared = self._shared
        if shared is None or isinstance(self._session.clock, SimulatedSchedule):
            return 0  # a wait in real time would let an unpredictable simulated time pass
        return shared.settling_time(is_visible=is_visible)

    def _open(self, value: str) -> SharedEntity:
        from rclpy.exceptions import NameValidationException
        from rclpy.validate_topic_name import validate_topic_name

        # As in BehaviorTree.ROS2, an empty text stands for the default. A class may compute the default.
        default_name: str | None = getattr(self._node, "default_name", None)
        name = value
        if name in ("", PLACEHOLDER):
            name = self._binding.port.default or default_name or ""
        if not name:
            otherwise = f'give the class {type(self._node).__name__} a default, {self._port} = "…"'
            if default_name is not None:
                otherwise = "give the node a name"
            raise NodeError(f"port [{self._port}] is empty: set it in the XML, or {otherwise}")
        try:
            validate_topic_name(name)
        except NameValidationException as error:
            reason = str(error).splitlines()[0]
            raise NodeError(f"port [{self._port}] = '{name}' is not a valid ROS name: {reason}") from None
        if self._shared is not None:
            self._shared.users.discard(self._node)
        create = functools.partial(self._create, name)
        self._shared = shared = self._session.entities.use(self._node, (*self._key, name), create)
        self._value = value
        self.name = name
        self.created = read_clock(self._node)
        return shared


def interface_of(node: TreeNode, attribute: str, kind: InterfaceKind) -> Any:
    """Return the message, service or action class in a class attribute of *node*.

    Args:
        node: The leaf.
        attribute: The name of the attribute, which contains the class or its ROS name.

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
        problem = "is not set" if value is None else f"is {value!r}"
        raise NodeError(
            f"{attribute} of the class {owner} {problem}: assign a class that was generated by ROS 2, or its "
            f"name, such as {_EXAMPLES[kind]}"
        )
    return value


_PARTS: Final = {"action": "Goal", "srv": "Request", "msg": "get_fields_and_field_types"}
_EXAMPLES: Final = {
    "action": "'nav2_msgs/action/NavigateToPose'",
    "srv": "'std_srvs/srv/Trigger'",
    "msg": "'std_msgs/msg/String'",
}
