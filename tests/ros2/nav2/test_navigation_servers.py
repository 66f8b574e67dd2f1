"""`btcore ros2 navigation` with a simulated robot, and plain rclpy clients in other processes."""

import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("nav2_msgs")
pytest.importorskip("tf2_msgs")
pytest.importorskip("pybullet")

from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TwistStamped
from lifecycle_msgs.msg import Transition
from nav2_msgs.action import NavigateThroughPoses
from nav2_msgs.srv import ManageLifecycleNodes
from nav_msgs.msg import OccupancyGrid
from nav_msgs.msg import Path as PathMessage
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from std_msgs.msg import Empty
from tf2_msgs.msg import TFMessage

from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_robot.occupancy_map import OccupancyMap, save_map
from btcore_ros2.interfaces import load_interface
from btcore_ros2.session import RosSession
from tests.ros2.action_client import ClientProcess
from tests.ros2.conftest import LIMIT_S, wait_until
from tests.ros2.nav2.conftest import LONG_TIMEOUTS
from tests.ros2.nav2.rviz_displays import DISPLAYS, Qos

SUCCEEDED, CANCELED, ABORTED = (
    GoalStatus.STATUS_SUCCEEDED,
    GoalStatus.STATUS_CANCELED,
    GoalStatus.STATUS_ABORTED,
)


PARAMETERS = """
global_costmap: {ros__parameters: {obstacle_max_range: 5.0}}
local_costmap: {ros__parameters: {obstacle_max_range: 5.0, width: 6}}
"""
"""Parameters with which the costmaps contain observed walls, which change with the noise of the laser."""


class NavigationProcess:
    """The process of the navigation, and a client of its topics and actions."""

    def __init__(self, session: RosSession, parameters: Path) -> None:
        self.session = session
        self.started = time.time()
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-m", "btcore", "ros2", "navigation"),
                *("--world", "arena", "--camera", "off", "--start", "0,0,0"),
                *(
                    "--nav-params",
                    str(parameters),
                    "--nav2",
                    "--save-map",
                    str(parameters.parent / "map.yaml"),
                ),
            ],
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "NO_COLOR": "1"},
        )
        self.text = ""
        self.reader = threading.Thread(target=self._read)
        self.reader.start()
        self.newest: dict[str, Any] = {}
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        for name, kind, qos in (
            ("map", OccupancyGrid, latched),
            ("amcl_pose", PoseWithCovarianceStamped, latched),
            ("global_costmap/costmap", OccupancyGrid, latched),
            ("local_costmap/costmap", OccupancyGrid, latched),
            ("plan", PathMessage, 1),
        ):
            session.node.create_subscription(kind, name, self._keep(name), qos)
        session.node.create_subscription(TFMessage, "/tf", self._keep_transforms, 100)
        self.client = ClientProcess(self.wait)
        self.wait(lambda: "navigation is ready" in self.text)
        # The robot drives only when its scans have confirmed its pose.
        self.wait(lambda: "amcl_pose" in self.newest)

    def _read(self) -> None:
        assert self.process.stderr is not None
        with self.process.stderr as lines:
            for line in lines:
                self.text += line

    def _keep(self, name: str) -> Callable[[Any], None]:
        def keep(message: Any) -> None:
            self.newest[name] = message

        return keep

    def _keep_transforms(self, message: Any) -> None:
        for transform in message.transforms:
            self.newest[transform.child_frame_id] = transform

    def wait(self, condition: Callable[[], Any]) -> None:
        assert self.process.poll() is None, self.text
        assert self.session.wait_for(condition, LIMIT_S), self.text

    def pose(self) -> tuple[float, float, float]:
        pose = self.newest["amcl_pose"].pose.pose
        return pose.position.x, pose.position.y, 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)

    def send(self, action: str, kind: str, goal: dict[str, Any], *, accepted: bool = True) -> int:
        return self.client.send(action, f"nav2_msgs/action/{kind}", goal, accepted=accepted)

    def end(self) -> None:
        self.process.send_signal(signal.SIGINT)
        assert self.process.wait(LIMIT_S) == 130, self.text
        self.reader.join()


