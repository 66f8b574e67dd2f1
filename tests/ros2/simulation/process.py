"""The simulated robot in a process of its own, and a ROS node that talks to it."""

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from tests.ros2.conftest import LIMIT_S, wait_until


class SimProcess:
    """`btcore ros2 sim` in another process, whose output goes to files in *folder*."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self._out, self._err = folder / "out", folder / "err"
        command = [sys.executable, "-m", "btcore", "ros2", "sim", "--json", *arguments]
        with self._out.open("w") as out, self._err.open("w") as err:
            self.process = subprocess.Popen(command, stdout=out, stderr=err)

    def wait_until_ready(self) -> None:
        """Wait until the robot is on ROS 2."""
        assert wait_until(lambda: "is on ROS 2" in self.errors or self.process.poll() is not None)
        assert self.process.poll() is None, self.errors

    @property
    def errors(self) -> str:
        """The output on stderr so far."""
        return self._err.read_text()

    def interrupt(self) -> int:
        """End the process like Ctrl-C, and return its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        try:
            return self.process.wait(LIMIT_S)
        finally:
            self.process.kill()

    def result(self) -> dict[str, Any]:
        """The JSON object that the process has printed at its end."""
        found: dict[str, Any] = json.loads(self._out.read_text().splitlines()[-1])
        return found


class Client:
    """A ROS node beside the simulated robot."""

    def __init__(self, session: Any) -> None:
        self.session = session
        self.node = session.node

    def messages(self, kind: type, topic: str, qos: Any = 10) -> list[Any]:
        """Return a list to which all messages on *topic* are appended."""
        received: list[Any] = []
        self.node.create_subscription(kind, topic, received.append, qos)
        return received

    def wait(self, condition: Callable[[], Any]) -> None:
        """Wait until *condition* returns a true value."""
        assert self.session.wait_for(condition, LIMIT_S)

    def call(self, kind: type, name: str, request: Any = None) -> Any:
        """Call a service and return its response.

        A response is lost if the server does not know the new client yet, so that the request is repeated.
        """
        client = self.node.create_client(kind, name)
        self.wait(client.service_is_ready)
        for _ in range(10):
            future = client.call_async(kind.Request() if request is None else request)
            if self.session.wait_for(future.done, LIMIT_S / 10):
                break
            client.remove_pending_request(future)
        self.node.destroy_client(client)
        assert future.done(), f"no response of {name}"
        return future.result()

    def publish_until(self, commands: Sequence[tuple[Any, Any]], condition: Callable[[], Any]) -> None:
        """Publish each message of *commands*, pairs of publisher and message, until *condition* is met."""

        def done() -> Any:
            for publisher, message in commands:
                publisher.publish(message)
            return condition()

        self.wait(done)
