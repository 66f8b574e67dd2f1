"""The providers of navigation: which of them a run uses, and what they need."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from btcore import Run, RunSettings, Settings, SettingsError
from btcore.program_runner import TreelessProgram
from btcore.runs.available_providers import AvailableProviders
from btcore.runs.choice import choose_providers
from btcore_navigation.leaves.explore import Explorer, MapFile
from btcore_navigation.leaves.navigate import PoseNavigator
from btcore_navigation.mapping.exploration import Exploration
from btcore_navigation.navigation_servers import NavigationServers
from btcore_navigation.providers import ExplorationSettings, MapSettings, NavigationSettings
from btcore_navigation.servers import Servers
from btcore_navigation.stack import Navigation
from btcore_robot.components.lifecycle import LifecycleState
from btcore_robot.leaves.lifecycle_leaves import HeadTrackerProtocol, ObjectLocatorProtocol
from btcore_robot.occupancy_map import OccupancyMap, load_map, save_map
from btcore_robot.robot import Robot, Waypoints
from btcore_ros2.providers import BagSettings, Nav2Settings, RosRobotSettings
from btcore_sim.providers import SimulatorSettings

HOUSE = SimulatorSettings(world="house", camera="off")


def used(wanted: list[Any], *settings: Settings) -> set[str]:
    choice = choose_providers(wanted, AvailableProviders(), set(map(type, settings)))
    return {provider.name for provider in choice.order}


def test_the_simulated_robot_navigates_on_the_map_of_its_world() -> None:
    simulation = {"simulator", "world_map", "world_places", "waypoints", "navigation", "navigator"}
    assert used([Robot, PoseNavigator]) == simulation
    assert used([NavigationServers]) == (simulation - {"navigator"}) | {"navigation_servers"}
    assert used([Robot, PoseNavigator], MapSettings(Path("map.yaml"))) == {
        *(simulation - {"world_map"}),
        "map_file",
    }


@pytest.mark.parametrize(
    ("settings", "robot"), [(BagSettings(Path("bag")), "bag_robot"), (RosRobotSettings("tiago"), "ros_robot")]
)
def test_with_another_robot_nothing_of_the_simulator_is_used(settings: Settings, robot: str) -> None:
    found = used([PoseNavigator, Waypoints, Robot], settings, MapSettings(Path("map.yaml")), HOUSE)
    navigation = {robot, "waypoints", "navigation", "navigator"}
    assert found - {"ros_session"} == {*navigation, "map_file"}
    assert used([PoseNavigator, Waypoints], settings) - {"ros_session"} == navigation
    assert used([Explorer, Robot], settings) - {"ros_session"} == {robot, "exploration"}


@pytest.mark.parametrize(("wanted", "provider"), [(Servers, "navigation"), (Explorer, "exploration")])
def test_leaves_navigate_by_nav2_beside_what_navigation_provides_else(wanted: Any, provider: str) -> None:
    settings = RosRobotSettings("tiago"), Nav2Settings(True)
    found = used([Robot, PoseNavigator, NavigationServers, wanted], *settings)
    assert {"nav2_client", provider} <= found
    assert not found & {"navigator", "navigation_servers"}


def test_a_tree_that_explores_navigates_on_the_map_that_it_makes(tmp_path: Path) -> None:
    assert "navigation" not in used([Robot, PoseNavigator, Explorer, Servers])
    run = Run(TreelessProgram("Explore"), settings=[HOUSE, ExplorationSettings(tmp_path / "map.yaml")])
    with run.want(PoseNavigator, Explorer, MapFile, Servers) as opened:
        navigator = opened.find(PoseNavigator)
        assert isinstance(navigator, Exploration)
        assert navigator is opened.find(Explorer)
        assert navigator.servers is opened.find(Servers)
        opened.tree.context.wait_until(2_000_000_000)
    assert load_map(tmp_path / "map.yaml").free.any()
    assert list(opened.report) == ["map", "robot"]


def test_tracker_and_locator_are_configured_and_shut_down() -> None:
    settings = [SimulatorSettings(world="house"), RunSettings(fast=True)]
    with Run(TreelessProgram("Look"), settings=settings).want(
        HeadTrackerProtocol, ObjectLocatorProtocol
    ) as run:
        tracker, locator = run.find(HeadTrackerProtocol), run.find(ObjectLocatorProtocol)
        assert tracker is not None
        assert locator is not None
        assert type(tracker) is not type(locator)
        assert tracker.state is locator.state is LifecycleState.INACTIVE
        assert run.find(Navigation) is not None
    assert tracker.state is locator.state is LifecycleState.FINALIZED


class Rover(Robot):
    """A robot without a map."""


def test_a_robot_without_a_map_cannot_navigate(tmp_path: Path) -> None:
    run = Run(TreelessProgram("Navigate"), settings=[NavigationSettings()], resources=[Rover()])
    with pytest.raises(SettingsError, match=r"there is no map to navigate on: use --map FILE\.yaml"):
        run.want(PoseNavigator).__enter__()
    save_map(OccupancyMap(np.zeros((2, 2), dtype=np.int8), 0.05, (0.0, 0.0)), tmp_path / "map.yaml")
    run = Run(TreelessProgram("Navigate"), settings=[MapSettings(tmp_path / "map.yaml")], resources=[Rover()])
    with pytest.raises(SettingsError, match="there is no wall on the map"):
        run.want(PoseNavigator).__enter__()


def test_the_folder_of_the_map_is_checked_before_the_run() -> None:
    with pytest.raises(SettingsError, match=r"--save-map /nowhere/map\.yaml: there is no folder /nowhere"):
        ExplorationSettings(Path("/nowhere/map.yaml"))
