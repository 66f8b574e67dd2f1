"""Nav2's servers as the navigation of Nav2's tree nodes: `Nav2Client`."""

import logging
import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, cast

from btcore import Clock
from btcore.clock import NS_PER_MS
from btcore_navigation.action import ENDED, GoalHandle
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.navigate_goal import NavigateGoal
from btcore_navigation.navigation_servers import (
    AnyGoalHandle,
    Battery,
    Message,
    NavigationServers,
)
from btcore_robot.robot import Odometry, Pose2D, Twist2D
from btcore_ros2.errors import RosError
from btcore_ros2.nav2.conversions import (
    ACTIONS,
    pose_from_message,
    pose_from_stamped,
    poses_from_goals,
    time_to_ns,
)
from btcore_ros2.nav2.handles import NamedClient, Nav2GoalHandle, Nav2RequestHandle
from btcore_ros2.nav2.pose_listener import PoseListener
from btcore_ros2.nav2.service_requests import service_of, write_request
from btcore_ros2.parameters import declare_parameter
from btcore_ros2.session import RosSession

PLANNING = ("compute_path_to_pose", "compute_path_through_poses", "smooth_path")
RECOVERIES = ("spin", "backup", "drive_on_heading", "wait", "assisted_teleop")
CANCEL_AGE_NS = 10_000_000
"""The age (ns) from which on `cancel_goals` cancels a goal, as in Nav2."""

DISCOVERY_MS = 5000
"""The default of the ROS parameter `wait_for_service_timeout`, which has the name and unit of Nav2's."""

log = logging.getLogger(__name__)


