"""A plain rclpy server whose behavior is part of each goal, for tests of clients.

`python planned_server.py` offers the action `planned` (test_msgs/action/Fibonacci) and the service
`planned_service` (test_msgs/srv/BasicTypes). For each event it prints a line with the tag of the goal and
the event.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import astuple, dataclass, fields
from enum import IntEnum
from subprocess import PIPE, Popen
from typing import Any, Self

SLOT_MS = 20


class Answer(IntEnum):
    """What the server does with a goal request."""

    ACCEPT = 0
    REJECT = 1
    DIE = 2


class End(IntEnum):
    """How the server ends an accepted goal that is not cancelled."""

    SUCCEED = 0
    ABORT = 1
    CANCEL = 2  # cancelled by a second client
    DIE = 3
    NEVER = 4


class Cancel(IntEnum):
    """What the server does with a cancel request."""

    ACCEPT = 0
    REFUSE = 1
    ACCEPT_LATE = 2
    SUCCEED = 3  # accept the request, but finish the goal


BITS = (2, 7, 3, 5, 3, 2, 9)


@dataclass(frozen=True)
class Plan:
    """The behavior of the server for one goal, which fits into an int32."""

    answer: int = Answer.ACCEPT
    answer_slots: int = 0  # the time before the answer
    end: int = End.SUCCEED
    work_slots: int = 1
    feedback: int = 0
    cancel: int = Cancel.ACCEPT
    tag: int = 0

    @property
    def order(self) -> int:
        """The goal's field `order`."""
        number, shift = 0, 0
        for value, bits in zip(astuple(self), BITS, strict=True):
            assert 0 <= value < 1 << bits
            number |= value << shift
            shift += bits
        return number

    @classmethod
    def of(cls, order: int) -> Self:
        """Return the plan of a goal."""
        values = []
        for bits in BITS:
            values.append(order & ((1 << bits) - 1))
            order >>= bits
        return cls(**dict(zip((field.name for field in fields(cls)), values, strict=True)))


def main() -> None:
    """Serve until SIGTERM."""
    import rclpy
    from action_msgs.srv import CancelGoal
    from rclpy.action import ActionServer, CancelResponse, GoalResponse
    from rclpy.callback_groups import ReentrantCallbackGroup
    from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
    from rclpy.impl.implementation_singleton import rclpy_implementation
    from test_msgs.action import Fibonacci
    from test_msgs.srv import BasicTypes

    rclpy.init()
    node = rclpy.create_node("planned_server")
    group = ReentrantCallbackGroup()
    canceller = node.create_client(CancelGoal, "planned/_action/cancel_goal", callback_group=group)

    def report(tag: int, event: str) -> None:
        os.write(1, f"{tag} {event}\n".encode())  # at once, because several threads report

    def die() -> None:
        os.kill(os.getpid(), signal.SIGKILL)

    def answer(goal: Any) -> Any:
        plan = Plan.of(goal.order)
        report(plan.tag, "goal")
        time.sleep(plan.answer_slots * SLOT_MS / 1000)
        if plan.answer == Answer.DIE:
            die()
        return GoalResponse.REJECT if plan.answer == Answer.REJECT else GoalResponse.ACCEPT

    def answer_cancel(handle: Any) -> Any:
        plan = Plan.of(handle.request.order)
        report(plan.tag, "cancel")
        if plan.cancel == Cancel.ACCEPT_LATE:
            time.sleep(0.3)
        return CancelResponse.REJECT if plan.cancel == Cancel.REFUSE else CancelResponse.ACCEPT

    def execute(handle: Any) -> Any:
        plan = Plan.of(handle.request.order)
        report(plan.tag, "executing")
        feedback_slots = {(n + 1) * plan.work_slots // (plan.feedback + 1): n for n in range(plan.feedback)}
        slot = 0
        while rclpy.ok() and (slot < plan.work_slots or plan.end in (End.NEVER, End.CANCEL)):
            if slot in feedback_slots:
                handle.publish_feedback(Fibonacci.Feedback(sequence=[feedback_slots[slot]]))
            if slot == plan.work_slots and plan.end == End.CANCEL:
                request = CancelGoal.Request()
                request.goal_info.goal_id = handle.goal_id
                canceller.call_async(request)
            time.sleep(SLOT_MS / 1000)
            slot += 1
            if handle.is_cancel_requested and plan.cancel != Cancel.SUCCEED:
                report(plan.tag, "canceled")
                handle.canceled()
                return Fibonacci.Result()
            if plan.end == End.CANCEL and plan.cancel == Cancel.SUCCEED and handle.is_cancel_requested:
                break
        if not rclpy.ok():
            return Fibonacci.Result()
        if plan.end == End.DIE:
            die()
        if plan.end == End.ABORT:
            report(plan.tag, "aborted")
            handle.abort()
        else:
            report(plan.tag, "succeeded")
            handle.succeed()
        return Fibonacci.Result(sequence=[plan.tag])

    def serve(request: Any, response: Any) -> Any:
        report(request.int32_value, "request")
        time.sleep(request.uint16_value / 1000)
        response.int32_value = request.int32_value + 1
        return response

    server = ActionServer(
        node,
        Fibonacci,
        "planned",
        execute,
        callback_group=group,
        goal_callback=answer,
        cancel_callback=answer_cancel,
    )
    node.create_service(BasicTypes, "planned_service", serve, callback_group=group)
    executor = MultiThreadedExecutor(num_threads=24)
    executor.add_node(node)
    report(0, "ready")
    with suppress(KeyboardInterrupt, ExternalShutdownException, rclpy_implementation.RCLError):
        executor.spin()  # the shutdown of the context may raise in any of its threads
    executor.shutdown()  # waits for the threads that work on goals
    server.destroy()
    node.destroy_node()


class ServerProcess:
    """The server in a process of its own.

    Attributes:
        events: The pairs of tag and event that the server reported.
    """

    def __init__(self, namespace: str = "") -> None:
        self.events: list[tuple[int, str]] = []
        self._command = [sys.executable, __file__]
        if namespace:
            self._command += ["--ros-args", "-r", f"__ns:={namespace}"]
        self.start()

    def start(self) -> None:
        """Start the process, and wait until it is ready."""
        self.process = Popen(self._command, stdout=PIPE, text=True)
        ready = threading.Event()
        self.reader = threading.Thread(target=self._read, args=(self.process, ready), daemon=True)
        self.reader.start()
        assert ready.wait(60), "the server does not start"

    def _read(self, process: "Popen[str]", ready: threading.Event) -> None:
        assert process.stdout is not None
        with process.stdout:
            for line in process.stdout:
                tag, event = line.split()
                self.events.append((int(tag), event))
                if event == "ready":
                    ready.set()

    def of(self, tag: int) -> list[str]:
        """Return the events of the goal with *tag*, or of the request."""
        return [event for number, event in list(self.events) if number == tag]

    def kill(self) -> None:
        """End the process by SIGKILL."""
        self.process.kill()
        self.process.wait()
        self.reader.join()

    def terminate(self) -> None:
        """End the process by SIGTERM, which is a clean shutdown."""
        self.process.terminate()
        self.process.wait(60)
        self.reader.join()


@contextmanager
def start_planned_server(namespace: str = "") -> Iterator[ServerProcess]:
    """Start the server in *namespace*, such as `/robot`, and end it at the end of the context."""
    server = ServerProcess(namespace)
    try:
        yield server
    finally:
        server.kill()


if __name__ == "__main__":
    main()
