"""The simulator's extension of `btcore run`."""

import math
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import pytest

from btcore_robot.robot import GoalOutcome, Pose2D, Robot
from btcore_sim.run_extension import SimExtension

SETTINGS: dict[str, Any] = {
    "world": "arena",
    "gui": False,
    "robot": None,
    "camera": "off",
    "fault": (),
    "seed": 3,
    "fast": True,
    "rate": 10.0,
}


def test_a_tree_without_robot_leaves_starts_no_simulator():
    program = """
import sys
from btcore_sim.run_extension import SimExtension
assert SimExtension().provide({}, [int, str]) == ()
assert "pybullet" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", program], check=True, env={"PYTHONPATH": ":".join(sys.path)})


def test_the_options_of_the_extension():
    assert [option.name for option in SimExtension().options] == [
        "world",
        "waypoints",
        "gui",
        "robot",
        "camera",
        "start",
        "noise",
        "battery",
        "fault",
        "people",
        "obstacles",
        "event",
    ]


def test_loading_the_engine_prints_nothing():
    program = "from btcore_sim.simulated_robot import SimulatedRobot"
    found = subprocess.run(
        [sys.executable, "-c", program],
        check=True,
        env={"PYTHONPATH": ":".join(sys.path)},
        capture_output=True,
        text=True,
    )
    assert found.stdout + found.stderr == ""


def test_a_run_is_reported():
    extension = SimExtension()
    robot, *_ = extension.provide(SETTINGS, [int, Robot])
    assert isinstance(robot, Robot)
    with extension.attach(object(), [robot], SETTINGS):
        for tick in range(1, 21):
            robot.drive(0.2, 0.0)
            robot.clock.wait_until(tick * 100_000_000, threading.Event())
    report: Any = extension.report()["robot"]
    assert report["distance_m"] == pytest.approx(0.4, abs=0.05)
    assert (report["collisions"], report["grazes"]) == (0, 0)
    assert set(report["pose"]) == {"x", "y", "yaw"}


class Navigator:
    """A navigator that stays lost and has failed once."""

    def estimate(self) -> Pose2D | None:
        return None

    def outcomes(self) -> Sequence[GoalOutcome]:
        return [GoalOutcome(Pose2D(9.0, 9.0, 0.0), "ABORTED", 0)]


def test_the_results_of_a_navigator_are_reported():
    extension = SimExtension()
    robot, *_ = extension.provide({**SETTINGS, "battery": 30.0}, [Robot])
    with extension.attach(object(), [robot, Navigator()], SETTINGS):
        robot.clock.wait_until(1_000_000_000, threading.Event())
        robot.recharge()
    report: Any = extension.report()["robot"]
    assert report["battery_min"] == pytest.approx(29.99)
    assert (report["recharges"], report["goals_failed"], report["waypoints_visited"]) == (1, 1, [])


def test_the_options_for_start_and_noise_apply_to_the_robot():
    extension = SimExtension()
    robot, *_ = extension.provide({**SETTINGS, "start": "0.5,-0.5,90", "noise": 0.0}, [Robot])
    with extension.attach(object(), [robot], SETTINGS):
        first = robot.scan().ranges
        robot.clock.wait_until(1_000_000_000, threading.Event())
        assert robot.scan().ranges == pytest.approx(first, abs=0.002)
    report: Any = extension.report()["robot"]
    assert (report["pose"]["x"], report["pose"]["y"]) == pytest.approx((0.5, -0.5), abs=0.01)
    assert report["pose"]["yaw"] == pytest.approx(math.pi / 2, abs=0.01)


def test_a_run_that_fails_is_reported():
    extension = SimExtension()
    robot, *_ = extension.provide(SETTINGS, [Robot])
    with pytest.raises(ZeroDivisionError), extension.attach(object(), [robot], SETTINGS):
        raise ZeroDivisionError
    assert extension.report()["robot"]


def test_without_a_robot_there_is_no_report():
    extension = SimExtension()
    with extension.attach(object(), [], SETTINGS):
        pass
    assert extension.report() == {}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"world": "aren"}, "did you mean 'arena'"),
        ({"world": "nowhere.json"}, "no such file"),
        ({"robot": "nowhere.json"}, "no such file"),
        ({"fault": ("lasr:1-2",)}, "did you mean 'laser'"),
        ({"camera": "huge"}, "off, or WxH@HZ"),
        (
            {"rate": 2.0},
            r"--rate 2 is too slow for a tree that drives: the base stops 0.25 s after .* 4 times",
        ),
    ],
)
def test_an_invalid_option_raises_a_usage_error(changes: dict[str, Any], said: str):
    settings = {**SETTINGS, **changes}
    if settings["robot"]:
        settings["robot"] = Path(settings["robot"])
    with pytest.raises(click.UsageError, match=said) as caught:
        SimExtension().provide(settings, [Robot])
    assert isinstance(caught.value, click.ClickException)
    assert caught.value.exit_code == 2


def test_four_ticks_a_second_keep_the_robot_driving():
    robot, *_ = SimExtension().provide({**SETTINGS, "rate": 4.0}, [Robot])
    for tick in range(1, 13):
        robot.drive(0.2, 0.0)
        robot.clock.wait_until(tick * 250_000_000, threading.Event())
    assert robot.odometry().twist.v == pytest.approx(0.2, abs=0.01)
