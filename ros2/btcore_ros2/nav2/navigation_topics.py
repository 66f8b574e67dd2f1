"""The topics of a navigation: map, costmaps, pose, transforms and plans, as Nav2 publishes them."""

import json
import math
from array import array
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import (
    Point32,
    PolygonStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    TransformStamped,
)
from nav_msgs.msg import OccupancyGrid, Path
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    QoSProfile,
    ReliabilityPolicy,
    qos_profile_sensor_data,
    qos_profile_system_default,
)
from std_msgs.msg import Header

from btcore.clock import NS_PER_S
from btcore_navigation.costmap import Costmap
from btcore_navigation.localiser import Localiser
from btcore_navigation.parameters import CostmapParameters
from btcore_navigation.path import NavPath
from btcore_navigation.stack import Navigation
from btcore_robot.occupancy_map import Grid, OccupancyMap
from btcore_robot.robot import BASE_FRAME, MAP_FRAME, ODOM_FRAME, Phase, Pose2D, Robot
from btcore_robot.transforms import TransformError
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

if TYPE_CHECKING:
    from btcore_sim.simulated_robot import SimulatedRobot

LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)

POSE_RATE, PARTICLE_RATE = 20.0, 1.0
UNIT_TOLERANCE = 1e-4  # of the square of a quaternion's length, as in Nav2
"""The rates (Hz) of transforms, pose and plans, and of particles."""

_COVARIANCES = (0, 1, 5)  # the rows and columns of x, y and yaw in a covariance of six dimensions