@pytest.fixture(scope="module")
def navigation(tmp_path_factory: pytest.TempPathFactory) -> Iterator[NavigationProcess]:
    parameters = tmp_path_factory.mktemp("navigation") / "parameters.yaml"
    parameters.write_text(PARAMETERS)
    with RosSession("test") as session:
        navigation = NavigationProcess(session, parameters)
        yield navigation
        if navigation.process.poll() is None:
            navigation.end()
        navigation.client.close()


def stamped(x: float, y: float, frame: str = "map") -> dict[str, Any]:
    return {"header": {"frame_id": frame}, "pose": {"position": {"x": x, "y": y}}}


def test_options_without_effect(navigation: NavigationProcess) -> None:
    assert "warning: --nav2 has no effect" in navigation.text
    assert "warning: --save-map has no effect" in navigation.text


def test_services_of_the_simulated_robot(navigation: NavigationProcess) -> None:
    assert navigation.client.call("sim/recharge", "std_srvs/srv/Trigger")["success"]


def test_initial_poses_that_are_not_valid(navigation: NavigationProcess) -> None:
    """An initial pose without a valid heading is ignored, and a place outside the map is reported."""
    publisher = navigation.session.node.create_publisher(PoseWithCovarianceStamped, "initialpose", 1)
    navigation.wait(lambda: publisher.get_subscription_count())
    message = PoseWithCovarianceStamped()
    message.header.frame_id = "map"
    message.pose.pose.orientation.w = 0.0
    publisher.publish(message)
    navigation.wait(lambda: "not a unit quaternion" in navigation.text)
    message.pose.pose.orientation.w, message.pose.pose.position.x = 1.0, 100.0
    publisher.publish(message)
    navigation.wait(lambda: "(100.00, 0.00) is outside the map" in navigation.text)
    message.pose.pose.position.x = 0.0
    published = navigation.session.node.get_clock().now()
    publisher.publish(message)

    # The pose before that outside the map is also near 0, and may still be the newest that has arrived.
    def is_set() -> bool:
        newest = Time.from_msg(navigation.newest["amcl_pose"].header.stamp)
        return newest > published and abs(navigation.pose()[0]) < 0.1

    navigation.wait(is_set)


def test_map_and_transforms(navigation: NavigationProcess) -> None:
    navigation.wait(lambda: {"map", "odom", "base_footprint"} <= navigation.newest.keys())
    grid = navigation.newest["map"]
    assert grid.header.frame_id == "map"
    assert len(grid.data) == grid.info.width * grid.info.height
    assert {0, 100} <= set(grid.data)
    assert navigation.newest["odom"].header.frame_id == "map"
    assert navigation.newest["base_footprint"].header.frame_id == "odom"
    assert navigation.pose() == pytest.approx((0.0, 0.0, 0.0), abs=0.1)


def test_costmaps(navigation: NavigationProcess) -> None:
    navigation.wait(lambda: {"global_costmap/costmap", "local_costmap/costmap"} <= navigation.newest.keys())
    frames = {
        name: navigation.newest[f"{name}_costmap/costmap"].header.frame_id for name in ("global", "local")
    }
    assert frames == {"global": "map", "local": "odom"}
    assert {0, 99, 100} <= set(navigation.newest["global_costmap/costmap"].data)


def test_compute_path(navigation: NavigationProcess) -> None:
    number = navigation.send("compute_path_to_pose", "ComputePathToPose", {"goal": stamped(1.0, 0.5)})
    status, result = navigation.client.result(number)
    assert (status, result["error_code"]) == (SUCCEEDED, 0)
    assert len(result["path"]["poses"]) > 5
    assert result["path"]["header"]["stamp"]["sec"] > 0
    last = result["path"]["poses"][-1]["pose"]["position"]
    assert (last["x"], last["y"]) == pytest.approx((1.0, 0.5), abs=0.1)
    navigation.wait(lambda: "plan" in navigation.newest)


