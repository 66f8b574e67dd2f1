"""A process with an ordinary rclpy ROS node: topics, services and an action, without btcore.

It prints "ready" and ends when its standard input ends.
"""

import sys
import threading
import time
from typing import Any

import rclpy
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import SetBool
from test_msgs.action import Fibonacci


class PlainServer(Node):
    """A service, an action and a topic that is repeated."""

    def __init__(self) -> None:
        super().__init__("plain_server")
        group = ReentrantCallbackGroup()
        self.create_service(SetBool, "set_bool", self.set_bool, callback_group=group)
        self.echo = self.create_publisher(String, "echo", 100)
        self.create_subscription(String, "words", self.echo.publish, 100)  # one at a time: in order
        self.server = ActionServer(
            self,
            Fibonacci,
            "fibonacci",
            self.execute,
            goal_callback=lambda goal: GoalResponse.REJECT if goal.order < 0 else GoalResponse.ACCEPT,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
            callback_group=group,
        )

    def set_bool(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Return the data of the request."""
        response.success = request.data
        response.message = "set" if request.data else "reset"
        return response

    def execute(self, goal: Any) -> Fibonacci.Result:
        """Send the sequence, a number with each feedback; an order above 99 lasts until it is cancelled."""
        sequence = [0, 1]
        for _ in range(goal.request.order):
            if goal.is_cancel_requested:
                goal.canceled()
                return Fibonacci.Result(sequence=sequence)
            if goal.request.order < 100:
                sequence.append(sequence[-1] + sequence[-2])
            goal.publish_feedback(Fibonacci.Feedback(sequence=sequence))
            time.sleep(0.03)
        goal.succeed()
        return Fibonacci.Result(sequence=sequence)


def main() -> None:
    """Serve until the standard input ends."""
    rclpy.init()
    executor = MultiThreadedExecutor(num_threads=4)
    executor.add_node(PlainServer())
    threading.Thread(target=executor.spin, daemon=True).start()
    print("ready", flush=True)
    sys.stdin.read()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