# Costs 1 to 252 become 1 to 98, an inscribed cell 99, an obstacle 100 and an unknown cell -1, as in Nav2.
_OCCUPANCY = np.array(
    [0, *(1 + 97 * (cost - 1) // 251 for cost in range(1, 253)), 99, 100, -1], dtype=np.int8
)


class NavigationTopics:
    """Publishes the state of a navigation, and takes initial poses and goals from topics.

    Published: `map`, `amcl_pose` (latched), `plan`, `local_plan`, `particle_cloud` (best effort), the topics
    of both costmaps (see `CostmapTopics`), and the transform from `map` to `odom`. Subscribed: `initialpose`
    and `goal_pose`. A robot simulated in this process also has its own topics (see `RobotTopics`), with the
    laser's readings on `scan`. All names are relative, except `/tf` and `/tf_static`.

    Args:
        navigates: Whether goals are taken from `goal_pose`.

    Raises:
        RosError: nav2_msgs or tf2_msgs is missing.
    """

    def __init__(self, session: RosSession, navigation: Navigation, *, navigates: bool = True) -> None:
        self._navigation = navigation
        self._node = node = session.node
        robot = navigation.robot
        self._map = node.create_publisher(OccupancyGrid, "map", LATCHED)
        self._pose = node.create_publisher(PoseWithCovarianceStamped, "amcl_pose", LATCHED)
        self._plan = node.create_publisher(Path, "plan", 1)
        self._local_plan = node.create_publisher(Path, "local_plan", 1)
        self._particles = node.create_publisher(
            nav2_type("msg", "ParticleCloud"), "particle_cloud", qos_profile_sensor_data
        )
        self._tf_type = load_interface("tf2_msgs/msg/TFMessage", "msg")
        self._tf = node.create_publisher(self._tf_type, "/tf", QoSProfile(depth=100))
        self._publishes_odometry = not isinstance(robot, RosRobot)
        if self._publishes_odometry and (simulated := _simulated(robot)) is not None:
            from btcore_ros2.simulation.topics import RobotTopics

            RobotTopics(session, simulated, scan="scan", ros_time=self._ros_time)
            self._publishes_odometry = False
        node.create_subscription(PoseWithCovarianceStamped, "initialpose", self._set_pose, 1)
        if navigates:
            node.create_subscription(PoseStamped, "goal_pose", self._go_to, 1)
        self._published_map: OccupancyMap | None = None
        self._published_pose: Pose2D | None = None
        self._published_plan: NavPath | None = None
        self._publish_map()
        add_task, parameters = robot.schedule.add_task, navigation.parameters
        add_task(POSE_RATE, Phase.COMPONENTS, self._publish_pose)
        add_task(PARTICLE_RATE, Phase.COMPONENTS, self._publish_particles)
        for name, settings, pose in (
            ("global_costmap", parameters.global_costmap, navigation.estimate),
            ("local_costmap", parameters.local_costmap, lambda: robot.odometry().pose),
        ):
            topics = CostmapTopics(node, navigation, name, settings, self._stamp)
            if settings.publish_frequency:
                add_task(settings.publish_frequency, Phase.COMPONENTS, topics.publish)
            if settings.update_frequency:
                add_task(settings.update_frequency, Phase.COMPONENTS, partial(topics.publish_footprint, pose))

    def _ros_time(self, stamp: int) -> int:
        """Return the ROS time (ns) for *stamp* (ns) of the robot's clock.

        A robot that follows `/clock` has ROS time.
        """
        clock = self._navigation.robot.clock
        if isinstance(clock, SimTime):
            return stamp
        now: int = self._node.get_clock().now().nanoseconds
        return now + stamp - clock.now()

    def _stamp(self, offset: float = 0.0) -> Time:
        """Return the ROS time *offset* s after now."""
        now = self._ros_time(self._navigation.robot.clock.now()) + round(offset * NS_PER_S)
        return Time(sec=now // NS_PER_S, nanosec=now % NS_PER_S)

    def _publish_map(self) -> None:
        """Publish the map if it has changed."""
        known = self._navigation.map
        if known is not self._published_map:
            self._published_map = known
            stamp = self._stamp()
            message = occupancy_grid(known, known.cells, MAP_FRAME, stamp)
            message.info.map_load_time = stamp
            self._map.publish(message)

    def _publish_pose(self, now: int) -> None:
        navigation = self._navigation
        self._publish_map()
        # As AMCL does: the transform is valid until the next scans have been processed.
        tolerance = navigation.parameters.amcl.transform_tolerance
        transforms = [self._transform(MAP_FRAME, ODOM_FRAME, tolerance)] if navigation.is_localising else []
        if self._publishes_odometry:
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
        if self._local_plan.get_subscription_count():
            local = navigation.servers.follow_path.local_plan()
            if local is not None:
                self._local_plan.publish(path_to_message(local, self._stamp()))

    def _publish_particles(self, now: int) -> None:
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

    def _set_pose(self, message: PoseWithCovarianceStamped) -> None:
        localiser = self._navigation.localiser
        if message.header.frame_id.strip("/") != MAP_FRAME or not isinstance(localiser, Localiser):
            self._warn(f"initialpose: the pose has to be in the frame '{MAP_FRAME}'")
            return
        turn = message.pose.pose.orientation
        # As amcl: goals may have such quaternions, initial poses may not.
        if not abs(turn.x**2 + turn.y**2 + turn.z**2 + turn.w**2 - 1.0) < UNIT_TOLERANCE:
            self._warn("initialpose: ignored, because its quaternion is not a unit quaternion")
            return
        covariance = np.array(message.pose.covariance).reshape(6, 6)[np.ix_(_COVARIANCES, _COVARIANCES)]
        try:
            pose = pose_from_message(message.pose.pose)
            if not self._navigation.map.inside(pose.x, pose.y):
                self._warn(f"initialpose: ({pose.x:.2f}, {pose.y:.2f}) is outside the map")
            self._published_pose = None  # as AMCL, publish the pose even if it is the same
            localiser.set_pose(pose, covariance if covariance.any() else None)
        except RosError as error:
            self._warn(f"initialpose: {error}")

    def _go_to(self, message: PoseStamped) -> None:
        try:
            self._navigation.go_to(pose_from_stamped(message))
        except RosError as error:
            self._warn(f"goal_pose: {error}")

    def _warn(self, text: str) -> None:
        self._node.get_logger().warning(text)


class CostmapTopics:
    """The topics of a costmap, as Nav2's Costmap2DROS publishes them, all below its name.

    `costmap` and `costmap_raw` are the whole costmap, with the costs as occupancies and as they are. Both are
    latched. While origin, size, resolution and subscribers stay the same, `costmap_updates` and
    `costmap_raw_updates` follow instead, with the smallest rectangle that contains all changed costs, unless
    the parameter `always_send_full_costmap` is set. `published_footprint` is the robot's outline at its pose.

    Args:
        node: The ROS node.
        name: The name of the costmap, `global_costmap` or `local_costmap`.
        stamp: Returns the ROS time.

    Raises:
        RosError: nav2_msgs is missing.
    """

    def __init__(
        self,
        node: Node,
        navigation: Navigation,
        name: str,
        parameters: CostmapParameters,
        stamp: Callable[[], Time],
    ) -> None:
        self._navigation, self._name, self._stamp = navigation, name, stamp
        self._always_full = parameters.always_send_full_costmap
        self._outline = footprint_points(parameters)
        topic = f"{name}/costmap"
        self._grid = node.create_publisher(OccupancyGrid, topic, LATCHED)
        self._raw = node.create_publisher(nav2_type("msg", "Costmap"), f"{topic}_raw", LATCHED)
        self._update_type = nav2_type("msg", "CostmapUpdate")
        self._raw_updates = node.create_publisher(self._update_type, f"{topic}_raw_updates", LATCHED)
        try:
            self._grid_update_type = load_interface("map_msgs/msg/OccupancyGridUpdate", "msg")
        except RosError as missing:
            node.get_logger().warning(f"{topic}_updates is not published: {missing}")
            self._always_full, self._updates = True, None
        else:
            self._updates = node.create_publisher(self._grid_update_type, f"{topic}_updates", LATCHED)
        self._footprint = node.create_publisher(
            PolygonStamped, f"{name}/published_footprint", qos_profile_system_default
        )
        self._published: tuple[object, ...] = ()
        """Origin, size and resolution of the costmap that was published, and its number of subscribers."""
        self._costs = np.empty((0, 0), np.uint8)
        """The costs that the subscribers have."""

    @property
    def _costmap(self) -> Costmap:
        costmap: Costmap = getattr(self._navigation, self._name)
        return costmap

    def publish(self, now: int) -> None:
        """Publish the costmap, or what has changed in it."""
        costmap = self._costmap
        counts = self._grid.get_subscription_count(), self._raw.get_subscription_count()
        # A new subscriber has received the last whole costmap, without later updates.
        now_published = costmap.origin, costmap.costs.shape, costmap.resolution, counts
        if self._always_full or now_published != self._published:
            self._published, self._costs = now_published, costmap.costs.copy()
            if counts[0]:
                cells = _OCCUPANCY[costmap.costs]
                self._grid.publish(occupancy_grid(costmap, cells, costmap.frame, self._stamp()))
            if counts[1]:
                self._raw.publish(costmap_message(costmap, self._stamp()))
        elif (changed := costmap.costs != self._costs).any():
            self._publish_update(costmap, changed)
            self._costs = costmap.costs.copy()

    def _publish_update(self, costmap: Costmap, changed: NDArray[np.bool_]) -> None:
        rows, cols = (np.flatnonzero(changed.any(axis=axis)) for axis in (1, 0))
        x, y = int(cols[0]), int(rows[0])
        costs = costmap.costs[y : rows[-1] + 1, x : cols[-1] + 1]
        height, width = costs.shape
        header = Header(frame_id=costmap.frame, stamp=self._stamp())
        if self._updates is not None and self._updates.get_subscription_count():
            update = self._grid_update_type(header=header, x=x, y=y, width=width, height=height)
            update.data = array("b", _OCCUPANCY[costs].tobytes())
            self._updates.publish(update)
        if self._raw_updates.get_subscription_count():
            update = self._update_type(header=header, x=x, y=y, size_x=width, size_y=height)
            update.data = array("B", costs.tobytes())
            self._raw_updates.publish(update)

    def publish_footprint(self, pose: Callable[[], Pose2D | None], now: int) -> None:
        """Publish the outline of the robot at *pose* in the frame of the costmap; nothing for None."""
        here = pose() if self._footprint.get_subscription_count() else None
        if here is None:
            return
        cos, sin = math.cos(here.yaw), math.sin(here.yaw)
        message = PolygonStamped()
        message.header.frame_id, message.header.stamp = self._costmap.frame, self._stamp()
        message.polygon.points = [
            Point32(x=here.x + cos * x - sin * y, y=here.y + sin * x + cos * y) for x, y in self._outline
        ]
        self._footprint.publish(message)


def footprint_points(parameters: CostmapParameters) -> list[tuple[float, float]]:
    """Return the corners (m) of the robot's outline: its footprint, or 16 points of a circle, as in Nav2."""
    if parameters.footprint:
        return [(float(x), float(y)) for x, y in json.loads(parameters.footprint)]
    radius, turns = parameters.robot_radius, (math.pi * corner / 8 for corner in range(16))
    return [(radius * math.cos(turn), radius * math.sin(turn)) for turn in turns]


def occupancy_grid(grid: Grid, cells: NDArray[np.int8], frame: str, stamp: Time) -> OccupancyGrid:
    """Return a grid as a `nav_msgs/OccupancyGrid`.

    Args:
        grid: The source of the resolution and the origin.
        cells: The occupancies, shape `(height, width)`, row 0 with the lowest y.
        frame: The frame of the grid.
    """
    message = OccupancyGrid()
    message.header.frame_id, message.header.stamp = frame, stamp
    message.info.resolution = grid.resolution
    message.info.height, message.info.width = cells.shape
    message.info.origin = pose_to_message(Pose2D(*grid.origin, 0.0))
    # Assigning an array of this type is a hundred times faster than a list or a numpy array.
    message.data = array("b", np.ascontiguousarray(cells).tobytes())
    return message


def costmap_message(costmap: Costmap, stamp: Time) -> Any:
    """Return *costmap* as a `nav2_msgs/Costmap`. Raises RosError if nav2_msgs is missing."""
    message = nav2_type("msg", "Costmap")()
    message.header.frame_id, message.header.stamp = costmap.frame, stamp
    metadata = message.metadata
    metadata.layer, metadata.resolution = "master", costmap.resolution
    metadata.map_load_time = metadata.update_time = stamp
    metadata.size_y, metadata.size_x = costmap.costs.shape
    metadata.origin = pose_to_message(Pose2D(*costmap.origin, 0.0))
    message.data = array("B", costmap.costs.tobytes())
    return message


def _simulated(robot: Robot) -> "SimulatedRobot | None":
    try:
        from btcore_sim.simulated_robot import SimulatedRobot
    except ModuleNotFoundError:  # without the extra sim
        return None
    return robot if isinstance(robot, SimulatedRobot) else None
