"""``btcore keys``, and the options of clients about keys."""

from pathlib import Path

import pytest
from click.testing import CliRunner

import btcore
from btcore.cli.main import main
from btcore_monitor.client_options import KeyOptions
from btcore_monitor.events import TreeEvent
from btcore_monitor.keys import RobotKeys, create_keys
from btcore_monitor.serve import serve
from btcore_monitor.watch.feed import Feed


def test_a_key_pair_is_created_and_its_public_key_is_printed(tmp_path: Path) -> None:
    done = CliRunner().invoke(main, ["keys", str(tmp_path / "desk")])
    assert done.exit_code == 0
    public = done.stdout.strip()
    assert (tmp_path / "desk.pub").read_text() == f"{public} desk\n"
    assert done.stderr == (
        f"keys: {tmp_path}/desk is the secret key; give {tmp_path}/desk.pub to the other side\n"
    )
    again = CliRunner().invoke(main, ["keys", str(tmp_path / "desk")])
    assert again.exit_code != 0
    assert "exists and is not overwritten: choose another name" in again.stderr


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with the key pairs of a robot, of a known client, and of an unknown client."""
    for name in ("robot", "desk", "unknown_client"):
        create_keys(tmp_path / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--key-file", "desk"], "--key-file needs --robot-key with the robot's public key"),
        (["--robot-key", "robot.pub"], "--robot-key needs --key-file with your secret key"),
        (["--key-file", "desk.pub", "--robot-key", "robot.pub"], "desk.pub is not used, because other users"),
        (["--key-file", "desk", "--robot-key", "robot"], "robot has a secret key, not a public key"),
        (
            ["--key-file", "desk", *["--robot-key", "robot.pub"] * 2],
            "--robot-key is given 2 times for 1 robot:",
        ),
    ],
    ids=["no robot key", "no own key", "wrong mode", "secret robot key", "two robot keys"],
)
@pytest.mark.parametrize("command", ["monitor", "record", "hook"])
def test_bad_keys_are_usage_errors(folder: Path, command: str, options: list[str], message: str) -> None:
    arguments = {
        "monitor": ["monitor", ":1", "--no-view", "--save", "run.rrd"],
        "record": ["record", ":1", "-o", "run.btlog"],
        "hook": ["hook", ":1"],
    }[command]
    more = ["list"] if command == "hook" else []
    done = CliRunner().invoke(main, [*arguments, *options, *more])
    assert done.exit_code == 2
    assert f"error: {message}" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("command", ["monitor", "record", "hook"])
def test_an_unknown_key_ends_the_command_with_an_error(
    folder: Path, endless: btcore.Tree, no_threads_left: None, command: str
) -> None:
    allowed = RobotKeys("robot", ["desk.pub"])
    with serve(endless, groot2_port=0, keys=allowed, allow_control=True) as publisher:
        keys = ["--key-file", "unknown_client", "--robot-key", "robot.pub"]
        arguments = {
            "monitor": ["monitor", publisher.address, "--no-view", "--save", "run.rrd", *keys],
            "record": ["record", publisher.address, "-o", "run.btlog", *keys],
            "hook": ["hook", publisher.address, "--wait", "30", *keys, "list"],
        }[command]
        done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 2
    assert "refused the connection: the robot does not know this key; the public key for" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("first", [True, False])
def test_the_options_of_hook_precede_or_follow_the_address(
    folder: Path, endless: btcore.Tree, no_threads_left: None, first: bool
) -> None:
    allowed = RobotKeys("robot", ["desk.pub"])
    with serve(endless, groot2_port=0, keys=allowed, allow_control=True) as publisher:
        keys = ["--key-file=desk", "--robot-key", "robot.pub"]
        place = [*keys, publisher.address] if first else [publisher.address, *keys]
        done = CliRunner().invoke(main, ["hook", *place, "list"])
    assert (done.exit_code, done.stdout) == (0, "no hooks\n")


def test_several_robots_have_their_own_keys(
    folder: Path, endless: btcore.Tree, sample: btcore.Tree, no_threads_left: None
) -> None:
    create_keys(folder / "robot2")
    keys = KeyOptions(key_file=folder / "desk", robot_keys=("robot.pub", "robot2.pub")).read(2)
    for tree, name, robot, own in (
        (endless, "Endless", "robot", keys[0]),
        (sample, "Main", "robot2", keys[1]),
    ):
        with (
            serve(tree, groot2_port=0, keys=RobotKeys(robot, ["desk.pub"])) as publisher,
            Feed(publisher.address, keys=own) as feed,
        ):
            assert next(event.tree.name for event in feed if isinstance(event, TreeEvent)) == name
    assert KeyOptions(key_file=folder / "desk", robot_keys=("robot.pub",)).read(2)[0] is not None
