"""A process with an ordinary rclpy ROS node whose types and QoS exclude those of the tests.

It prints "ready" and ends when its standard input ends.
"""

import sys
import threading

import rclpy
from rclpy.action import ActionServer
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger
from test_msgs.action import NestedMessage


def main() -> None:
    """Offer topics, a service and an action until the standard input ends."""
    rclpy.init()
    node = Node("peer", namespace="/robot1")
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_publisher(Float64, "/number", 10)
    node.create_publisher(String, "/unreliable", best_effort)
    node.create_subscription(Float64, "/wanted_number", lambda message: None, 10)
    node.create_subscription(String, "/wanted_latched", lambda message: None, latched)
    node.create_service(Trigger, "/switch", lambda request, response: response)
    ActionServer(node, NestedMessage, "/count", lambda goal: NestedMessage.Result())
    threading.Thread(target=rclpy.spin, args=[node], daemon=True).start()
    print("ready", flush=True)
    sys.stdin.read()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
