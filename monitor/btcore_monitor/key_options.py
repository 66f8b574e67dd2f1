"""The options of a client's keys, `--key-file` and `--robot-key`."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from btcore.errors import SettingsError
from btcore.options import Options, option

if TYPE_CHECKING:
    from btcore_monitor.keys import ClientKeys


class KeyOptions(Options, kw_only=True):
    """The keys of a client."""

    key_file: (
        Annotated[
            Path,
            option(
                "Your secret key (see btcore keys), for a robot that was started with --allow-key.",
                metavar="FILE",
            ),
        ]
        | None
    ) = None
    robot_keys: Annotated[
        tuple[str, ...],
        option(
            "With --key-file: the robot's public key, or the file with it.", metavar="KEY", name="robot-key"
        ),
    ] = ()

    def read(self, robots: int = 1) -> "Sequence[ClientKeys | None]":
        """Return the keys for the connection to each robot; `--robot-key` is one for all, or one per robot.

        Args:
            robots: The number of robots.

        Raises:
            SettingsError: An option is missing.
            KeyFileError: A key cannot be used.
        """
        if self.key_file is None:
            if self.robot_keys:
                raise SettingsError("--robot-key needs --key-file with your secret key (see btcore keys)")
            return [None] * robots
        if not self.robot_keys:
            raise SettingsError("--key-file needs --robot-key with the robot's public key")
        if len(self.robot_keys) not in (1, robots):
            raise SettingsError(
                f"--robot-key is given {len(self.robot_keys)} times for {robots} robot{'s' * (robots > 1)}: "
                "give it once, or once per ADDRESS in their order"
            )
        from btcore_monitor.keys import ClientKeys

        keys = [ClientKeys(self.key_file, key) for key in self.robot_keys]
        return keys if len(keys) == robots else keys * robots