class Nav2Client(NavigationServers):
    """The servers of a running Nav2, reached over ROS 2: a resource for Nav2's tree nodes and for `Move`.

    Clients and subscriptions are created when a node first uses them.

    Args:
        session: The session, on whose thread everything happens.

    Attributes:
        clock: The clock for trees.
        discovery_ns: The time (ns) after the creation of a client in which its server may appear, by default
            that of the ROS parameter `wait_for_service_timeout`.

    Raises:
        RosError: The ROS parameter is not an integer.
    """

    goal_tolerance = 0.25

    def __init__(self, session: RosSession) -> None:
        self.clock: Clock = session.clock
        self._session = session
        self.discovery_ns = _discovery_ms(session.node) * NS_PER_MS
        self._clients: dict[tuple[str, Any, str], NamedClient] = {}
        self._last_goals: dict[str, AnyGoalHandle] = {}
        self._listener = PoseListener(session)
        self._messages: dict[str, object] = {}
        self._warned: set[str] = set()

    def go_to(self, goal: Pose2D) -> AnyGoalHandle:
        """Send *goal* (in the frame map) to the navigator, and return its handle."""
        return self.send_goal(NavigateGoal((goal,)), "navigate_to_pose")

    def send_goal(self, goal: object, action: str, server_name: str = "") -> AnyGoalHandle:
        """Send a goal to a server; see `NavigationServers.send_goal`."""
        from rclpy.action import ActionClient

        self._session.refresh()
        converter = ACTIONS.get(action)
        server = server_name or action
        try:
            if converter is None:
                raise RosError(f"there is no client of the action {action}")
            named = self._client("action", converter.type, server, partial(ActionClient, self._session.node))
            handle: AnyGoalHandle = Nav2GoalHandle(self._session, named, goal, converter)
        except RosError as error:
            handle = GoalHandle(goal)
            handle.abort(int(Nav2ErrorCode.SEND_GOAL_FAILURE), str(error))
        self._last_goals[action] = handle
        return handle

    def cancel_goals(self, action: str, server_name: str = "") -> AnyGoalHandle:
        """Cancel the goals of a server that are older than 10 ms; see `NavigationServers.cancel_goals`."""
        from action_msgs.srv import CancelGoal
        from rclpy.duration import Duration

        node = self._session.node
        message = CancelGoal.Request()
        message.goal_info.stamp = (node.get_clock().now() - Duration(nanoseconds=CANCEL_AGE_NS)).to_msg()
        return self._call(CancelGoal, f"{server_name or action}/_action/cancel_goal", action, message)

    def request(self, request: object, service_name: str = "") -> AnyGoalHandle:
        """Send a request to a service; see `NavigationServers.request`."""
        try:
            service_type, default = service_of(request)
            name = service_name or default
            if not name:
                raise RosError(f"{service_type.__name__} has no default name: set the port service_name")
            message = service_type.Request()
            write_request(request, message)
        except RosError as error:
            handle: AnyGoalHandle = GoalHandle(request)
            handle.abort(0, str(error))
            return handle
        return self._call(service_type, name, request, message)

    def pose(self) -> Pose2D | None:
        """Return the robot's newest pose in the frame map by tf; None if unknown."""
        self._session.refresh()
        return self._listener.pose()

    def odometry(self) -> Odometry | None:
        """Return the newest message of the topic `odom`, or None before the first."""
        from nav_msgs.msg import Odometry as OdometryMessage

        return cast("Odometry | None", self._newest("odom", OdometryMessage, _read_odometry))

    def battery(self, topic: str) -> Battery | None:
        """Return the newest message (sensor_msgs/BatteryState) of *topic*, or None before the first."""
        from sensor_msgs.msg import BatteryState

        return cast("Battery | None", self._newest(topic, BatteryState, _read_battery))

    def latest(self, topic: str, message_type: type[Message]) -> Message | None:
        """Return the newest message of *topic*; see `NavigationServers.latest`.

        The type of the messages is std_msgs/String (latched), geometry_msgs/PoseStamped, or nav_msgs/Goals.
        """
        if message_type is str:
            from std_msgs.msg import String

            return cast("Message | None", self._newest(topic, String, _read_text, latched=True))
        if message_type is list:
            from nav_msgs.msg import Goals

            return cast(
                "Message | None", self._newest(topic, Goals, lambda goals: list(poses_from_goals(goals)))
            )
        from geometry_msgs.msg import PoseStamped

        return cast("Message | None", self._newest(topic, PoseStamped, pose_from_stamped))

    def can_transform(self, target: str, source: str) -> bool:
        """Return whether the transform from the frame *source* to the frame *target* is available."""
        self._session.refresh()
        return self._listener.transforms.can_transform(target.lstrip("/"), source.lstrip("/"))

    def last_goals(self) -> Mapping[str, AnyGoalHandle]:
        """Return the last goals by action; see `NavigationServers.last_goals`."""
        goals, actions = self._last_goals, (*PLANNING, "follow_path", *RECOVERIES)
        return {action: goals[action] for action in actions if action in goals}

    @property
    def is_recovering(self) -> bool:
        """Whether a recovery behaviour has a goal that has not ended."""
        handles = (self._last_goals.get(action) for action in RECOVERIES)
        return any(handle is not None and handle.status not in ENDED for handle in handles)

    @property
    def is_pose_contradicted(self) -> bool:
        """False: Nav2's localisation does not report that."""
        return False

    def _call(self, service_type: Any, name: str, request: object, message: Any) -> AnyGoalHandle:
        self._session.refresh()
        named = self._client("service", service_type, name, self._session.node.create_client)
        return Nav2RequestHandle(self._session, named, request, message)

    def _client(self, kind: str, interface: Any, name: str, create: Callable[..., Any]) -> NamedClient:
        """Return the client of the server *name*, which leaves for ROS 2 use, too."""
        key = (kind, interface, name)
        if key not in self._clients:
            create = partial(create, interface, name, callback_group=self._session.callback_group)
            shared = self._session.entities.use(self, key, create)
            self._clients[key] = NamedClient(shared, name, self.discovery_ns)
        return self._clients[key]

    def _newest(
        self, topic: str, message_class: Any, read: Callable[[Any], object], *, latched: bool = False
    ) -> object | None:
        """Return the newest message of *topic*, converted by *read*; the first call subscribes to it."""
        if topic not in self._messages:
            self._messages[topic] = None
            self._subscribe(topic, message_class, read, latched)
        self._session.refresh()
        return self._messages[topic]

    def _subscribe(
        self, topic: str, message_class: Any, read: Callable[[Any], object], latched: bool
    ) -> None:
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        def take(message: Any) -> None:
            try:
                self._messages[topic] = read(message)
            except RosError as error:
                if topic not in self._warned:
                    log.warning("messages of the topic '%s' are ignored: %s", topic, error)
                self._warned.add(topic)

        if latched:
            profile = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        else:
            # Receives from publishers of both reliabilities.
            profile = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._session.node.create_subscription(
            message_class, topic, take, profile, callback_group=self._session.callback_group
        )


def _discovery_ms(node: Any) -> int:
    """Return the ROS parameter `wait_for_service_timeout` (ms), which another client may have declared."""
    name = "wait_for_service_timeout"
    if node.has_parameter(name):
        return int(node.get_parameter(name).value)
    return int(declare_parameter(node, name, DISCOVERY_MS))


def _read_odometry(message: Any) -> Odometry:
    twist = message.twist.twist
    stamp = time_to_ns(message.header.stamp)
    return Odometry(pose_from_message(message.pose.pose), Twist2D(twist.linear.x, twist.angular.z), stamp)


def _read_battery(message: Any) -> Battery:
    fraction, voltage = (
        float(value) if math.isfinite(value) else None for value in (message.percentage, message.voltage)
    )
    return Battery(fraction, voltage, message.power_supply_status == message.POWER_SUPPLY_STATUS_CHARGING)


def _read_text(message: Any) -> str:
    return str(message.data)