def test_compute_path_through_poses(navigation: NavigationProcess) -> None:
    goals = {"header": {"frame_id": "map"}, "goals": [stamped(0.5, 0.5), stamped(1.0, 0.0)]}
    number = navigation.send("compute_path_through_poses", "ComputePathThroughPoses", {"goals": goals})
    status, result = navigation.client.result(number)
    assert status == SUCCEEDED
    positions = [pose["pose"]["position"] for pose in result["path"]["poses"]]
    assert min(math.hypot(place["x"] - 0.5, place["y"] - 0.5) for place in positions) < 0.1


def test_errors_of_the_planner(navigation: NavigationProcess) -> None:
    number = navigation.send("compute_path_to_pose", "ComputePathToPose", {"goal": stamped(100.0, 0.0)})
    status, result = navigation.client.result(number)
    assert (status, result["error_code"]) == (ABORTED, Nav2ErrorCode.GOAL_OUTSIDE_MAP)
    assert result["error_msg"]
    far = {"goals": {"header": {"frame_id": "map"}, "goals": [stamped(100.0, 0.0)]}}
    number = navigation.send("compute_path_through_poses", "ComputePathThroughPoses", far)
    status, result = navigation.client.result(number)
    assert (status, result["error_code"]) == (ABORTED, Nav2ErrorCode.THROUGH_GOAL_OUTSIDE_MAP)


def test_goal_in_an_unknown_frame(navigation: NavigationProcess) -> None:
    for frame, reason in (("kitchen", "'kitchen'"), ("", "names no frame")):
        goal = {"goal": stamped(1.0, 0.0, frame)}
        status, result = navigation.client.result(
            navigation.send("compute_path_to_pose", "ComputePathToPose", goal)
        )
        assert status == ABORTED
        assert result["error_code"] == Nav2ErrorCode.COMPUTE_PATH_TF_ERROR
        assert reason in result["error_msg"]
    navigation.wait(lambda: "compute_path_to_pose failed with error 202: a pose names no" in navigation.text)


def test_services(navigation: NavigationProcess) -> None:
    call = navigation.client.call
    costs = call(
        "global_costmap/get_cost_global_costmap",
        "nav2_msgs/srv/GetCosts",
        poses=[stamped(0.0, 0.0), stamped(100.0, 0.0)],
    )
    assert costs["success"]
    assert costs["costs"][0] < 253
    assert costs["costs"][1] >= 254
    path = {"header": {"frame_id": "map"}, "poses": [stamped(0.0, 0.0), stamped(0.2, 0.0)]}
    assert call("is_path_valid", "nav2_msgs/srv/IsPathValid", path=path)["is_valid"]
    path["poses"] = [stamped(0.0, 0.0), stamped(100.0, 0.0)]
    checked = call("is_path_valid", "nav2_msgs/srv/IsPathValid", path=path)
    assert not checked["is_valid"]
    assert checked["invalid_pose_indices"] == [1]
    for scope in ("global", "local"):
        name = f"{scope}_costmap/clear_{{}}_{scope}_costmap"
        call(name.format("entirely"), "nav2_msgs/srv/ClearEntireCostmap")
        call(name.format("around"), "nav2_msgs/srv/ClearCostmapAroundRobot", reset_distance=1.0)
        call(name.format("except"), "nav2_msgs/srv/ClearCostmapExceptRegion", reset_distance=3.0)


