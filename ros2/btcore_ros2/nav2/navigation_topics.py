"""The topics of a navigation: map, costmaps, pose, transforms and plan, as Nav2 publishes them."""

from array import array

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import OccupancyGrid, Path
from numpy.typing import NDArray
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from btcore_robot.navigation.localiser import Localiser
from btcore_robot.navigation.occupancy_map import Grid
from btcore_robot.navigation.path import NavPath
from btcore_robot.navigation.stack import Navigation
from btcore_robot.robot import NS_PER_S, Phase, Pose2D
from btcore_robot.transforms import BASE_FRAME, MAP_FRAME, ODOM_FRAME, TransformError
from btcore_ros2.errors import RosError
from btcore_ros2.interfaces import load_interface
from btcore_ros2.nav2.conversions import (
    nav2_type,
    path_to_message,
    pose_from_message,
    pose_from_stamped,
    pose_to_message,
)
from btcore_ros2.robot.ros_robot import RosRobot
from btcore_ros2.robot.sim_time import SimTime
from btcore_ros2.session import RosSession

LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)

POSE_RATE, COSTMAP_RATE = 20.0, 1.0
"""The rates (Hz) of transforms, pose and plan, and of costmaps and particles."""

_COVARIANCES = (0, 1, 5)  # the rows and columns of x, y and yaw in a covariance of six dimensions

