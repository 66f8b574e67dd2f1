"""The simulator as a provider of a run."""

import math
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec
import pytest

from btcore import BtcoreError, Report, Run, RunSettings, provider
from btcore.program_runner import TreelessProgram
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.robot import GoalOutcome, Pose2D, Robot, WorldPlaces
from btcore_sim.errors import SimError
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.providers import SimulatorSettings, SpareBoxes
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.simulation import Simulation
from btcore_sim.worlds import load_world_description

SECOND = 1_000_000_000
ARENA = SimulatorSettings(camera="off")


def drive(
    settings: SimulatorSettings = ARENA,
    *provided: object,
    seconds: float = 2.0,
    step: Callable[[Robot], object] = lambda robot: robot.drive(0.2, 0.0),
    rate: float = 10.0,
) -> Report:
    """Run a program that calls *step* at each tick, and return the report."""
    program = TreelessProgram("Drive")

    def prepare(run: Run) -> None:
        robot = run.find(Robot)
        assert robot is not None
        program.keep_running = lambda: step(robot) is None

    run_settings = RunSettings(rate=rate, duration=seconds, seed=3, fast=True)
    with Run(program, settings=[settings, run_settings], resources=provided, prepare=prepare).want(
        Robot
    ) as run:
        run.tick_to_end()
    return run.report


def test_a_tree_without_robot_leaves_imports_no_simulator(tmp_path: Path) -> None:
    program = """
import sys
from btcore.cli.main import main
assert main(["run", "tree.xml", "--world", "house"], standalone_mode=False) == 0
print([name for name in ("numpy", "pybullet", "cv2", "btcore_robot") if name in sys.modules])
"""
    tree = '<root BTCPP_format="4"><BehaviorTree ID="M"><AlwaysSuccess/></BehaviorTree></root>'
    (tmp_path / "tree.xml").write_text(tree)
    found = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True, cwd=tmp_path
    )
    assert found.stdout.splitlines()[-1] == "[]"
    assert "--world has no effect: no leaf needs a Robot" in found.stderr


def test_the_settings_are_options() -> None:
    assert SimulatorSettings.__struct_fields__ == (
        *("world", "waypoints", "gui", "robot", "camera", "start", "noise", "battery", "fault", "people"),
        *("obstacles", "event"),
    )


def test_loading_pybullet_prints_nothing() -> None:
    program = "from btcore_sim.simulated_robot import SimulatedRobot"
    found = subprocess.run(
        [sys.executable, "-c", program],
        check=True,
        env={"PYTHONPATH": ":".join(sys.path)},
        capture_output=True,
        text=True,
    )
    assert found.stdout + found.stderr == ""


def test_a_run_is_reported() -> None:
    report: Any = drive()["robot"]
    assert report["distance_m"] == pytest.approx(0.4, abs=0.05)
    assert (report["collisions"], report["grazes"]) == (0, 0)
    assert set(report["pose"]) == {"x", "y", "yaw"}


class Navigator:
    """A navigator that stays lost and has failed once."""

    def estimate(self) -> Pose2D | None:
        return None

    def outcomes(self) -> Sequence[GoalOutcome]:
        return [GoalOutcome(Pose2D(9.0, 9.0, 0.0), "ABORTED", 0)]


def test_the_results_of_a_navigator_are_reported() -> None:
    settings = msgspec.structs.replace(ARENA, battery=30.0)
    report: Any = drive(settings, Navigator(), seconds=1.0, step=lambda robot: robot.recharge())["robot"]
    assert report["battery_min"] == pytest.approx(29.99, abs=0.02)
    assert (report["goals_failed"], report["waypoints_visited"]) == (1, [])
    assert report["recharges"] == 10


def test_the_options_for_start_and_noise_apply_to_the_robot() -> None:
    scans: list[Any] = []
    settings = msgspec.structs.replace(ARENA, start="0.5,-0.5,90", noise=0.0)
    report: Any = drive(settings, seconds=1.0, step=lambda robot: scans.append(robot.scan()))["robot"]
    assert scans[-1].ranges == pytest.approx(scans[0].ranges, abs=0.002)
    assert (report["pose"]["x"], report["pose"]["y"]) == pytest.approx((0.5, -0.5), abs=0.01)
    assert report["pose"]["yaw"] == pytest.approx(math.pi / 2, abs=0.01)


