"""`btcore run` of a tree that needs a robot: its report, and errors in its options."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from btcore.cli.main import main
from btcore_sweep.episode import run_episode

Run = Callable[..., Result]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("COLUMNS", "110")

    def call(*arguments: str) -> Result:
        return CliRunner().invoke(main, ["run", *arguments], prog_name="btcore")

    return call


def assert_usage_error(result: Result, *expected: str) -> None:
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.output
    for words in expected:
        assert words in result.stderr


def test_the_json_report_has_the_robots_figures(run: Run) -> None:
    result = run("bumpgo", "--fast", "--duration", "3", "--seed", "5", "--json")
    data = json.loads(result.stdout.splitlines()[-1])
    assert result.exit_code == 0, result.output
    assert list(data) == ["status", "ticks", "time_s", "real_time_factor", "nodes", "robot"]
    assert (data["ticks"], data["time_s"]) == (30, 3.0)
    assert list(data["robot"]) == [
        "distance_m",
        "collisions",
        "grazes",
        "pose",
        "battery_min",
        "odometry_error_m",
    ]
    assert data["robot"]["distance_m"] > 0.1


def test_the_same_seed_gives_the_same_line_twice_in_one_process(run: Run) -> None:
    def line(seed: int) -> dict[str, object]:
        world = ("--world", "arena_boxes", "--camera", "off")
        result = run("bumpgo_wide", *world, "--fast", "--duration", "6", "--json", "--seed", str(seed))
        data: dict[str, object] = json.loads(result.stdout.splitlines()[-1])
        del data["real_time_factor"]
        return data

    assert line(3) == line(3)
    assert line(3) != line(4)


def test_the_battery_option_sets_the_level_at_the_start(run: Run) -> None:
    result = run("bumpgo", "--fast", "--duration", "2", "--battery", "25", "--camera", "off", "--json")
    data = json.loads(result.stdout.splitlines()[-1])
    assert 24.0 < data["robot"]["battery_min"] < 25.0
    assert_usage_error(run("bumpgo", "--fast", "--battery", "120"), "--battery", "120")
    assert_usage_error(run("bumpgo", "--fast", "--battery", "nan"), "--battery", "nan is not a finite number")


def test_an_unknown_world_is_a_usage_error(run: Run) -> None:
    assert_usage_error(
        run("bumpgo", "--world", "aerna", "--fast"), "no world 'aerna'", "did you mean 'arena'?"
    )


def test_a_window_without_a_display_is_a_usage_error(run: Run) -> None:
    assert_usage_error(run("bumpgo", "--gui", "--duration", "1"), "DISPLAY is not set")


def test_a_rate_at_which_the_base_would_stop_is_a_usage_error(run: Run) -> None:
    assert_usage_error(run("bumpgo", "--rate", "2", "--fast"), "--rate 2 is too slow for a tree that drives")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--event", "kidnap:9"), "event 'kidnap:9' is after the end of the run (--duration 1)"),
        (("--start", "1,1", "--event", "box:0.5@0"), "event 'box:0.5@0,0' is not possible: the robot"),
        (("--start", "2.8,0"), "world 'arena': the robot cannot start at (2.8, 0), because it would touch"),
    ],
)
def test_impossible_events_and_starts_are_errors(run: Run, options: Sequence[str], message: str) -> None:
    result = run("bumpgo", "--fast", "--duration", "1", *options)
    assert_usage_error(result, message)
    assert result.stdout == ""


@pytest.mark.parametrize(("event", "began"), [("box:0.5@0", True), ("box:9", None)])
def test_an_episode_of_a_sweep_that_could_not_continue_differs_from_one_that_could_not_start(
    tmp_path: Path, event: str, began: bool | None
) -> None:
    command = ["bumpgo", "--fast", "--duration", "1", "--camera", "off", "--start", "1,1", "--event", event]
    result = run_episode(command, str(tmp_path))
    assert (result["code"], result["report"], result.get("began")) == (2, None, began)
    assert result["fault"].startswith(f"event '{event}")


def test_an_event_after_the_end_of_the_run_is_reported(run: Run) -> None:
    result = run("bumpgo", "--fast", "--duration", "1", "--event", "box:0.5-3", "--start", "2,0")
    assert result.exit_code == 0
    assert "event 'box:0.5-3' did not happen: the run ended before" in result.stderr


def test_an_incomplete_fault_is_a_usage_error(run: Run) -> None:
    assert_usage_error(run("bumpgo", "--fault", "laser", "--fast"), "laser")


@pytest.mark.parametrize(
    ("option", "value", "kinds"),
    [
        ("--world", "ofice", "a Robot"),
        ("--waypoints", "missing.yaml", "a Robot"),
        ("--map", "missing.yaml", "an OccupancyMap"),
        ("--save-map", "map.yaml", "an Explorer"),
    ],
)
def test_options_without_effect_are_reported_if_the_tree_needs_no_robot(
    run: Run, tmp_path: Path, option: str, value: str, kinds: str
) -> None:
    tree = tmp_path / "tree.xml"
    tree.write_text('<root BTCPP_format="4"><BehaviorTree ID="M"><AlwaysSuccess/></BehaviorTree></root>')
    result = run(str(tree), option, value)
    assert result.exit_code == 0
    assert f"{option} has no effect: no leaf needs {kinds}" in result.stderr


def test_a_missing_robot_file_is_a_usage_error(run: Run) -> None:
    assert_usage_error(run("bumpgo", "--robot", "no_robot.json", "--fast"), "no_robot.json")
