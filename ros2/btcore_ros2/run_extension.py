"""The extension of `btcore run` that provides ROS 2: the session for leaves, and the robot over topics."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from btcore import Tree
from btcore.logs import LogError
from btcore.run_extension import RunExtension
from btcore_robot.robot import BaseInfo, Robot
from btcore_ros2.errors import RosError
from btcore_ros2.session import RosSession, node_arguments

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from btcore_ros2.nav2.client import Nav2Client
    from btcore_ros2.robot.bag_robot import BagRobot
    from btcore_ros2.robot.ros_robot import RosRobot

START_TIMEOUT_S = 10.0
"""How long (s) a run without a robot waits for a world in lockstep."""

POSE_WAIT_S = 5.0
"""How long (s) a run with `--nav2` waits for the robot's pose before its first tick."""


class RosExtension(RunExtension):
    """Provides the `RosSession` that leaves require, with `--ros2` the robot, and with `--nav2` Nav2."""

    used_by = "leaf that uses ROS 2, a robot or Nav2"
    options: Sequence[click.Option] = (
        click.Option(
            ["--ros2", "ros2_robot"],
            metavar="FILE.yaml",
            help="Use a ROS 2 robot instead of the simulated robot: tiago, turtlebot3, turtlebot4, or a file "
            "that describes its topics.",
        ),
        click.Option(
            ["--bag"],
            type=click.Path(dir_okay=False, path_type=Path),
            metavar="FILE.mcap",
            help="Run on the sensors that were recorded in a bag, without ROS, and compare the commands with "
            "the recorded commands. --ros2 describes the robot; default: tiago.",
        ),
        click.Option(
            ["--nav2"],
            is_flag=True,
            help="Let Nav2's tree nodes and Move use the servers of a running Nav2.",
        ),
        click.Option(
            ["--ros-args"],
            metavar="ARGS",
            help="Arguments of the ROS node, as one text: '-r scan:=/scan_raw -r __ns:=/robot1'.",
        ),
        click.Option(
            ["--lockstep"],
            is_flag=True,
            help="Let the simulation wait for the run: repeatable, and as fast as possible. "
            "For `btcore ros2 sim` and the run that uses it.",
        ),
    )

    def __init__(self) -> None:
        self._session: RosSession | None = None
        self._robot: RosRobot | None = None
        self._bag_robot: BagRobot | None = None
        self._nav2: Nav2Client | None = None

    def takes_over(self, settings: Mapping[str, Any], wanted: Sequence[type]) -> Sequence[type]:
        """Return the types of the navigation if Nav2 is used; see `RunExtension.takes_over`."""
        if not settings.get("nav2"):
            return ()
        from btcore_navigation.leaves.navigate import PoseNavigator
        from btcore_navigation.navigation_servers import NavigationServers

        return [kind for kind in wanted if kind in (NavigationServers, PoseNavigator)]

    def provide(
        self, settings: Mapping[str, Any], wanted: Sequence[type], provided: Sequence[object]
    ) -> Sequence[object]:
        """Return the session, the robot and the client of Nav2 as far as they are required.

        See `RunExtension.provide`.
        """
        if settings.get("bag") is not None:
            return self._provide_from_bag(settings, wanted)
        name = settings.get("ros2_robot")
        drives = name is not None and _has_robot(wanted)
        navigates = bool(self.takes_over(settings, wanted))
        if RosSession not in wanted and not drives and not navigates:
            if settings.get("lockstep"):
                raise click.UsageError("--lockstep needs a robot on ROS 2 (--ros2), or leaves that use ROS 2")
            return ()
        if settings.get("nav2") and not navigates:
            click.echo("warning: --nav2 has no effect: no leaf uses Nav2", err=True)
        # A tree without a robot must not import the modules of the robot.
        from btcore_ros2.robot.description import load_robot
        from btcore_ros2.robot.ros_robot import RosRobot

        try:
            description = load_robot(str(name)) if drives else None
            # A command that needs the session earlier, such as `btcore ros2 serve`, has created it.
            self._session = settings.get("ros_session")
            if self._session is None:
                self._session = RosSession(arguments=node_arguments(settings.get("ros_args")))
            if settings.get("lockstep"):
                from btcore_ros2.simulation.lockstep import LockstepClock

                limit = description.start_timeout if description is not None else START_TIMEOUT_S
                self._session.clock = LockstepClock(self._session, limit)
            resources: list[object] = []
            if description is not None:
                _check_rate(settings.get("rate"), description.base)
                self._robot = RosRobot(self._session, description)
                # Before the session, because the robot's clock may be that of a simulation.
                resources.append(self._robot)
            if navigates:
                from btcore_ros2.nav2.client import Nav2Client

                self._nav2 = Nav2Client(self._session)
                resources.append(self._nav2)
        except (RosError, ValueError) as error:
            if self._session is not None:
                self._session.close()
            raise click.UsageError(str(error)) from error
        return (*resources, self._session)

    def _provide_from_bag(self, settings: Mapping[str, Any], wanted: Sequence[type]) -> Sequence[object]:
        """Return the robot of the bag, if a robot is required."""
        if settings.get("ros_session") is not None:
            raise click.UsageError("--bag does not belong here: this command serves on ROS 2")
        for option in ("nav2", "lockstep", "ros_args"):
            if settings.get(option):
                name = option.replace("_", "-")
                raise click.UsageError(f"--bag and --{name} exclude each other: a bag is read without ROS")
        if RosSession in wanted:
            raise click.UsageError(
                "--bag reads sensors without ROS, but the tree has leaves that use ROS 2: replace them by "
                "--substitute"
            )
        if not _has_robot(wanted):
            return ()
        from btcore_bags.reader import BagReader
        from btcore_ros2.robot.bag_robot import BagRobot
        from btcore_ros2.robot.description import load_robot

        try:
            description = load_robot(str(settings.get("ros2_robot") or "tiago"))
            _check_rate(settings.get("rate"), description.base)
            reader = BagReader(settings["bag"])
            try:
                self._bag_robot = BagRobot(reader, description)
            except Exception:
                reader.close()
                raise
        except (RosError, LogError) as error:
            raise click.UsageError(str(error)) from error
        return [self._bag_robot]

    def attach(
        self, tree: Tree, resources: Sequence[object], settings: Mapping[str, Any]
    ) -> "AbstractContextManager[object]":
        """Wait for the robot's pose; stop the robot and close the session at the end of the run."""
        return self._attached()

    @contextmanager
    def _attached(self) -> Iterator[None]:
        try:
            if self._session is not None and self._nav2 is not None:
                found = self._session.wait_for(self._nav2.pose, POSE_WAIT_S)
                if not found:
                    from btcore_ros2.nav2.pose_listener import POSE_IS_UNKNOWN

                    click.echo(f"warning: --nav2: {POSE_IS_UNKNOWN}", err=True)
            yield
        finally:
            if self._bag_robot is not None:
                self._bag_robot.close()
                if self._bag_robot.warning:
                    click.echo(f"warning: {self._bag_robot.warning}", err=True)
            if self._robot is not None:
                self._robot.close()
            if self._session is not None:
                self._session.close()

    def report(self) -> Mapping[str, object]:
        """Return the comparison of the commands with those of the bag, if there is a bag."""
        return {} if self._bag_robot is None else {"commands": self._bag_robot.compare_commands()}


def _has_robot(wanted: Sequence[type]) -> bool:
    """Return whether a robot is among the types *wanted*."""
    return any(Robot in getattr(kind, "__mro__", ()) for kind in wanted)


def _check_rate(rate: float | None, base: BaseInfo) -> None:
    least = 1.0 / base.command_timeout
    if rate is not None and rate < least:
        raise RosError(
            f"--rate {rate:g} is too slow for a tree that drives: a velocity command expires after "
            f"{base.command_timeout:g} s, so the tree has to be ticked at least {least:g} times a second"
        )