# Costs 1 to 252 become 1 to 98, an inscribed cell 99, an obstacle 100 and an unknown cell -1, as in Nav2.
_OCCUPANCY = np.array(
    [0, *(1 + 97 * (cost - 1) // 251 for cost in range(1, 253)), 99, 100, -1], dtype=np.int8
)


class NavigationTopics:
    """Publishes the state of a navigation, and takes initial poses and goals from topics.

    Published: `/map`, `amcl_pose`, `global_costmap/costmap`, `local_costmap/costmap` (latched), `plan`,
    `particle_cloud` (best effort), and the transform from `map` to `odom`. For a robot in this process the
    transform from `odom` to `base_footprint` is published too. Subscribed: `initialpose` and `goal_pose`.

    Args:
        session: The session.
        navigation: The navigation.
        navigates: Whether goals are taken from `goal_pose`.

    Raises:
        RosError: nav2_msgs or tf2_msgs is missing.
    """

    def __init__(self, session: RosSession, navigation: Navigation, *, navigates: bool = True) -> None:
        self._navigation = navigation
        self._node = node = session.node
        robot = navigation.robot
        self._is_simulated_here = not isinstance(robot, RosRobot)
        self._map = node.create_publisher(OccupancyGrid, "/map", LATCHED)
        self._pose = node.create_publisher(PoseWithCovarianceStamped, "amcl_pose", LATCHED)
        self._plan = node.create_publisher(Path, "plan", 1)
        self._particles = node.create_publisher(
            nav2_type("msg", "ParticleCloud"), "particle_cloud", BEST_EFFORT
        )
        self._tf_type = load_interface("tf2_msgs/msg/TFMessage", "msg")
        self._tf = node.create_publisher(self._tf_type, "/tf", QoSProfile(depth=100))
        self._costmaps = [
            (costmap, node.create_publisher(OccupancyGrid, f"{name}/costmap", LATCHED))
            for name, costmap in (
                ("global_costmap", navigation.global_costmap),
                ("local_costmap", navigation.local_costmap),
            )
        ]
        node.create_subscription(PoseWithCovarianceStamped, "initialpose", self._set_pose, 1)
        if navigates:
            node.create_subscription(PoseStamped, "goal_pose", self._go_to, 1)
        self._published_pose: Pose2D | None = None
        self._published_plan: NavPath | None = None
        self._map.publish(self._grid(navigation.map, navigation.map.cells, MAP_FRAME))
        robot.schedule.every(POSE_RATE, Phase.PROCESSES, self._publish_pose)
        robot.schedule.every(COSTMAP_RATE, Phase.PROCESSES, self._publish_costmaps)

    def _stamp(self, offset: float = 0.0) -> Time:
        """Return the ROS time *offset* s after now: that of `/clock` for a robot that follows it."""
        clock = self._navigation.robot.clock
        now = clock.now() if isinstance(clock, SimTime) else self._node.get_clock().now().nanoseconds
        now += round(offset * NS_PER_S)
        return Time(sec=now // NS_PER_S, nanosec=now % NS_PER_S)

    def _publish_pose(self, now: int) -> None:
        navigation = self._navigation
        # As AMCL does: the transform is valid until the next scans have been processed.
        transforms = [self._transform(MAP_FRAME, ODOM_FRAME, navigation.parameters.amcl.transform_tolerance)]
        if self._is_simulated_here:
            transforms.append(self._transform(ODOM_FRAME, BASE_FRAME, 0.0))
        known = [transform for transform in transforms if transform is not None]
        if known:
            self._tf.publish(self._tf_type(transforms=known))
        pose = navigation.estimate()
        if pose is not None and pose != self._published_pose:
            self._published_pose = pose
            message = PoseWithCovarianceStamped()
            message.header.frame_id, message.header.stamp = MAP_FRAME, self._stamp()
            message.pose.pose = pose_to_message(pose)
            if isinstance(navigation.localiser, Localiser):
                covariance = np.zeros((6, 6))
                covariance[np.ix_(_COVARIANCES, _COVARIANCES)] = navigation.localiser.covariance
                message.pose.covariance = covariance.ravel()
            self._pose.publish(message)
        planned = navigation.servers.compute_path.current
        path = planned.result.value if planned is not None and planned.result is not None else None
        if isinstance(path, NavPath) and path is not self._published_plan:
            self._published_plan = path
            self._plan.publish(path_to_message(path, self._stamp()))

    def _publish_costmaps(self, now: int) -> None:
        for costmap, publisher in self._costmaps:
            if publisher.get_subscription_count():
                publisher.publish(self._grid(costmap, _OCCUPANCY[costmap.costs], costmap.frame))
        localiser = self._navigation.localiser
        if isinstance(localiser, Localiser) and self._particles.get_subscription_count():
            particle = nav2_type("msg", "Particle")
            cloud = nav2_type("msg", "ParticleCloud")()
            cloud.header.frame_id, cloud.header.stamp = MAP_FRAME, self._stamp()
            cloud.particles = [
                particle(pose=pose_to_message(Pose2D(x, y, yaw)), weight=weight)
                for (x, y, yaw), weight in zip(
                    localiser.particles.tolist(), localiser.weights.tolist(), strict=True
                )
            ]
            self._particles.publish(cloud)

    def _transform(self, target: str, source: str, offset: float) -> TransformStamped | None:
        """Return the pose of the frame *source* in *target*, with a stamp *offset* s after now, or None."""
        try:
            pose = self._navigation.transforms.lookup(target, source).to_pose()
        except TransformError:
            return None
        place = pose_to_message(pose)
        message = TransformStamped(child_frame_id=source)
        message.header.frame_id, message.header.stamp = target, self._stamp(offset)
        message.transform.translation.x = place.position.x
        message.transform.translation.y = place.position.y
        message.transform.rotation = place.orientation
        return message

    def _grid(self, grid: Grid, cells: NDArray[np.int8], frame: str) -> OccupancyGrid:
        message = OccupancyGrid()
        message.header.frame_id, message.header.stamp = frame, self._stamp()
        message.info.map_load_time = message.header.stamp
        message.info.resolution = grid.resolution
        message.info.height, message.info.width = cells.shape
        message.info.origin = pose_to_message(Pose2D(*grid.origin, 0.0))
        # Assigning an array of this type is a hundred times faster than a list or a numpy array.
        message.data = array("b", np.ascontiguousarray(cells).tobytes())
        return message

    def _set_pose(self, message: PoseWithCovarianceStamped) -> None:
        localiser = self._navigation.localiser
        if message.header.frame_id not in ("", MAP_FRAME) or not isinstance(localiser, Localiser):
            self._warn(f"initialpose: the pose has to be in the frame '{MAP_FRAME}'")
            return
        covariance = np.array(message.pose.covariance).reshape(6, 6)[np.ix_(_COVARIANCES, _COVARIANCES)]
        try:
            localiser.set_pose(pose_from_message(message.pose.pose), covariance if covariance.any() else None)
        except RosError as error:
            self._warn(f"initialpose: {error}")

    def _go_to(self, message: PoseStamped) -> None:
        try:
            self._navigation.go_to(pose_from_stamped(message))
        except RosError as error:
            self._warn(f"goal_pose: {error}")

    def _warn(self, text: str) -> None:
        self._node.get_logger().warning(text)
