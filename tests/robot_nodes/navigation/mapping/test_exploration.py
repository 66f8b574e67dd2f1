"""The exploration of a small flat by `btcore run mapping`, and navigation on the resulting map."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

pytest.importorskip("pybullet")

from btcore.cli.main import main
from btcore_navigation import sensor_watch
from btcore_navigation.likelihood import obstacle_distances
from btcore_navigation.mapping import map_quality
from btcore_robot.occupancy_map import OccupancyMap, load_map
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.worlds import load_world_description

Run = Callable[..., Result]

WALLS = {
    "west": ([-1.55, 0.0], [0.1, 4.2]),
    "east": ([4.05, 0.0], [0.1, 4.2]),
    "south": ([1.25, -2.05], [5.5, 0.1]),
    "north": ([1.25, 2.05], [5.5, 0.1]),
    "between_south": ([1.5, -1.3], [0.1, 1.4]),
    "between_north": ([1.5, 1.3], [0.1, 1.4]),
    "cabinet": ([3.7, 1.6], [0.6, 0.8]),
}
INTERRUPTED = """<root BTCPP_format="4"><BehaviorTree ID="T"><Sequence>
  <Repeat num_cycles="2"><ForceSuccess>
    <Timeout msec="15000"><Explore start="{start}"/></Timeout>
  </ForceSuccess></Repeat>
  <Move goal="{start}"/>