def test_spin_and_cancel(navigation: NavigationProcess) -> None:
    goal = {"target_yaw": 0.5, "time_allowance": {"sec": 20}}
    number = navigation.send("spin", "Spin", goal)
    status, result = navigation.client.result(number)
    assert (status, result["error_code"]) == (SUCCEEDED, 0)
    assert navigation.client.feedback(number)[-1]["angular_distance_traveled"] == pytest.approx(0.5, abs=0.2)
    navigation.wait(lambda: abs(navigation.pose()[2] - 0.5) < 0.2)
    number = navigation.send("spin", "Spin", {"target_yaw": -6.0, "time_allowance": {"sec": 60}})
    navigation.client.wait_until_executing(number)
    assert navigation.client.cancel(number) == 1
    assert navigation.client.result(number)[0] == CANCELED


def test_spin_time_allowance(navigation: NavigationProcess) -> None:
    number = navigation.send("spin", "Spin", {"target_yaw": 6.0, "time_allowance": {"nanosec": 200_000_000}})
    status, result = navigation.client.result(number)
    assert (status, result["error_code"]) == (ABORTED, Nav2ErrorCode.SPIN_TIMEOUT)


def test_drive_on_heading_back_up_and_wait(navigation: NavigationProcess) -> None:
    drive = {"target": {"x": 0.1}, "speed": 0.2, "time_allowance": {"sec": 20}}
    number = navigation.send("drive_on_heading", "DriveOnHeading", drive)
    assert navigation.client.result(number)[0] == SUCCEEDED
    number = navigation.send("backup", "BackUp", {**drive, "target": {"x": -0.1}, "speed": 0.1})
    status, result = navigation.client.result(number)
    assert status == SUCCEEDED, result
    number = navigation.send("wait", "Wait", {"time": {"nanosec": 100_000_000}})
    assert navigation.client.result(number)[0] == SUCCEEDED


def test_follow_path(navigation: NavigationProcess) -> None:
    x, y, _ = navigation.pose()
    number = navigation.send("compute_path_to_pose", "ComputePathToPose", {"goal": stamped(x + 0.6, y)})
    _, planned = navigation.client.result(number)
    path = planned["path"]
    path["header"] = {"frame_id": "map"}
    path["poses"] = [{"header": {"frame_id": "map"}, "pose": pose["pose"]} for pose in path["poses"]]
    number = navigation.send("follow_path", "FollowPath", {"path": path})
    status, result = navigation.client.result(number)
    assert (status, result["error_code"]) == (SUCCEEDED, 0)
    assert navigation.client.feedback(number)
    number = navigation.send("follow_path", "FollowPath", {"path": path, "controller_id": "Other"})
    status, result = navigation.client.result(number)
    assert (status, result["error_code"]) == (ABORTED, Nav2ErrorCode.INVALID_CONTROLLER)
    number = navigation.send("follow_path", "FollowPath", {"path": {"header": {"frame_id": "map"}}})
    status, result = navigation.client.result(number)
    assert (status, result["error_code"]) == (ABORTED, Nav2ErrorCode.INVALID_PATH)


def test_navigate_to_pose(navigation: NavigationProcess) -> None:
    number = navigation.send("navigate_to_pose", "NavigateToPose", {"pose": stamped(0.0, 0.6)})
    # The other navigator is rejected meanwhile, and a new goal takes the place of the first.
    poses = {"poses": {"header": {"frame_id": "map"}, "goals": [stamped(0.0, 0.0)]}}
    navigation.client.wait_until_executing(number)
    navigation.send("navigate_through_poses", "NavigateThroughPoses", poses, accepted=False)
    # A goal with another tree does not replace it, as in Nav2.
    other = {"pose": stamped(0.3, 0.3), "behavior_tree": "navigate_w_replanning_time.xml"}
    status, result = navigation.client.result(navigation.send("navigate_to_pose", "NavigateToPose", other))
    assert status == ABORTED
    assert "uses another tree" in result["error_msg"]
    second = navigation.send("navigate_to_pose", "NavigateToPose", {"pose": stamped(0.3, 0.3)})
    assert navigation.client.result(number)[0] == ABORTED
    status, result = navigation.client.result(second)
    assert (status, result["error_code"]) == (SUCCEEDED, 0)
    feedback = navigation.client.feedback(second)
    assert feedback[0]["distance_remaining"] >= 0.0
    assert feedback[-1]["current_pose"]["header"]["frame_id"] == "map"
    assert feedback[-1]["current_pose"]["header"]["stamp"]["sec"] > 0
    x, y, _ = navigation.pose()
    assert math.hypot(x - 0.3, y - 0.3) < 0.4


