"""Leaves for tf that need no code: read the pose of a frame, transform a pose, and publish a transform."""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Final

from btcore import (
    RUNNING,
    Blackboard,
    In,
    LiteralProblem,
    NodeError,
    NodeSpec,
    Port,
    StatefulAction,
    Status,
    SyncAction,
)
from btcore.clock import NS_PER_MS, NS_PER_S
from btcore.engine.node import read_clock
from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import Pose2D
from btcore_robot.transforms import TransformError
from btcore_ros2.errors import RosError
from btcore_ros2.interfaces import InterfaceError, load_interface
from btcore_ros2.leaves.by_name import NoCodeLeaf, error_output, field_input, message_input, output_port
from btcore_ros2.leaves.message_port import TYPE_PORT, MessagePort, message_problems
from btcore_ros2.session import RosSession
from btcore_ros2.shared_entities import SharedEntity
from btcore_ros2.transform_listener import TF_MESSAGE, TransformListener

if TYPE_CHECKING:
    from rclpy.publisher import Publisher

POSE: Final = "geometry_msgs/msg/PoseStamped"


class _TransformLeaf(NoCodeLeaf):
    """What the leaves for tf have in common: ports with poses, and an entity that the leaves share."""

    session: RosSession

    _entity: SharedEntity | None = None

    @classmethod
    def check_literals(cls, literals: Mapping[str, str]) -> Iterable[LiteralProblem]:
        """Return the problems of the pose and of the field."""
        ports = [port for port in ("pose", "field") if literals.get(port)]
        typed = {**literals, TYPE_PORT: POSE}
        for problem in message_problems(typed, "msg", {"pose": ""}, {"field": ""}) if ports else ():
            # Without the messages of ROS, the problem of their type belongs to a port that needs them.
            yield problem._replace(port=ports[0]) if problem.port == TYPE_PORT else problem

    def shared(self, key: str, create: Callable[[], Any]) -> Any:
        """Return the entity for *key* that the leaves of all trees share."""
        if self._entity is None or self._entity.is_destroyed:
            self._entity = self.session.entities.use(self, (key,), create)
        return self._entity.entity

    def read_pose(self, port: MessagePort, frame: str) -> tuple[str, Transform, Any]:
        """Return the frame, the pose and the stamp (a message) of the pose in the port `pose`.

        Args:
            frame: The frame of a pose that has none.

        Raises:
            RosError: The pose is not finite, or its orientation has the length 0.
        """
        value = self.get_input("pose")
        stamp = None
        if isinstance(value, Pose2D):
            pose = Transform.from_pose(value)
        elif isinstance(value, load_interface("geometry_msgs/msg/Pose", "msg")):
            pose = _transform_of(value)
        else:
            message = port.read()
            pose, stamp = _transform_of(message.pose), message.header.stamp
            frame = message.header.frame_id.lstrip("/") or frame
        length = math.hypot(*pose.quaternion)
        if not (length > 0.0 and math.isfinite(sum(pose.position) + length)):
            raise RosError("the pose is not finite, or its orientation has the length 0")
        x, y, z, w = (part / length for part in pose.quaternion)
        return frame, Transform(pose.position, (x, y, z, w)), stamp


def _transform_of(pose: Any) -> Transform:
    """Return the pose in a `geometry_msgs/msg/Pose`."""
    position, turn = pose.position, pose.orientation
    return Transform((position.x, position.y, position.z), (turn.x, turn.y, turn.z, turn.w))


def _write(pose: Transform, position: Any, orientation: Any) -> None:
    """Write *pose* to the parts of a message."""
    position.x, position.y, position.z = pose.position
    orientation.x, orientation.y, orientation.z, orientation.w = pose.quaternion