def test_a_run_that_fails_is_reported() -> None:
    with pytest.raises(ZeroDivisionError), Run(TreelessProgram("Fail"), settings=[ARENA]).want(Robot) as run:
        raise ZeroDivisionError
    assert run.report["robot"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"world": "aren"}, "did you mean 'arena'"),
        ({"world": "nowhere.json"}, "no such file"),
        ({"robot": Path("nowhere.json")}, "no such file"),
        ({"fault": ("lasr:1-2",)}, "did you mean 'laser'"),
        ({"camera": "huge"}, "off, or WxH@HZ"),
        ({"event": ("bx:1",)}, "did you mean 'box'"),
        ({"people": 100}, "no room for 100 people"),
        ({"obstacles": 100}, "no room for 100 obstacles"),
    ],
)
def test_an_invalid_setting_is_a_simulation_error(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SimError, match=message):
        drive(msgspec.structs.replace(ARENA, **changes))


def test_a_rate_at_which_the_base_would_stop_is_an_error() -> None:
    message = r"--rate 2 is too slow for a tree that drives: the base stops 0.25 s after .* 4 times"
    with pytest.raises(BtcoreError, match=message):
        drive(rate=2.0)
    report: Any = drive(rate=4.0, seconds=3.0)["robot"]
    assert report["distance_m"] == pytest.approx(0.6, abs=0.08)


def test_settings_reach_the_world_and_events_the_report() -> None:
    settings = SimulatorSettings(
        world="house", camera="off", people=2, obstacles=1, event=("box:90-95", "kidnap:1")
    )
    program = TreelessProgram("Drive")
    with Run(program, settings=[settings, RunSettings(fast=True)], resources=[SpareBoxes(1)]).want(
        SimulatedRobot
    ) as run:
        body = run.find(SimulatedRobot)
        names = [body.world.bodies[number].name for number in body.world.movable]
        for _ in range(20):
            body.drive(0.1, 0.0)
            body.clock.wait_until(body.clock.now() + SECOND // 10, threading.Event())
    assert names == ["obstacle_0", "person_0", "person_1", "dropped_box_0", "dropped_box_1"]
    assert [(event["event"], event["t"]) for event in run.report["events"]] == [("kidnap", 1.0)]


def test_map_and_places_are_those_of_the_world_without_the_obstacles_of_the_run() -> None:
    settings = SimulatorSettings(world="house", camera="off", obstacles=2)
    with Run(TreelessProgram("Look"), settings=[settings]).want(OccupancyMap, WorldPlaces) as run:
        map, places, simulated = run.find(OccupancyMap), run.find(WorldPlaces), run.find(Simulation)
    drawn = rasterise(load_world_description("house"))
    assert ((map.cells == drawn.cells).all(), map.keepout) == (True, drawn.keepout)
    assert places.waypoints == load_world_description("house").waypoint_poses()
    assert places.start == simulated.robot.start_pose


def test_the_start_may_be_unknown() -> None:
    settings = SimulatorSettings(world="house", camera="off", start="unknown")
    with Run(TreelessProgram("Look"), settings=[settings]).want(WorldPlaces) as run:
        assert run.find(WorldPlaces).start is None


@pytest.mark.filterwarnings("ignore:SimulatorSettings have no effect")
def test_nothing_of_the_simulator_is_opened_for_another_robot() -> None:
    class Rover(Robot):
        """A robot without a simulator."""

    @provider(provides=(Robot,))
    def rover() -> Rover:
        return Rover()

    with Run(TreelessProgram("Look"), settings=[ARENA], providers=[rover]).want(Robot) as run:
        assert isinstance(run.find(Robot), Rover)
    run = Run(TreelessProgram("Look"), settings=[ARENA], providers=[rover]).want(Robot)
    with run.want(WorldPlaces, OccupancyMap, optional=True):
        assert [provider.name for provider in run.providers.choice.order] == ["rover"]
        assert run.find(WorldPlaces) is run.find(OccupancyMap) is None
    assert run.report == {}
    given = Rover()
    run = Run(TreelessProgram("Look"), settings=[ARENA], resources=[given]).want(Robot)
    with run.want(WorldPlaces, optional=True):
        assert [provider.name for provider in run.providers.choice.order] == []