def test_navigate_through_poses(navigation: NavigationProcess) -> None:
    goals = [stamped(0.6, 0.3), stamped(0.6, -0.3)]
    number = navigation.send(
        "navigate_through_poses",
        "NavigateThroughPoses",
        {"poses": {"header": {"frame_id": "map"}, "goals": goals}},
    )
    status, result = navigation.client.result(number)
    assert status == SUCCEEDED
    assert [waypoint["waypoint_status"] for waypoint in result["waypoint_statuses"]] == [1, 1]
    assert len(navigation.client.feedback(number)[0]["waypoint_statuses"]) == 2
    x, y, _ = navigation.pose()
    assert math.hypot(x - 0.6, y + 0.3) < 0.4
    tree = {"poses": {"goals": [stamped(0.0, 0.0)]}, "behavior_tree": "/none.xml"}
    number = navigation.send("navigate_through_poses", "NavigateThroughPoses", tree)
    status, result = navigation.client.result(number)
    assert (status, result["error_code"]) == (
        ABORTED,
        NavigateThroughPoses.Result.FAILED_TO_LOAD_BEHAVIOR_TREE,
    )


def test_smooth_path(navigation: NavigationProcess) -> None:
    corners = [stamped(0.0, 0.0), stamped(0.5, 0.5), stamped(1.0, 0.0)]
    path = {"header": {"frame_id": "map"}, "poses": corners}
    status, result = navigation.client.result(navigation.send("smooth_path", "SmoothPath", {"path": path}))
    assert (status, result["was_completed"]) == (SUCCEEDED, True)
    assert max(pose["pose"]["position"]["y"] for pose in result["path"]["poses"]) < 0.3
    goal = {"path": path, "smoother_id": "other"}
    status, result = navigation.client.result(navigation.send("smooth_path", "SmoothPath", goal))
    assert (status, result["error_code"]) == (ABORTED, Nav2ErrorCode.INVALID_SMOOTHER)


def test_follow_waypoints(navigation: NavigationProcess) -> None:
    x, y, _ = navigation.pose()
    goal = {"poses": [stamped(x, y), stamped(100.0, 0.0), stamped(0.0, 0.0)]}
    number = navigation.send("follow_waypoints", "FollowWaypoints", goal)
    status, result = navigation.client.result(number)
    assert (status, result["error_code"]) == (ABORTED, Nav2ErrorCode.STOP_ON_MISSED_WAYPOINT)
    [missed] = result["missed_waypoints"]
    assert (missed["waypoint_index"], missed["waypoint_status"]) == (1, 3)
    assert missed["error_code"] == Nav2ErrorCode.GOAL_OUTSIDE_MAP
    assert "(100.00, 0.00)" in missed["error_msg"]
    assert navigation.client.feedback(number)[-1]["current_waypoint"] == 1
    number = navigation.send("follow_waypoints", "FollowWaypoints", {"poses": [stamped(-0.6, -0.3)]})
    navigation.client.wait_until_executing(number)
    assert navigation.client.cancel(number) == 1
    assert navigation.client.result(number)[0] == CANCELED


