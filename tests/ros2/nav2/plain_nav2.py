"""A process with plain rclpy servers under Nav2's names, without btcore.

It publishes on the topic `received`, as JSON, what it receives. The names of some servers have a prefix and
behave accordingly: `abort/`, `reject/`, `hang/` (works for 20 s unless the goal is cancelled), `stubborn/`
(works for 20 s and refuses to cancel), and `late/` (answers after 3 s, and then works as `hang/`). With
`--without-navigator` the servers of bt_navigator are missing. The process prints "ready" and ends when its
standard input ends.
"""

import json
import math
import sys
import threading
import time
from typing import Any

import rclpy
from geometry_msgs.msg import PoseStamped, TransformStamped
from nav2_msgs import action, srv
from nav_msgs.msg import Odometry, Path
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import BatteryState
from std_msgs.msg import String
from std_srvs.srv import Empty
from tf2_msgs.msg import TFMessage

ACTIONS = {
    "compute_path_to_pose": action.ComputePathToPose,
    "compute_path_through_poses": action.ComputePathThroughPoses,
    "follow_path": action.FollowPath,
    "smooth_path": action.SmoothPath,
    "spin": action.Spin,
    "backup": action.BackUp,
    "drive_on_heading": action.DriveOnHeading,
    "wait": action.Wait,
    "navigate_to_pose": action.NavigateToPose,
    "navigate_through_poses": action.NavigateThroughPoses,
    "assisted_teleop": action.AssistedTeleop,
    "abort/assisted_teleop": action.AssistedTeleop,
    "abort/spin": action.Spin,
    "reject/spin": action.Spin,
    "hang/spin": action.Spin,
    "stubborn/spin": action.Spin,
    "late/spin": action.Spin,
    "hang/follow_path": action.FollowPath,
    "abort/follow_path": action.FollowPath,
    "abort/compute_path_to_pose": action.ComputePathToPose,
}
SERVICES = {
    "local_costmap/clear_entirely_local_costmap": srv.ClearEntireCostmap,
    "local_costmap/clear_around_local_costmap": srv.ClearCostmapAroundRobot,
    "local_costmap/clear_except_local_costmap": srv.ClearCostmapExceptRegion,
    "global_costmap/get_cost_global_costmap": srv.GetCosts,
    "is_path_valid": srv.IsPathValid,
    "reinitialize_global_localization": Empty,
    "late/clear": srv.ClearEntireCostmap,
}
ANSWER_DELAY_S = 3.0  # of `late/`
WORK_S = 0.1
LONG_WORK_S = 20.0  # of `hang/`, `stubborn/` and `late/`
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def to_data(value: Any) -> Any:
    """Return a message as JSON data."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: to_data(getattr(value, name)) for name in value.get_fields_and_field_types()}
    return value if isinstance(value, str | bool | int | float) else [to_data(item) for item in value]


class PlainNav2(Node):
    """Servers, services and topics of Nav2."""

    def __init__(self) -> None:
        super().__init__("plain_nav2")
        group = ReentrantCallbackGroup()
        self.received = self.create_publisher(String, "received", 100)
        self.servers = [
            ActionServer(
                self,
                kind,
                name,
                lambda goal, name=name, kind=kind: self.execute(name, kind, goal),
                goal_callback=lambda goal, name=name: self.accept(name, goal),
                cancel_callback=lambda goal, name=name: self.cancel(name),
                callback_group=group,
            )
            for name, kind in ACTIONS.items()
            if not (name.startswith("navigate_") and "--without-navigator" in sys.argv)
        ]
        for name, kind in SERVICES.items():
            answer = lambda request, response, name=name: self.answer(name, request, response)  # noqa: E731
            self.create_service(kind, name, answer, callback_group=group)
        self.create_subscription(String, "mark", lambda message: self.report("mark", message.data), 10)
        self.create_publisher(String, "planner_selector", LATCHED).publish(String(data="Lattice"))
        self.goal_update = self.create_publisher(PoseStamped, "goal_update", 1)
        self.tf = self.create_publisher(TFMessage, "/tf", 100)
        self.odom = self.create_publisher(Odometry, "odom", 10)
        self.battery = self.create_publisher(BatteryState, "/battery_status", 10)
        self.create_timer(0.05, self.publish)

    def report(self, name: str, message: object) -> None:
        """Publish that *name* has received *message*."""
        self.received.publish(String(data=json.dumps([name, to_data(message)])))

    def publish(self) -> None:
        """Publish the pose (1, 2, π/2) in two steps, odometry, the battery, and a moved goal."""
        now = self.get_clock().now().to_msg()
        frames = []
        for parent, child, x in (("map", "odom", 1.0), ("odom", "base_link", 0.0)):
            frame = TransformStamped()
            frame.header.frame_id, frame.header.stamp, frame.child_frame_id = parent, now, child
            frame.transform.translation.x = x
            frame.transform.translation.y = 2.0 * x
            frame.transform.rotation.z = math.sin(math.pi / 4) if x else 0.0
            frame.transform.rotation.w = math.cos(math.pi / 4) if x else 1.0
            frames.append(frame)
        self.tf.publish(TFMessage(transforms=frames))
        odometry = Odometry()
        odometry.header.stamp = now
        odometry.twist.twist.linear.x = 0.5
        self.odom.publish(odometry)
        charging = BatteryState.POWER_SUPPLY_STATUS_CHARGING
        self.battery.publish(BatteryState(percentage=0.25, voltage=24.0, power_supply_status=charging))
        goal = PoseStamped()
        goal.header.frame_id = "map"
        goal.pose.position.x = 7.0
        goal.pose.orientation.w = 1.0
        self.goal_update.publish(goal)

    def accept(self, name: str, goal: object) -> GoalResponse:
        """Answer a goal."""
        self.report(name, goal)
        if name.startswith("late/"):
            time.sleep(ANSWER_DELAY_S)
        return GoalResponse.REJECT if name.startswith("reject/") else GoalResponse.ACCEPT

    def cancel(self, name: str) -> CancelResponse:
        """Answer a cancellation."""
        self.report(f"{name} cancel", "")
        return CancelResponse.REJECT if name.startswith("stubborn/") else CancelResponse.ACCEPT

    def execute(self, name: str, kind: Any, goal: Any) -> Any:
        """Work on a goal until its time has passed, or until it is cancelled."""
        is_long = name.startswith(("hang/", "stubborn/", "late/"))
        end = time.monotonic() + (LONG_WORK_S if is_long else WORK_S)
        result = kind.Result()
        while time.monotonic() < end:
            if goal.is_cancel_requested:
                self.report(f"{name} canceled", "")
                goal.canceled()
                return result
            feedback = kind.Feedback()
            if kind is action.FollowPath:
                feedback.distance_to_goal, feedback.speed = 1.5, 0.25
            goal.publish_feedback(feedback)
            time.sleep(0.02)
        if name.startswith("abort/"):
            result.error_code, result.error_msg = kind.Result.TF_ERROR, "no transform"
            goal.abort()
            return result
        if hasattr(result, "path"):
            result.path = self.path(goal.request)
        if kind is action.SmoothPath:
            result.was_completed = True
        goal.succeed()
        return result

    def path(self, request: Any) -> Path:
        """Return a path from the origin to the goal of a planner, or the path of a smoother."""
        if hasattr(request, "path"):
            return request.path
        path = Path()
        path.header.frame_id = "map"
        path.header.stamp = self.get_clock().now().to_msg()
        goals = request.goals.goals if hasattr(request, "goals") else [request.goal]
        start = PoseStamped()
        start.header.frame_id = "map"
        path.poses = [start, *goals]
        return path

    def answer(self, name: str, request: Any, response: Any) -> Any:
        """Answer a request: the second pose of a path is invalid, and costs are 0, 1, 254, 3 …"""
        self.report(name, request)
        if name.startswith("late/"):
            time.sleep(ANSWER_DELAY_S)
        if name == "is_path_valid":
            response.is_valid = len(request.path.poses) < 3
            response.invalid_pose_indices = [] if response.is_valid else [1]
        elif name.endswith("get_cost_global_costmap"):
            response.costs = [254.0 if index == 2 else float(index) for index in range(len(request.poses))]
            response.success = bool(request.poses)
        return response


def main() -> None:
    """Serve until the standard input ends."""
    rclpy.init()
    executor = MultiThreadedExecutor(num_threads=6)
    executor.add_node(PlainNav2())
    threading.Thread(target=executor.spin, daemon=True).start()
    print("ready", flush=True)
    sys.stdin.read()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
