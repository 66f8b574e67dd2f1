"""A plain rclpy program that prints what it receives as lines of JSON, for tests of telemetry.

It prints {"ready": true} when it has subscribed, and ends when its standard input is closed.
"""

import json
import sys
import threading

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log
from rclpy.executors import SingleThreadedExecutor


def show(**data: object) -> None:
    """Print *data*."""
    print(json.dumps(data), flush=True)


def show_diagnostics(array: DiagnosticArray) -> None:
    """Print a message of /diagnostics."""
    (status,) = array.status
    values = {value.key: value.value for value in status.values}
    show(diagnostics=status.name, level=status.level[0], message=status.message, values=values)


def show_log(log: object) -> None:
    """Print a message of /behavior_tree_log."""
    events = [
        [
            event.node_name,
            event.uid,
            event.previous_status,
            event.current_status,
            event.timestamp.sec + event.timestamp.nanosec / 1e9,
        ]
        for event in log.event_log
    ]
    show(events=events, sent=log.timestamp.sec + log.timestamp.nanosec / 1e9)


rclpy.init()
node = rclpy.create_node("watcher")
node.create_subscription(DiagnosticArray, "diagnostics", show_diagnostics, 10)
node.create_subscription(
    Log, "/rosout", lambda log: show(rosout=log.msg, level=log.level, name=log.name), 1000
)
try:
    from nav2_msgs.msg import BehaviorTreeLog
except ModuleNotFoundError:
    pass
else:
    node.create_subscription(BehaviorTreeLog, "behavior_tree_log", show_log, 100)
executor = SingleThreadedExecutor()
executor.add_node(node)
spinning = threading.Thread(target=executor.spin)
spinning.start()
show(ready=True)
sys.stdin.read()
executor.shutdown()
spinning.join()
rclpy.shutdown()