</Sequence></BehaviorTree></root>"""
EXPLORE = """<root BTCPP_format="4"><BehaviorTree ID="T"><Explore/></BehaviorTree></root>"""
GO = """<root BTCPP_format="4"><BehaviorTree ID="Go"><Move goal="2.9;-0.8"/></BehaviorTree></root>"""


@pytest.fixture
def flat(tmp_path: Path) -> Path:
    """Return a folder with a world of two rooms with a door, and with trees."""
    objects = [
        {"name": name, "kind": "box", "position": at, "size": [*size, 2.0], "color": "#d9d4c7"}
        for name, (at, size) in WALLS.items()
    ]
    world = {
        "description": "two rooms",
        "start": {"pose": [0, 0, 0]},
        "objects": objects,
        "physics_rate": 120,
    }
    (tmp_path / "flat.json").write_text(json.dumps(world), encoding="utf-8")
    (tmp_path / "go.xml").write_text(GO, encoding="utf-8")
    (tmp_path / "interrupted.xml").write_text(INTERRUPTED, encoding="utf-8")
    (tmp_path / "explore.xml").write_text(EXPLORE, encoding="utf-8")
    return tmp_path


def explore(folder: Path, name: str, *more: str, tree: str = "mapping") -> Result:
    command = ["run", tree, "--world", str(folder / "flat.json"), "--fast", "--camera", "off", "--json"]
    return CliRunner().invoke(
        main, [*command, "--save-map", str(folder / name), "--seed", "2", *more], prog_name="btcore"
    )


def within(first: OccupancyMap, second: OccupancyMap, cells: int) -> float:
    """Return the share of occupied cells of *first* within *cells* cells of an occupied cell of *second*."""
    places = first.centers(*np.nonzero(first.occupied))
    found = second.indices(places)
    on = (found >= 0).all(axis=1) & (found < second.cells.shape).all(axis=1)
    away = np.full(len(places), np.inf)
    away[on] = obstacle_distances(second)[found[on, 0], found[on, 1]]
    return float(np.mean(away <= cells * second.resolution + 1e-3))


def covered(explored: OccupancyMap, true: OccupancyMap) -> float:
    """Return the share of the free cells of *true* that are free in *explored*."""
    cells = explored.indices(true.centers(*np.nonzero(true.free)))
    on = (cells >= 0).all(axis=1) & (cells < explored.cells.shape).all(axis=1)
    return float(np.sum(explored.cells[cells[on, 0], cells[on, 1]] == 0) / len(cells))


def test_exploration_with_a_recharge_ends_with_a_good_map_on_which_the_robot_can_navigate(flat: Path) -> None:
    result = explore(flat, "map.yaml", "--battery", "33")
    assert result.exit_code == 0, result.output
    reported = json.loads(result.stdout.splitlines()[-1])
    assert reported["status"] == "SUCCESS"
    assert reported["time_s"] < 200.0
    robot = reported["robot"]
    assert (robot["collisions"], robot["grazes"], robot["recharges"], robot["goals_failed"]) == (0, 0, 1, 0)
    assert 20.0 < robot["battery_min"] < 30.0
    assert np.hypot(robot["pose"]["x"], robot["pose"]["y"]) < 0.35
    assert robot["localization_error_m"]["max"] is None or robot["localization_error_m"]["max"] < 0.1

    quality = reported["map"]
    assert quality["fit"] > 0.99
    assert quality["residual_m"] < 0.04
    assert quality["through_walls"] < 0.05
    assert quality["loops"] >= 0
    assert quality["loop_error_m"] < 0.1

    explored = load_map(flat / "map.yaml")
    true = rasterise(load_world_description(str(flat / "flat.json")))
    assert within(explored, true, 2) >= 0.97
    assert covered(explored, true) > 0.95

    command = ["run", str(flat / "go.xml"), "--world", str(flat / "flat.json"), "--fast", "--camera", "off"]
    result = CliRunner().invoke(
        main, [*command, "--map", str(flat / "map.yaml"), "--duration", "60", "--json"], prog_name="btcore"
    )
    assert result.exit_code == 0, result.output
    robot = json.loads(result.stdout.splitlines()[-1])["robot"]
    assert robot["pose"]["x"] == pytest.approx(2.9, abs=0.4)
    assert robot["collisions"] == 0


def test_an_unfinished_and_poor_map_is_saved_with_a_warning(
    flat: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(map_quality, "MIN_FIT", 1.01)
    result = explore(flat, "half.yaml", "--duration", "5")
    assert result.exit_code == 0, result.output
    share = json.loads(result.stdout.splitlines()[-1])["map"]["fit"]
    assert f"the map is poor: only {share:.1%} of the laser's rays end on its walls" in caplog.text
    half, true = load_map(flat / "half.yaml"), rasterise(load_world_description(str(flat / "flat.json")))
    assert 0.0 < covered(half, true) < 0.9


def test_an_interrupted_exploration_continues_and_keeps_its_start(flat: Path) -> None:
    result = explore(flat, "interrupted.yaml", tree=str(flat / "interrupted.xml"))
    assert result.exit_code == 0, result.output
    robot = json.loads(result.stdout.splitlines()[-1])["robot"]
    assert robot["distance_m"] > 2.0
    assert np.hypot(robot["pose"]["x"], robot["pose"]["y"]) < 0.35


def test_a_robot_with_a_low_battery_recharges_before_it_explores(flat: Path) -> None:
    reported = json.loads(explore(flat, "low.yaml", "--battery", "20", "--duration", "7").stdout)
    assert reported["robot"]["recharges"] == 1
    assert reported["robot"]["battery_min"] > 19.9
    assert [node["ticks"] > 10 for node in reported["nodes"].values() if node["id"] == "Explore"] == [True]


def test_exploration_with_empty_battery_fails(flat: Path, caplog: pytest.LogCaptureFixture) -> None:
    result = explore(flat, "empty.yaml", "--battery", "1", tree=str(flat / "explore.xml"))
    reported = json.loads(result.stdout.splitlines()[-1])
    assert reported["status"] == "FAILURE"
    cause = "FAILED_TO_MAKE_PROGRESS: the battery is empty"
    assert [goal["cause"] for goal in reported["robot"]["failed_goals"]] == [cause]
    assert f"Explore::1: the exploration ends: {cause}" in caplog.messages
    assert f"cause {cause}" in result.stderr


def test_an_exploration_without_a_laser_from_the_start_fails_with_this_cause(
    flat: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sensor_watch, "MAX_OUTAGE_S", 6.0)
    more = ("--fault", "laser:0-", "--duration", "90")
    reported = json.loads(explore(flat, "blind.yaml", *more, tree=str(flat / "explore.xml")).stdout)
    assert (reported["status"], reported["robot"]["faults"]) == ("FAILURE", ["laser:0-"])
    assert 6.0 <= reported["time_s"] <= 7.0
    assert reported["robot"]["unlocalized_s"] == pytest.approx(5.0, abs=0.5)
    assert "Explore::1: the exploration ends: no laser scan for 6.1 s" in caplog.text


def test_a_missing_folder_is_reported_as_a_usage_error(flat: Path) -> None:
    result = explore(flat, "nowhere/map.yaml")
    assert result.exit_code == 2
    assert "there is no folder" in result.stderr