def test_assisted_teleop(navigation: NavigationProcess) -> None:
    """The robot turns by the commands until the user has finished."""
    node = navigation.session.node
    command = node.create_publisher(TwistStamped, "cmd_vel_teleop", 1)
    finish = node.create_publisher(Empty, "preempt_teleop", 1)
    navigation.wait(lambda: command.get_subscription_count() and finish.get_subscription_count())
    before = navigation.pose()[2]
    number = navigation.send("assisted_teleop", "AssistedTeleop", {"time_allowance": {"sec": 120}})
    navigation.client.wait_until_executing(number)
    turn = TwistStamped()
    turn.twist.angular.z = 0.5
    command.publish(turn)
    navigation.wait(lambda: abs(navigation.pose()[2] - before) > 0.2)
    finish.publish(Empty())
    status, result = navigation.client.result(number)
    assert status == SUCCEEDED
    feedback = navigation.client.feedback(number)[-1]["current_teleop_duration"]
    total = result["total_elapsed_time"]
    assert 0 < feedback["sec"] + feedback["nanosec"] * 1e-9 <= total["sec"] + total["nanosec"] * 1e-9


def test_costmaps_on_request(navigation: NavigationProcess) -> None:
    for scope, frame in (("global", "map"), ("local", "odom")):
        costmap = navigation.client.call(f"{scope}_costmap/get_costmap", "nav2_msgs/srv/GetCostmap")["map"]
        assert costmap["header"]["frame_id"] == frame
        assert len(costmap["data"]) == costmap["metadata"]["size_x"] * costmap["metadata"]["size_y"]
        assert scope == "local" or {0, 253, 254} <= set(costmap["data"])


def test_load_map(navigation: NavigationProcess, tmp_path: Path) -> None:
    """A map that is twice as wide replaces the present map."""
    call = navigation.client.call
    grid = call("map_server/map", "nav_msgs/srv/GetMap")["map"]
    info = grid["info"]
    cells = np.array(grid["data"], dtype=np.int8).reshape(info["height"], info["width"])
    origin = info["origin"]["position"]["x"], info["origin"]["position"]["y"]
    wide = np.concatenate((cells, np.zeros_like(cells)), axis=1)
    save_map(OccupancyMap(wide, info["resolution"], origin), tmp_path / "wide.yaml")
    save_map(OccupancyMap(cells, info["resolution"], origin), tmp_path / "arena.yaml")
    (tmp_path / "broken.yaml").write_text('image: "none.pgm"\nresolution: 0.05\norigin: [0, 0, 0]\n')
    for url, code in (("", 1), (str(tmp_path / "broken.yaml"), 2), (str(tmp_path / "none.yaml"), 3)):
        assert call("map_server/load_map", "nav2_msgs/srv/LoadMap", map_url=url)["result"] == code
    loaded = call("map_server/load_map", "nav2_msgs/srv/LoadMap", map_url=str(tmp_path / "wide.yaml"))
    assert (loaded["result"], loaded["map"]["info"]["width"]) == (0, 2 * info["width"])
    navigation.wait(lambda: navigation.newest["map"].info.width == 2 * info["width"])
    costmap = call("global_costmap/get_costmap", "nav2_msgs/srv/GetCostmap")["map"]
    assert costmap["metadata"]["size_x"] == 2 * info["width"]
    url = f"file://{tmp_path / 'arena.yaml'}"
    assert call("map_server/load_map", "nav2_msgs/srv/LoadMap", map_url=url)["result"] == 0


def change_state(navigation: NavigationProcess, node: str, number: int) -> bool:
    kind = "lifecycle_msgs/srv/ChangeState"
    response = navigation.client.call(f"{node}/change_state", kind, transition={"id": number})
    return bool(response["success"])


def state(navigation: NavigationProcess, node: str) -> str:
    response = navigation.client.call(f"{node}/get_state", "lifecycle_msgs/srv/GetState")
    return str(response["current_state"]["label"])


