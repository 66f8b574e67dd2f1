"""Navigation from the command line: reproducible by seed, with clear errors, and back at the charger."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

pytest.importorskip("pybullet")

from btcore.cli.main import main
from btcore_robot.occupancy_map import OccupancyMap, save_map

ROOT = Path(__file__).parents[3]


def room(floor: int, wall: int, origin: tuple[float, float] = (-1.0, -1.0)) -> OccupancyMap:
    cells = np.full((40, 40), floor, dtype=np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = wall
    return OccupancyMap(cells, 0.05, origin)


QUICKLY = ("--camera", "off", "--fast", "--json")


def run(*arguments: str) -> Result:
    done = CliRunner().invoke(main, ["run", *arguments, *QUICKLY], prog_name="btcore")
    assert "Traceback" not in done.stderr
    assert "internal error" not in done.stderr
    return done


def test_the_same_seed_gives_the_same_bytes_in_two_processes() -> None:
    arguments = ("patrolling", "--world", "aws_house", "--duration", "6", "--seed", "3")
    command = [sys.executable, "-m", "btcore", "run", *arguments, *QUICKLY]
    outputs = [
        subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=True).stdout,
        run(*arguments).stdout,
    ]
    first, second = ({**json.loads(text), "real_time_factor": 0.0} for text in outputs)
    assert first["robot"]["distance_m"] > 0.5
    assert json.dumps(first) == json.dumps(second)


def test_goal_or_home_goes_home_and_logs_the_reason(caplog: pytest.LogCaptureFixture) -> None:
    result = json.loads(run("tutorials/goal_or_home", "--world", "house", "--duration", "30").stdout)
    assert result["status"] == "SUCCESS"
    assert result["nodes"]["Goal"]["failure"] == 1
    assert result["nodes"]["Home"]["ticks"] > 10
    assert result["nodes"]["Home"]["success"] == 1
    assert caplog.messages[0].startswith("Goal: can't go to (-9.65, -5.00): GOAL_OCCUPIED: ")


@pytest.mark.parametrize(
    ("option", "text", "message"),
    [
        ("--map", None, "no such file"),
        ("--map", "image: [", "not valid YAML"),
        ("--nav-params", None, "no such file"),
        ("--nav-params", "a: [", "not valid YAML"),
    ],
)
def test_a_missing_or_invalid_file_is_a_usage_error(
    tmp_path: Path, option: str, text: str | None, message: str
) -> None:
    file = tmp_path / "file.yaml"
    if text is not None:
        file.write_text(text)
    done = run("patrolling", "--world", "house", "--duration", "1", option, str(file))
    assert done.exit_code == 2
    assert "file.yaml" in done.stderr
    assert message in done.stderr


def test_a_patrol_in_a_world_without_waypoints_is_a_usage_error() -> None:
    done = run("patrolling", "--world", "arena", "--duration", "1")
    assert done.exit_code == 2
    assert done.stdout == ""
    assert "this world has no waypoints, but GetWaypoint::6 needs them" in done.stderr


def test_a_robot_outside_its_map_logs_the_unknown_pose_and_does_not_drive(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    # The map contains the first waypoint, but not the robot.
    save_map(room(0, 100, origin=(0.0, -13.3)), tmp_path / "far.yaml")
    options = ("--world", "house", "--duration", "2", "--map", str(tmp_path / "far.yaml"))
    result = json.loads(run("patrolling", *options).stdout)
    assert "the robot's pose is unknown" in caplog.text
    assert result["robot"]["distance_m"] < 0.02


@pytest.mark.parametrize(
    ("floor", "wall", "missing"), [(100, 100, "free floor"), (-1, 100, "free floor"), (0, 0, "wall")]
)
def test_a_map_without_floor_or_walls_is_refused(tmp_path: Path, floor: int, wall: int, missing: str) -> None:
    save_map(room(floor, wall), tmp_path / "map.yaml")
    done = run("patrolling", "--world", "house", "--duration", "2", "--map", str(tmp_path / "map.yaml"))
    assert done.exit_code == 2
    assert f"there is no {missing} on the map" in done.stderr