class _LookUp(_TransformLeaf, StatefulAction):
    """Base of the leaves that need a transform, and wait for it."""

    timeout: Annotated[In[int], "how long (ms) the leaf waits for the transform"] = 1000
    max_age: Annotated[In[float], "the maximum time (s) since the transform arrived; 0 = no limit"] = 0.0
    spec = NodeSpec(symbol="⌖", state_fields=None, may_complete_on_start=True)

    def __init__(self, session: RosSession) -> None:
        self.session = session
        self._deadline = 0
        try:
            self._listener()
        except InterfaceError as error:
            raise NodeError(str(error)) from None

    def _listener(self) -> TransformListener:
        listener: TransformListener = self.shared("tf", lambda: TransformListener(self.session))
        return listener

    def on_start(self) -> Status:
        """Look up the transform, or begin to wait."""
        self._deadline = read_clock(self) + self.timeout * NS_PER_MS
        return self.on_running()

    def on_running(self) -> Status:
        """Look up the transform, or continue to wait."""
        listener = self._listener()
        self.session.refresh()
        try:
            self.write_result(listener)
        except (TransformError, RosError) as error:
            if isinstance(error, TransformError) and self.timeout > 0 and not self.has_passed(self._deadline):
                self.wake_at(self._deadline)
                return RUNNING
            self.cancel_wake_up()
            return self.complete(str(error))
        self.cancel_wake_up()
        return self.complete("")

    def on_halted(self) -> None:
        """Stop waiting."""
        self.cancel_wake_up()

    def write_result(self, listener: TransformListener) -> None:
        """Write the pose to the outputs.

        Raises:
            TransformError: The transform is not known, or too old.
            RosError: The pose or the field cannot be used.
        """
        raise NotImplementedError

    def write_pose(self, listener: TransformListener, parent: str, pose: Transform, stamp: Any) -> None:
        """Write *pose* in the frame *parent* to the outputs.

        Raises:
            RosError: The port `field` names an item that a list does not have.
        """
        message = load_interface(POSE, "msg")()
        message.header.frame_id = parent
        if stamp is not None:
            message.header.stamp = stamp
        _write(pose, message.pose.position, message.pose.orientation)
        problem = self.write("result", message, "field")
        if problem:
            raise RosError(problem)
        output = self.config.outputs.get("result_2d")
        if output is not None and output.key is not None:
            output.write(pose.to_pose())

    def lookup(self, listener: TransformListener, parent: str, child: str, stamp: int | None) -> Transform:
        """Return the pose of *child* in *parent*.

        Raises:
            TransformError: The transform is not known, or too old.
        """
        found = listener.transforms.lookup(parent, child, stamp)
        age = listener.age(parent, child)
        if 0.0 < self.max_age < age:
            raise TransformError(
                f"the transform from '{child}' to '{parent}' is {age:.1f} s old (max_age {self.max_age:g} s)"
            )
        return found


def _result_ports() -> list[Port]:
    return [
        output_port("result", "the pose as geometry_msgs/msg/PoseStamped, or its field"),
        field_input("field", "result"),
        output_port("result_2d", "the pose on the floor as Pose2D, as the leaves of the navigation use it"),
        error_output("why there is no pose, or an empty text"),
    ]


class RosTransformRead(_LookUp):
    """Reads the newest pose of the frame `child` in the frame `parent` from tf, or waits for it.

    If the frames are known, the leaf succeeds at once. It fails if the pose is unknown after `timeout`. With
    `max_age`, transforms that arrived earlier do not count. After a failure, `error` has the reason. The
    stamp of the pose is that of the oldest transform between the two frames; 0 if all are static.

    Args:
        session: The session, a resource of the tree.
    """

    child: Annotated[In[str], "the frame whose pose is read"]
    parent: Annotated[In[str], "the frame of the result"] = "map"

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return _result_ports()

    def write_result(self, listener: TransformListener) -> None:
        """Write the pose of the frame `child`."""
        from builtin_interfaces.msg import Time

        parent, child = self.parent.lstrip("/"), self.child.lstrip("/")
        pose = self.lookup(listener, parent, child, None)
        seconds, nanoseconds = divmod(listener.stamp(parent, child), NS_PER_S)
        self.write_pose(listener, parent, pose, Time(sec=seconds, nanosec=nanoseconds))


