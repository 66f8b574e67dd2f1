"""The options of commands that connect to robots: `KeyOptions`, and `WatchOptions` of those that watch."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from btcore.errors import SettingsError
from btcore.options import Options, option

if TYPE_CHECKING:
    from btcore_monitor.keys import ClientKeys
    from btcore_monitor.watch.feed import Feed


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


class WatchOptions(KeyOptions):
    """How robots are watched, and for how long."""

    no_record: Annotated[
        bool,
        option(
            "Do not read a C++ robot's recording of transitions: the first client to read it consumes it."
        ),
    ] = False
    blackboard_rate: Annotated[
        float,
        option("How often to request a C++ robot's blackboards; 0: never.", metavar="HZ", ge=0, le=100),
    ] = 2.0
    until_end: Annotated[bool, option("Stop when the robot reports the end of its run.")] = False
    duration: Annotated[float, option("Stop after this time.", metavar="SECONDS", ge=0)] | None = None

    def create_feed(self, address: str, keys: "ClientKeys | None") -> "Feed":
        """Return a feed of the robot at *address*, which is one of those that `read` returned *keys* for.

        Raises:
            AddressError: *address* is invalid.
        """
        from btcore_monitor.watch.feed import Feed

        return Feed(address, blackboard_rate=self.blackboard_rate, record=not self.no_record, keys=keys)
