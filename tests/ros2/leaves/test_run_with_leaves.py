"""`btcore run` with leaves for ROS 2, on a server in another process."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from planned_server import End, Plan, ServerProcess

from tests.ros2.conftest import LIMIT_S, wait_until

LEAVES = """
from btcore import In
from btcore_ros2.leaves import RosAction


class Send(RosAction):
    action_type = "test_msgs/action/Fibonacci"
    action_name = "plan"
    server_timeout = 60_000
    wait_for_server_timeout = 60_000
    order: In[int]

    def make_goal(self):
        return self.action_type.Goal(order=self.order)
"""


def start(folder: Path, plan: Plan) -> "subprocess.Popen[str]":
    (folder / "leaves.py").write_text(LEAVES)
    (folder / "tree.xml").write_text(
        f'<root BTCPP_format="4"><BehaviorTree ID="T"><Send order="{plan.order}"/></BehaviorTree></root>'
    )
    command = ["run", "tree.xml", "--plugin", "leaves.py", "--ros-args", "-r plan:=planned"]
    return subprocess.Popen(
        [sys.executable, "-m", "btcore", *command],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def test_run_with_a_remapped_name(server: ServerProcess, tmp_path: Path) -> None:
    process = start(tmp_path, Plan(tag=1))
    output, _ = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 0, output
    assert server.of(1) == ["goal", "executing", "succeeded"]


def test_interrupt_cancels_the_goal(server: ServerProcess, tmp_path: Path) -> None:
    process = start(tmp_path, Plan(end=End.NEVER, tag=2))
    assert wait_until(lambda: "executing" in server.of(2) or process.poll() is not None)
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=LIMIT_S)
    assert "Traceback" not in output
    assert wait_until(lambda: "canceled" in server.of(2))