class RosPoseTransform(_LookUp):
    """Transforms a pose to the frame `parent` with tf, or waits for the transform.

    `pose` is JSON with the fields of geometry_msgs/msg/PoseStamped, or an entry with such a message, a
    geometry_msgs/msg/Pose or a Pose2D. A pose without a frame is in the frame `pose_frame`. The transform is
    that of the pose's stamp; without a stamp, it is the newest.

    The leaf fails if the transform is unknown after `timeout`. With `max_age`, transforms that arrived
    earlier do not count. After a failure, `error` has the reason.

    Args:
        session: The session, a resource of the tree.
        board: The blackboard. Because of this parameter, checks know that the leaf can read any entry.
    """

    parent: Annotated[In[str], "the frame of the result"] = "map"
    pose_frame: Annotated[In[str], "the frame of a pose that has none"] = "map"

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return [message_input("pose", "the pose"), *_result_ports()]

    def __init__(self, session: RosSession, board: Blackboard) -> None:
        self._pose_port = MessagePort(self, "pose", load_interface(POSE, "msg"), session)
        super().__init__(session)

    def write_result(self, listener: TransformListener) -> None:
        """Write the pose in the frame `parent`."""
        frame, pose, stamp = self.read_pose(self._pose_port, self.pose_frame.lstrip("/"))
        parent = self.parent.lstrip("/")
        time = stamp.sec * NS_PER_S + stamp.nanosec if stamp is not None else 0
        transform = self.lookup(listener, parent, frame, time or None)
        self.write_pose(listener, parent, transform * pose, stamp)


class _StaticTransforms:
    """The publisher of `/tf_static`. A late subscriber gets the last message, so it has all transforms."""

    def __init__(self, publisher: "Publisher[Any]") -> None:
        self.parts = (publisher,)
        self._message_class = publisher.msg_type
        self._transforms: dict[str, Any] = {}

    def publish(self, transform: Any) -> None:
        """Publish *transform* together with the earlier ones."""
        self._transforms[transform.child_frame_id] = transform
        self.parts[0].publish(self._message_class(transforms=list(self._transforms.values())))


class RosTransformPublish(_TransformLeaf, SyncAction):
    """Publishes a pose as the transform of a frame to tf, and succeeds.

    `pose` is JSON with the fields of geometry_msgs/msg/PoseStamped, or an entry with such a message, a
    geometry_msgs/msg/Pose or a Pose2D. Its frame is the parent of the frame `child`; a pose without a frame
    is in the frame `pose_frame`. The transform has the stamp of the pose; without a stamp, the present time
    of the ROS node.

    With `static`, the transform is valid at all times, and late subscribers get it. Otherwise it is valid at
    its time only, so repeat the leaf.

    Args:
        session: The session, a resource of the tree.
        board: The blackboard. Because of this parameter, checks know that the leaf can read any entry.
    """

    child: Annotated[In[str], "the frame"]
    pose_frame: Annotated[In[str], "the frame of a pose that has none"] = "map"
    static: Annotated[In[bool], "whether the transform is valid at all times"] = False
    spec = NodeSpec(symbol="↑", state_fields=(), uses=frozenset())

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        return [
            message_input("pose", "the pose"),
            error_output("why nothing was published, or an empty text"),
        ]

    def __init__(self, session: RosSession, board: Blackboard) -> None:
        self.session = session
        self._pose_port = MessagePort(self, "pose", load_interface(POSE, "msg"), session)
        try:
            self._message_class = load_interface(TF_MESSAGE, "msg")
        except InterfaceError as error:
            raise NodeError(str(error)) from None
        if self.config.input("static").key is None:
            self._publisher()  # which is then found before the first tick

    def tick(self) -> Status:
        """Publish the transform."""
        from geometry_msgs.msg import TransformStamped

        self.session.refresh()
        try:
            frame, pose, stamp = self.read_pose(self._pose_port, self.pose_frame.lstrip("/"))
        except RosError as error:
            return self.complete(str(error))
        transform = TransformStamped(child_frame_id=self.child.lstrip("/"))
        transform.header.frame_id = frame
        if stamp is None or not (stamp.sec or stamp.nanosec):
            stamp = self.session.node.get_clock().now().to_msg()
        transform.header.stamp = stamp
        _write(pose, transform.transform.translation, transform.transform.rotation)
        self._publisher()(transform)
        return self.complete("")

    def _publisher(self) -> Callable[[Any], None]:
        """Return the function that publishes a transform."""
        from rclpy.qos import DurabilityPolicy, QoSProfile

        node = self.session.node
        if self.static:
            latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            transforms: _StaticTransforms = self.shared(
                "tf_static publisher",
                lambda: _StaticTransforms(node.create_publisher(self._message_class, "/tf_static", latched)),
            )
            return transforms.publish
        publisher = self.shared(
            "tf publisher", lambda: node.create_publisher(self._message_class, "/tf", 100)
        )
        return lambda transform: publisher.publish(self._message_class(transforms=[transform]))
