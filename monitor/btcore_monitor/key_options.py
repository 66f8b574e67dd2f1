"""The options of a client's keys, `--key-file` and `--robot-key`."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from btcore.runs.settings import Settings, option

if TYPE_CHECKING:
    from btcore_monitor.keys import ClientKeys

# The types of the fields, which the settings of the preview have, too.
KeyFileOption = Annotated[
    Path,
    option(
        "Your secret key (see btcore keys), for a robot that was started with --allow-key.", metavar="FILE"
    ),
]
RobotKeysOption = Annotated[
    tuple[str, ...],
    option("With --key-file: the robot's public key, or the file with it.", metavar="KEY", name="robot-key"),
]


class KeySettings(Settings):
    """The keys of a client."""

    key_file: KeyFileOption | None = None
    robot_keys: RobotKeysOption = ()


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
