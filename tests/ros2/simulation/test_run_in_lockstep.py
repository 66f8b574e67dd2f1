"""`btcore run --ros2 tiago --lockstep` drives the simulated robot of another process."""

import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

pytest.importorskip("rclpy")
pytest.importorskip("pybullet")

from btcore.cli.main import main
from btcore_robot.occupancy_map import save_map
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.worlds import load_world_description
from tests.ros2.conftest import LIMIT_S
from tests.ros2.simulation.process import SimProcess


def run(*arguments: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "btcore", "run", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=2 * LIMIT_S, check=False)


def test_a_tree_drives_the_robot(start: Callable[..., SimProcess]) -> None:
    """tests/acceptance/ros2_runs.py checks that such a run is repeatable."""
    simulation = start("--world", "arena", "--camera", "64x48@5", "--lockstep", "--seed", "7")
    simulation.wait_until_ready()
    ended = run("bumpgo", "--ros2", "tiago", "--lockstep", "--duration", "6", "--json")
    assert ended.returncode == 0, ended.stderr
    assert simulation.interrupt() == 130
    result = simulation.result()
    assert result["robot"]["distance_m"] > 1.0
    assert result["robot"]["collisions"] == 0
    assert result["time_s"] == 6.0


def test_lockstep_without_ros_has_no_effect() -> None:
    ended = CliRunner().invoke(main, ["run", "bumpgo", "--lockstep", "--fast", "--duration", "1"])
    assert ended.exit_code == 0
    assert "warning: --lockstep has no effect" in " ".join(ended.output.split())


ROUND = """<root BTCPP_format="4"><BehaviorTree ID="Round"><Sequence>
  <GetWaypoint waypoint="{wp}"/> <Move goal="{wp}"/>
</Sequence></BehaviorTree></root>"""


def test_patrol_drives_to_waypoint_beside_map(start: Callable[..., SimProcess], tmp_path: Path) -> None:
    simulation = start("--world", "house", "--camera", "off", "--lockstep")
    simulation.wait_until_ready()
    save_map(rasterise(load_world_description("house")), tmp_path / "house.yaml")
    (tmp_path / "house.waypoints.yaml").write_text("waypoints: {wp1: [0.6, 0.5, 1.57]}")
    (tmp_path / "round.xml").write_text(ROUND)
    options = ("--ros2", "tiago", "--lockstep", "--map", str(tmp_path / "house.yaml"))
    ended = run(str(tmp_path / "round.xml"), *options, "--duration", "20")
    assert ended.returncode == 0, ended.stderr
    simulation.interrupt()
    robot = simulation.result()["robot"]
    assert math.dist((robot["pose"]["x"], robot["pose"]["y"]), (0.6, 0.5)) < 0.3
    assert robot["collisions"] == 0
