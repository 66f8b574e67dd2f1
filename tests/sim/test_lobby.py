"""The world with all kinds of objects: a patrol through its doors and between its panes of glass."""

import json

import pytest
from click.testing import CliRunner

from btcore.cli.main import main
from btcore_sim.clearance_map import ClearanceMap
from btcore_sim.worlds import load_world_description

pytest.importorskip("yaml", reason="the patrol needs the navigation")


def test_a_robot_can_drive_to_every_waypoint() -> None:
    lobby = load_world_description("lobby")
    floor = ClearanceMap.of(lobby)
    places = list(lobby.waypoints.values())
    assert all(lobby.clearance_at(*place) > 0.75 for place in places)
    assert floor.connected(places, 0.45)


def test_a_patrol_drives_through_the_doors_without_contact() -> None:
    """Both rooms behind the doors are visited, with localisation: glass contradicts no scan."""
    options = ("--world", "lobby", "--seed", "3", "--duration", "72", "--camera", "off")
    done = CliRunner().invoke(main, ["run", "patrolling", *options, "--fast", "--json"])
    robot = json.loads(done.stdout)["robot"]
    assert (robot["collisions"], robot["grazes"], robot["goals_failed"]) == (0, 0, 0)
    assert robot["waypoints_visited"] == ["wp1", "wp2"]
    assert robot["unlocalized_s"] == 0
