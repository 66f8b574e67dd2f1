"""The options of a client's keys, `--key-file` and `--robot-key`."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from btcore_monitor.keys import ClientKeys

key_file_option = click.option(
    "--key-file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Your secret key (see btcore keys), for a robot that was started with --allow-key.",
)
robot_key_option = click.option(
    "--robot-key",
    "robot_keys",
    multiple=True,
    metavar="KEY",
    help="With --key-file: the robot's public key, or the file with it.",
)


def client_keys(
    key_file: Path | None, robot_keys: Sequence[str], robots: int = 1
) -> "Sequence[ClientKeys | None]":
    """Return the keys for the connection to each robot, from the options `--key-file` and `--robot-key`.

    Args:
        key_file: The value of `--key-file`.
        robot_keys: The values of `--robot-key`: one for all robots, or one per robot.
        robots: The number of robots.

    Raises:
        click.UsageError: An option is missing, or a key cannot be used.
    """
    if key_file is None:
        if robot_keys:
            raise click.UsageError("--robot-key needs --key-file with your secret key (see btcore keys)")
        return [None] * robots
    if not robot_keys:
        raise click.UsageError("--key-file needs --robot-key with the robot's public key")
    if len(robot_keys) not in (1, robots):
        raise click.UsageError(
            f"--robot-key is given {len(robot_keys)} times for {robots} robot{'s' * (robots > 1)}: give it "
            "once, or once per ADDRESS in their order"
        )
    from btcore_monitor.keys import ClientKeys, KeyFileError

    try:
        keys = [ClientKeys(key_file, key) for key in robot_keys]
    except KeyFileError as error:
        raise click.UsageError(str(error)) from None
    return keys if len(keys) == robots else keys * robots