def test_lifecycle(navigation: NavigationProcess) -> None:
    """The servers of a node that is not active reject goals."""
    nodes = ["map_server", "amcl", "controller_server", "smoother_server", "planner_server"]
    nodes += ["behavior_server", "bt_navigator", "waypoint_follower"]
    assert {state(navigation, node) for node in nodes} == {"active"}
    wait = {"time": {"sec": 600}}
    number = navigation.send("wait", "Wait", wait)
    navigation.client.wait_until_executing(number)
    assert not change_state(navigation, "behavior_server", Transition.TRANSITION_CLEANUP)
    assert change_state(navigation, "behavior_server", Transition.TRANSITION_DEACTIVATE)
    assert state(navigation, "behavior_server") == "inactive"
    assert navigation.client.result(number)[0] == ABORTED
    navigation.send("wait", "Wait", wait, accepted=False)
    navigation.wait(lambda: "goal of wait rejected: behavior_server is not active" in navigation.text)
    active = ("lifecycle_manager_navigation/is_active", "std_srvs/srv/Trigger")
    assert not navigation.client.call(*active)["success"]
    assert not change_state(navigation, "behavior_server", Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)
    assert change_state(navigation, "behavior_server", Transition.TRANSITION_ACTIVATE)
    assert navigation.client.call(*active)["success"]


def test_lifecycle_manager(navigation: NavigationProcess) -> None:
    kind = "nav2_msgs/srv/ManageLifecycleNodes"

    def manage(command: int, scope: str = "navigation") -> bool:
        name = f"lifecycle_manager_{scope}/manage_nodes"
        return bool(navigation.client.call(name, kind, command=command)["success"])

    request = ManageLifecycleNodes.Request
    assert not manage(request.STARTUP)  # the nodes are active
    goal = {"pose": stamped(0.0, 0.0)}
    for stop, start, then in (("PAUSE", "RESUME", "inactive"), ("RESET", "STARTUP", "unconfigured")):
        assert manage(getattr(request, stop))
        assert {state(navigation, node) for node in ("bt_navigator", "planner_server")} == {then}
        navigation.send("navigate_to_pose", "NavigateToPose", goal, accepted=False)
        assert manage(getattr(request, start))
    # Without localisation the robot has no pose.
    assert manage(request.PAUSE, "localization")
    navigation.newest.pop("odom", None)
    status, result = navigation.client.result(navigation.send("navigate_to_pose", "NavigateToPose", goal))
    assert (status, result["error_code"]) == (ABORTED, Nav2ErrorCode.NAVIGATE_TF_ERROR)
    load = navigation.client.call("map_server/load_map", "nav2_msgs/srv/LoadMap", map_url="map.yaml")
    assert load["result"] == 255
    assert "odom" not in navigation.newest
    assert manage(request.RESUME, "localization")


def test_absent_servers(navigation: NavigationProcess) -> None:
    names = {name for name, _ in navigation.session.node.get_topic_names_and_types()}
    absent = (
        "dock_robot",
        "undock_robot",
        "compute_route",
        "compute_and_track_route",
        "follow_gps_waypoints",
    )
    assert not {f"/{name}/_action/status" for name in absent} & names


def test_default_tree_of_nav2_in_another_process(navigation: NavigationProcess) -> None:
    """Nav2's default tree, with its nodes as clients, reaches its goal through the navigation."""
    tree = subprocess.Popen(
        [
            *(sys.executable, "-c", LONG_TIMEOUTS, "run", "--nav2", "--set", "goal=0.2;-0.2;0.0"),
            *("navigation/navigate_to_pose_w_replanning_and_recovery", "--duration", str(LIMIT_S)),
        ],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "NO_COLOR": "1"},
    )
    navigation.wait(lambda: tree.poll() is not None)
    _, text = tree.communicate()
    assert tree.returncode == 0, text
    assert "SUCCESS" in text
    x, y, _ = navigation.pose()
    assert math.hypot(x - 0.2, y + 0.2) < 0.4


