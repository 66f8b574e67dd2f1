"""`btcore run --nav2` runs Nav2's nodes and `Move` on the servers of another process."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.ros2.conftest import LIMIT_S

pytest.importorskip("rclpy")
pytest.importorskip("nav2_msgs")


NAVIGATE = """
<root BTCPP_format="4">
  <BehaviorTree ID="T">
    <Sequence>
      <ComputePathToPose goal="2;0" path="{path}" planner_id="Lattice" server_timeout="60000"/>
      <FollowPath path="{path}" server_timeout="60000"/>
      <Wait wait_duration="1" server_timeout="60000"/>
    </Sequence>
  </BehaviorTree>
</root>
"""


def run(folder: Path, text: str, *options: str) -> subprocess.CompletedProcess[str]:
    file = folder / "tree.xml"
    file.write_text(text)
    command = [sys.executable, "-m", "btcore", "run", str(file), *options]
    return subprocess.run(command, capture_output=True, text=True, timeout=2 * LIMIT_S, check=False)


def test_the_tree_uses_the_servers_of_nav2(rig: Any, tmp_path: Path) -> None:
    done = run(tmp_path, NAVIGATE, "--nav2")
    if "did not answer the goal in time" in done.stderr:
        # A server whose client was discovered a moment ago may lose its response, with a warning of rclpy.
        rig.received.clear()
        done = run(tmp_path, NAVIGATE, "--nav2")
    assert done.returncode == 0, done.stderr
    assert rig.session.wait_for(lambda: "wait" in rig.names(), LIMIT_S)
    assert rig.names() == ["compute_path_to_pose", "follow_path", "wait"]
    assert rig.received[0][1]["planner_id"] == "Lattice"


def test_a_failure_names_the_server_and_the_reason(rig: Any, tmp_path: Path) -> None:
    leaf = '<Spin server_name="abort/spin" server_timeout="60000"/>'
    text = f'<root BTCPP_format="4"><BehaviorTree ID="T">{leaf}</BehaviorTree></root>'
    done = run(tmp_path, text, "--nav2")
    assert done.returncode == 1
    assert "no transform" in done.stderr
    assert "Traceback" not in done.stderr
