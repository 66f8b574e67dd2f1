"""The commands of ``btcore book``, from the command line to the picture."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

pytest.importorskip("pybullet")

from btcore.cli.main import main

BOX = {
    "description": "a wooden box ahead",
    "floor": "#8d9297",
    "start": {"pose": [0, 0, 0]},
    "objects": [
        {"name": "box", "kind": "box", "position": [2.4, 0], "size": [0.6, 0.6, 1.2], "color": "#aa783c"}
    ],
}


def run(*arguments: str) -> tuple[int, str, str]:
    done = CliRunner().invoke(main, ["book", *arguments], standalone_mode=False)
    if done.exception is not None:
        return 2, done.output, getattr(done.exception, "message", str(done.exception))
    return done.return_value or 0, done.stdout, ""


def report(*arguments: str) -> dict:
    code, expected_message, error = run(*arguments, "--fast", "--json", "--quiet")
    assert code == 0, error
    return json.loads(expected_message.splitlines()[-1])


@pytest.fixture
def box(tmp_path: Path) -> str:
    path = tmp_path / "box.json"
    path.write_text(json.dumps(BOX))
    return str(path)


COMMANDS = {
    "bumpgo-fsm": [],
    "vff": [],
    "obstacle-detector": [],
    "obstacle-detector-improved": [],
    "colour": ["--tilt", "-0.2"],
    "head-tracking": [],
}


@pytest.mark.parametrize("name", COMMANDS)
def test_each_command_runs_reports_and_draws(name: str, box: str, tmp_path: Path) -> None:
    picture = tmp_path / "picture.png"
    found = report(
        name,
        *COMMANDS[name],
        "--world",
        box,
        "--camera",
        "160x120@10",
        "--duration",
        "3",
        "--picture",
        str(picture),
    )
    assert found["time_s"] == 3.0
    assert found["robot"]["collisions"] == 0
    drawn = cv2.imread(str(picture))
    assert drawn is not None
    assert len(np.unique(drawn.reshape(-1, 3), axis=0)) >= 5


def test_the_same_seed_gives_the_same_run(box: str) -> None:
    first, second = (report("vff", "--world", "arena", "--seed", "5", "--duration", "4") for _ in range(2))
    assert first == second


def test_the_obstacle_moves_with_the_basic_but_not_with_the_improved_detector(box: str) -> None:
    arc = ("--world", box, "--drive", "0.1", "--turn", "0.2", "--duration", "8")
    assert report("obstacle-detector", *arc)["spread_m"] > 1.5
    assert report("obstacle-detector-improved", *arc)["spread_m"] < 0.5


def test_the_head_follows_an_object_while_the_base_turns(box: str) -> None:
    found = report("head-tracking", "--world", box, "--turn", "0.1", "--duration", "5")
    assert found["pictures_with_object"] > 30
    assert found["head"]["pan"] == pytest.approx(-0.45, abs=0.25)


def test_vff_with_all_obstacles_avoids_collisions() -> None:
    found = report("vff", "--all", "--world", "arena_boxes", "--seed", "2", "--duration", "20")
    assert found["robot"]["collisions"] + found["robot"]["grazes"] == 0
    assert found["robot"]["distance_m"] > 3.5


@pytest.mark.parametrize(
    ("arguments", "expected_message"),
    [
        (["colour", "--hsv", "1,2,3"], "'1,2,3' is not a colour range"),
        (["colour", "--hsv", "1,2,3,4,5,999"], "is not a colour range"),
        (["head-tracking", "--camera", "off"], "the camera is off"),
        (["vff", "--world", "nowhere"], "nowhere"),
        (["vff", "--duration", "1", "--picture", "/nowhere/a.png"], "there is no folder /nowhere"),
        (
            ["vff", "--duration", "1", "--picture", "a.txt"],
            "format '.txt' is not supported; use .png or .jpg",
        ),
        (["colour", "--camera", "off"], "the robot has no camera, or it is off"),
        (["colour", "--pan", "nan"], "nan is not a finite number"),
        (["obstacle-detector", "--drive", "nan"], "nan is not a finite number"),
        (["head-tracking", "--turn", "inf"], "inf is not a finite number"),
        (["launch", "none.yaml"], "none.yaml: no such file"),
        (["hello", "--params", "none.yaml"], "none.yaml: no such file"),
    ],
)
def test_a_usage_error_is_reported(arguments: list[str], expected_message: str) -> None:
    code, _, error = run(*arguments, "--fast")
    assert code == 2
    assert expected_message in error


def test_an_unknown_parameter_is_reported_with_a_suggestion(tmp_path: Path) -> None:
    (tmp_path / "p.yaml").write_text("localization_node: {ros__parameters: {particles: 300}}\n")
    done = CliRunner().invoke(
        main,
        ["book", "hello", "localization", "--fast", "--duration", "1", "--params", str(tmp_path / "p.yaml")],
    )
    assert "did you mean 'number_particles'?" in done.output
    assert "Number of particles: 200" in done.output


def test_the_picture_of_a_launch_file_shows_the_topic_graph(tmp_path: Path) -> None:
    (tmp_path / "l.yaml").write_text("launch:\n- node: {exec: publisher}\n- node: {exec: subscriber}\n")
    found = report(
        "launch", str(tmp_path / "l.yaml"), "--duration", "1", "--picture", str(tmp_path / "g.png")
    )
    assert found["components"] == ["publisher_node", "subscriber_node"]
    assert cv2.imread(str(tmp_path / "g.png")).shape[1] == 760