def test_displays_of_rviz(navigation: NavigationProcess) -> None:
    """RViz's default configuration for Nav2 receives what it displays, with the frames of Nav2."""
    pytest.importorskip("map_msgs")
    node, newest = navigation.session.node, dict[str, Any]()
    transforms: dict[str, str] = {"map": ""}

    def keep(topic: str) -> Callable[[Any], None]:
        return lambda message: newest.update({topic: message})

    def keep_transforms(message: Any) -> None:
        transforms.update({each.child_frame_id: each.header.frame_id for each in message.transforms})

    subscriptions = []
    for display in DISPLAYS:
        # RViz receives the description only if it runs first, from robot_state_publisher too.
        qos = display.publisher if display.topic == "robot_description" else display.subscription
        kind = load_interface(display.type, "msg")
        subscriptions.append(
            node.create_subscription(kind, display.topic, keep(display.topic), qos.profile())
        )
    static = Qos("reliable", "latched", 100).profile()
    subscriptions += [
        node.create_subscription(TFMessage, topic, keep_transforms, qos)
        for topic, qos in (("/tf", 100), ("/tf_static", static))
    ]
    x, _, _ = navigation.pose()
    goal = navigation.send("navigate_to_pose", "NavigateToPose", {"pose": stamped(-x, 0.5)})
    topics = {display.topic for display in DISPLAYS}
    navigation.wait(lambda: topics <= newest.keys() and newest["scan"].header.frame_id in transforms)
    navigation.client.cancel(goal)
    navigation.client.result(goal)

    for topic, kind, _, publisher, frame in DISPLAYS:
        [info] = node.get_publishers_info_by_topic(topic)
        assert info.topic_type.replace("/msg/", "/") == kind
        if publisher.reliability != "default":
            expected = publisher.profile()
            assert info.qos_profile.reliability == expected.reliability, topic
            assert info.qos_profile.durability == expected.durability, topic
        if frame != "none":
            header = newest[topic].header
            assert header.frame_id == frame or frame == "any", topic
            assert 0.0 <= time.time() - header.stamp.sec < time.time() - navigation.started + 1.0, topic
            parent = header.frame_id
            while parent:
                parent = transforms[parent]  # each frame is connected with the frame of RViz
    assert "<robot" in newest["robot_description"].data
    assert newest["plan"].poses[-1].pose.position.x == pytest.approx(-x, abs=0.1)
    assert len(newest["particle_cloud"].particles) > 100
    # The footprint surrounds the robot, where its local plan begins.
    start = newest["local_plan"].poses[0].pose.position
    outline = [(point.x, point.y) for point in newest["local_costmap/published_footprint"].polygon.points]
    assert len(outline) == 16
    assert all(math.hypot(x - start.x, y - start.y) < 0.6 for x, y in outline)
    for scope in ("global", "local"):
        grid, update = (newest[f"{scope}_costmap/costmap{part}"] for part in ("", "_updates"))
        assert update.x + update.width <= grid.info.width
        assert update.y + update.height <= grid.info.height
        assert len(update.data) == update.width * update.height > 0
    for subscription in subscriptions:
        node.destroy_subscription(subscription)


def test_goal_pose_and_interrupt(navigation: NavigationProcess) -> None:
    """The last test: Ctrl-C aborts a goal, and its client is notified."""
    publisher = navigation.session.node.create_publisher(PoseStamped, "goal_pose", 1)
    navigation.wait(lambda: publisher.get_subscription_count())
    message = PoseStamped()
    message.header.frame_id = "map"
    before = navigation.newest.pop("plan")
    publisher.publish(message)
    navigation.wait(lambda: "plan" in navigation.newest)
    assert navigation.newest["plan"].poses[-1].pose.position != before.poses[-1].pose.position
    number = navigation.send("wait", "Wait", {"time": {"sec": 600}})
    navigation.client.wait_until_executing(number)
    navigation.end()

    def results() -> list[dict[str, Any]]:
        events = list(navigation.client.events)
        return [event for event in events if event["event"] == "result" and event["goal"] == number]

    assert wait_until(results), navigation.client.events[-5:]
    assert results()[0]["value"]["error_msg"] == "the server was ended"
