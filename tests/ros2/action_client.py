"""A plain rclpy client of actions and services in another process, for tests of servers.

The process gets a request per line, and prints an event per line, both as JSON.
"""

import importlib
import json
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import Any

CLIENT_LIMIT_S = 120.0  # not from conftest: the client process cannot import `tests`


class ClientProcess:
    """The client process. Goals are numbered in the order in which they are sent."""

    def __init__(self, wait: Callable[[Callable[[], Any]], object]) -> None:
        """Start the process.

        *wait* waits until a condition is met; a server in the process of the test has to drain meanwhile.
        """
        self.wait = wait
        self.events: list[dict[str, Any]] = []
        self.sent = 0
        self.process = subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.reader = threading.Thread(target=self._read)
        self.reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        with self.process.stdout as lines:
            for line in lines:
                self.events.append(json.loads(line))

    def request(self, **fields: Any) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(fields) + "\n")
        self.process.stdin.flush()

    def send(self, action: str, kind: str, goal: dict[str, Any], *, accepted: bool = True) -> int:
        """Send a goal, wait for its acceptance or rejection, and return its number."""
        self.request(do="send", action=action, kind=kind, goal=goal)
        number = self.sent
        self.sent += 1
        assert self.event("accepted", number)["value"] is accepted
        return number

    def wait_until_executing(self, number: int) -> None:
        """Wait until the server has begun to work on a goal."""
        self.event("executing", number)

    def cancel(self, number: int) -> int:
        """Cancel a goal, and return the number of goals that the server is cancelling."""
        self.request(do="cancel", goal=number)
        canceling: int = self.event("canceling", number)["value"]
        return canceling

    def result(self, number: int) -> tuple[int, dict[str, Any]]:
        """Wait for the end of a goal, and return its status and the result message."""
        event = self.event("result", number)
        return event["status"], event["value"]

    def feedback(self, number: int) -> list[dict[str, Any]]:
        """Return the feedback that has arrived for a goal."""
        return [
            event["value"]
            for event in list(self.events)
            if event["goal"] == number and event["event"] == "feedback"
        ]

    def call(self, service: str, kind: str, **fields: Any) -> dict[str, Any]:
        """Call a service, and return its response."""
        number = -1 - sum(event["event"] == "response" for event in self.events)
        self.request(do="call", service=service, kind=kind, fields=fields, goal=number)
        response: dict[str, Any] = self.event("response", number)["value"]
        return response

    def event(self, name: str, number: int) -> dict[str, Any]:
        """Wait for an event of a goal."""

        def find() -> dict[str, Any] | None:
            found = (
                event for event in list(self.events) if (event["event"], event["goal"]) == (name, number)
            )
            return next(found, None)

        self.wait(lambda: find() or self.process.poll() is not None)
        event = find()
        assert event is not None, f"no event '{name}' of goal {number} in {self.events[-20:]}"
        return event

    def close(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait(CLIENT_LIMIT_S)
        self.reader.join()
        assert self.process.returncode == 0


def find_type(name: str) -> Any:
    """Return the class of a type such as `nav2_msgs/action/Spin`; in fields the middle part is missing."""
    package, *middle, kind = name.split("/")
    return getattr(importlib.import_module(".".join([package, *(middle or ["msg"])])), kind)


def set_fields(message: Any, fields: dict[str, Any]) -> None:
    types = message.get_fields_and_field_types()
    for name, value in fields.items():
        if isinstance(value, dict):
            set_fields(getattr(message, name), value)
            continue
        if isinstance(value, list) and value and isinstance(value[0], dict):
            item = find_type(types[name].removeprefix("sequence<").rstrip(">"))
            items = [item() for _ in value]
            for part, given in zip(items, value, strict=True):
                set_fields(part, given)
            value = items
        setattr(message, name, value)


def as_dict(value: Any) -> Any:
    if hasattr(value, "get_fields_and_field_types"):
        return {name: as_dict(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, (str, int, float)):
        return value
    return [as_dict(item) for item in value]


def main() -> None:
    import queue

    import rclpy
    from action_msgs.msg import GoalStatus, GoalStatusArray
    from action_msgs.srv import CancelGoal
    from rclpy.action import ActionClient
    from rclpy.qos import qos_profile_action_status_default

    rclpy.init()
    node = rclpy.create_node("client")
    clients: dict[str, Any] = {}
    handles: dict[int, Any] = {}
    # rclpy's handles miss a status that arrives before the acceptance of the goal.
    statuses: dict[bytes, int] = {}
    executing: set[int] = set()
    requests: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def read() -> None:
        for line in sys.stdin:
            requests.put(json.loads(line))
        requests.put(None)

    def report(event: str, goal: int, value: Any, **more: Any) -> None:
        print(json.dumps({"event": event, "goal": goal, "value": value, **more}), flush=True)

    def answer_of(client: Any, message: Any) -> Any:
        for _ in range(20):
            future = client.call_async(message)
            rclpy.spin_until_future_complete(node, future, timeout_sec=CLIENT_LIMIT_S / 20)
            if future.done():
                return future
            client.remove_pending_request(future)
        return None

    def wait_until_known(action: str) -> None:
        # As tests/ros2/discovery.py, which this process cannot import: a response to a client that the
        # server does not know yet is lost. The server knows the clients before this one if it responds.
        client = node.create_client(CancelGoal, f"{action}/_action/cancel_goal")
        no_goal = CancelGoal.Request()
        no_goal.goal_info.goal_id.uuid[0] = 1
        assert client.wait_for_service(CLIENT_LIMIT_S), action
        assert answer_of(client, no_goal) is not None, action
        node.destroy_client(client)

    def take_statuses(message: Any) -> None:
        for goal in message.status_list:
            statuses[bytes(goal.goal_info.goal_id.uuid)] = goal.status

    def send(request: dict[str, Any], number: int) -> None:
        kind = find_type(request["kind"])
        client = clients.get(request["action"])
        if client is None:
            client = clients[request["action"]] = ActionClient(node, kind, request["action"])
            assert client.wait_for_server(CLIENT_LIMIT_S), request["action"]
            wait_until_known(request["action"])
            topic = f"{request['action']}/_action/status"
            node.create_subscription(GoalStatusArray, topic, take_statuses, qos_profile_action_status_default)
        goal = kind.Goal()
        set_fields(goal, request["goal"])

        def answered(future: Any) -> None:
            handle = handles[number] = future.result()
            if handle.accepted:
                handle.get_result_async().add_done_callback(ended)
            report("accepted", number, handle.accepted)

        def ended(future: Any) -> None:
            answer = future.result()
            report("result", number, as_dict(answer.result), status=answer.status)

        def progressed(message: Any) -> None:
            report("feedback", number, as_dict(message.feedback))

        client.send_goal_async(goal, progressed).add_done_callback(answered)

    def call(request: dict[str, Any]) -> None:
        kind = find_type(request["kind"])
        client = clients.get(request["service"])
        if client is None:
            client = clients[request["service"]] = node.create_client(kind, request["service"])
            assert client.wait_for_service(CLIENT_LIMIT_S), request["service"]
        message = kind.Request()
        set_fields(message, request["fields"])
        future = answer_of(client, message)
        assert future is not None, request["service"]
        report("response", request["goal"], as_dict(future.result()))

    threading.Thread(target=read, daemon=True).start()
    count = 0
    while True:
        while not requests.empty():
            request = requests.get()
            if request is None:
                rclpy.shutdown()
                return
            if request["do"] == "send":
                send(request, count)
                count += 1
            elif request["do"] == "call":
                call(request)
            else:
                number = request["goal"]
                handles[number].cancel_goal_async().add_done_callback(
                    lambda future, number=number: report(
                        "canceling", number, len(future.result().goals_canceling)
                    )
                )
        rclpy.spin_once(node, timeout_sec=0.01)
        for number, handle in handles.items():
            status = statuses.get(bytes(handle.goal_id.uuid))
            if status == GoalStatus.STATUS_EXECUTING and number not in executing:
                executing.add(number)
                report("executing", number, True)


if __name__ == "__main__":
    main()
