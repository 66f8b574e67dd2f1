"""Files of waypoints, and which waypoints a run uses."""

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

pytest.importorskip("pybullet")

from btcore import Run
from btcore.cli.main import main
from btcore.program_runner import TreelessProgram
from btcore_navigation.providers import MapSettings
from btcore_robot.occupancy_map import MapError, OccupancyMap, save_map
from btcore_robot.robot import Pose2D, Robot, Waypoints
from btcore_robot.waypoint_file import load_waypoints, save_waypoints, waypoints_path
from btcore_sim.worlds import load_world_description


def test_saved_waypoints_are_loaded_unchanged(tmp_path: Path) -> None:
    places = {"recharge": Pose2D(3.7, -0.25, 3.1), "wp1": Pose2D(0.0, 1e-9, -1.5), "1": Pose2D(2.0, 1.0, 0.0)}
    path = tmp_path / "room.waypoints.yaml"
    save_waypoints(Waypoints(places), path)
    assert load_waypoints(path) == Waypoints(places, source=str(path))


def test_the_heading_of_a_waypoint_may_be_omitted(tmp_path: Path) -> None:
    path = tmp_path / "room.waypoints.yaml"
    path.write_text("waypoints: {wp1: [1, 2]}")
    assert load_waypoints(path).places == {"wp1": Pose2D(1.0, 2.0, 0.0)}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("waypoint: {}\n", ":1: 'waypoint' is unknown: known are waypoints; did you mean 'waypoints'?"),
        ("a: 1\n", ":1: 'waypoints' is missing"),
        (
            "waypoints:\n  wp1: [1, 2]\n  wp2: [1]\n",
            ":3: 'waypoints.wp2' is [1], and a list of 2 or 3 numbers",
        ),
    ],
)
def test_an_error_is_reported_with_file_and_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "room.waypoints.yaml"
    path.write_text(text)
    with pytest.raises(MapError, match=re.escape(f"{path}{message}")):
        load_waypoints(path)


def btcore(*arguments: str) -> Result:
    done = CliRunner().invoke(main, [*arguments], prog_name="btcore")
    assert "Traceback" not in done.stderr
    return done


def test_map_writes_the_waypoints_of_the_world(tmp_path: Path) -> None:
    done = btcore("map", "house", "-o", str(tmp_path))
    path = waypoints_path(tmp_path / "house.yaml")
    assert f"{path}: 5 waypoints" in done.stdout
    assert load_waypoints(path).places == load_world_description("house").waypoint_poses().places


PATROL = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
  <GetWaypoint waypoint="{wp}"/> <GetWaypoint waypoint="{wp}"/> <GetWaypoint waypoint="{wp}"/>
  <Move goal="{wp}"/>
</Sequence></BehaviorTree></root>"""


def test_the_waypoints_beside_the_map_replace_those_of_the_world(tmp_path: Path) -> None:
    btcore("map", "house", "-o", str(tmp_path))
    path = waypoints_path(tmp_path / "house.yaml")
    options = ["--map", str(tmp_path / "house.yaml"), "--world", "house", "--camera", "off", "--fast"]
    (tmp_path / "patrol.xml").write_text(PATROL)
    # Of two waypoints, the third goal is the first waypoint again, near which the robot starts.
    path.write_text("waypoints: {wp1: [0.1, 0.0], wp2: [5.0, -3.0]}")
    done = btcore("run", str(tmp_path / "patrol.xml"), *options, "--duration", "10")
    assert done.exit_code == 0, done.stderr
    path.write_text("waypoints: {wp2: [0.1, 0.0]}")
    done = btcore("run", str(tmp_path / "patrol.xml"), *options)
    assert done.exit_code == 2
    problem = f"{path} has no waypoint 'wp1', but GetWaypoint::2 needs it; add 'wp1: [x, y, yaw]' to the file"
    assert problem in " ".join(done.stderr.split())


def test_a_map_of_a_world_without_waypoints_is_refused_for_a_patrol(tmp_path: Path) -> None:
    btcore("map", "arena", "-o", str(tmp_path))
    done = btcore("run", "patrolling", "--map", str(tmp_path / "arena.yaml"))
    assert done.exit_code == 2
    remedy = f"this world has no waypoints, but GetWaypoint::6 needs them; write them to the file {tmp_path}"
    assert remedy in " ".join(done.stderr.split())


def test_a_robot_without_waypoints_on_its_map_gets_none(tmp_path: Path) -> None:
    path = tmp_path / "office.yaml"
    save_map(OccupancyMap(np.zeros((2, 2), dtype=np.int8), 0.05, (0.0, 0.0)), path)
    run = Run(TreelessProgram("Look"), settings=[MapSettings(path)], resources=[Rover()]).want(
        Robot, Waypoints
    )
    with run:
        waypoints = run.find(Waypoints)
        assert waypoints is not None
        assert (waypoints.places, waypoints.source) == ({}, "the robot's map")
        assert "write them to the file" in waypoints.remedy
        assert [provider.name for provider in run.providers.choice.order] == ["waypoints"]


class Rover(Robot):
    """A robot without a simulator."""
