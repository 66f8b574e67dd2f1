"""A plain rclpy program for leaves that need no code: an action, a service, topics and a lifecycle node.

It prints "ready" when everything is offered, and ends when its standard input is closed.
"""

import sys
import threading

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.action import ActionServer
from rclpy.executors import MultiThreadedExecutor
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import BatteryState
from std_msgs.msg import String
from std_srvs.srv import SetBool
from test_msgs.action import Fibonacci


def count(goal: object) -> Fibonacci.Result:
    """Succeed with the numbers below `order`, or abort a goal with a negative `order`."""
    order = goal.request.order
    goal.publish_feedback(Fibonacci.Feedback(sequence=[order]))
    if order < 0:
        goal.abort()
        return Fibonacci.Result(sequence=[-1])
    goal.succeed()
    return Fibonacci.Result(sequence=list(range(order)))


def switch(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
    """Succeed only for `data: true`."""
    response.success = request.data
    response.message = "on" if request.data else "cannot be switched off"
    return response


rclpy.init()
node = rclpy.create_node("plain_server")
server = ActionServer(node, Fibonacci, "count", count)
node.create_service(SetBool, "switch", switch)
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
node.create_publisher(String, "place", latched).publish(String(data="kitchen"))
node.create_publisher(String, "silence", 1)
node.create_publisher(BatteryState, "other_battery", 1)
battery = node.create_publisher(BatteryState, "battery", qos_profile_sensor_data)
node.create_timer(0.05, lambda: battery.publish(BatteryState(percentage=0.75)))
heard = node.create_publisher(String, "heard", latched)
node.create_subscription(String, "words", heard.publish, 10)
executor = MultiThreadedExecutor(4)
executor.add_node(node)
driver = LifecycleNode("driver")
driver.declare_parameter("max_speed", 0.5)
driver.add_on_set_parameters_callback(
    lambda changes: SetParametersResult(successful=changes[0].value < 1.0, reason="max_speed is below 1.0")
)
executor.add_node(driver)
spinning = threading.Thread(target=executor.spin)
spinning.start()
print("ready", flush=True)
sys.stdin.read()
executor.shutdown()
spinning.join()
rclpy.shutdown()
