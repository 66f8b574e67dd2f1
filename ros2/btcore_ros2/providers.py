"""ROS 2 in a run: the session for leaves, a robot over topics or from a bag, Nav2, and telemetry."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

from btcore import Report, Resources, RunSettings, Settings, option, provider
from btcore.clock import Clock
from btcore.errors import SettingsError
from btcore.tree.tree import Tree
from btcore_ros2.errors import RosError

if TYPE_CHECKING:
    import btcore_ros2.nav2.client
    import btcore_ros2.robot.bag_robot
    import btcore_ros2.robot.ros_robot
    import btcore_ros2.session

START_TIMEOUT_S: Final = 10.0
"""How long (s) a run without a robot on ROS 2 waits for a world in lockstep."""

POSE_WAIT_S: Final = 5.0
"""How long (s) a run with `--nav2` waits for the robot's pose."""


class RosSettings(Settings):
    """The settings of the ROS node."""

    ros_args: (
        Annotated[
            str,
            option(
                "Arguments of the ROS node, as one text: '-r scan:=/scan_raw -r __ns:=/robot1'.",
                metavar="ARGS",
            ),
        ]
        | None
    ) = None
    lockstep: Annotated[
        bool,
        option(
            "Let the simulation wait for the run: repeatable, and as fast as possible. "
            "For `btcore ros2 sim` and the run that uses it."
        ),
    ] = False


class RosRobotSettings(Settings):
    """The settings of a robot on ROS 2."""

    ros2: Annotated[
        str,
        option(
            "Use a ROS 2 robot instead of the simulated robot: tiago, turtlebot3, turtlebot4, or a file "
            "that describes its topics.",
            metavar="FILE.yaml",
        ),
    ]


class BagSettings(Settings):
    """The settings of a robot that was recorded in a bag."""

    bag: Annotated[
        Path,
        option(
            "Run on the sensors that were recorded in a bag, without ROS, and compare the commands with "
            "the recorded commands. --ros2 describes the robot; default: tiago.",
            metavar="FILE.mcap",
        ),
    ]


class Nav2Settings(Settings):
    """The settings of Nav2."""

    nav2: Annotated[bool, option("Let Nav2's tree nodes and Move use the servers of a running Nav2.")]


class TelemetrySettings(Settings):
    """The settings of the telemetry.

    Raises:
        SettingsError: The package of a message is not installed.
    """

    ros2_publish: Annotated[
        tuple[Literal["log", "diagnostics", "rosout"], ...],
        option(
            "Publish the run for ROS 2: transitions on /behavior_tree_log, the state of the tree on "
            "/diagnostics, or log records on /rosout; may be given several times.",
            one_run_only=True,
        ),
    ]

    def __post_init__(self) -> None:
        from btcore_ros2.telemetry import check_topics

        try:
            check_topics(self.ros2_publish)
        except RosError as error:
            raise SettingsError(f"--ros2-publish: {error}.") from error


@contextmanager
def open_session(
    settings: RosSettings,
    robot: RosRobotSettings | None = None,
    name: str = "btcore",
    arguments: Sequence[str] = (),
) -> "Iterator[btcore_ros2.session.RosSession]":
    """Return a context with the session of a run or a command.

    Args:
        settings: The settings of the ROS node.
        robot: Its description limits how long `--lockstep` waits for a world.
        name: The name of the ROS node.
        arguments: Further arguments of the ROS node.

    Raises:
        RosError: There is no ROS 2, the arguments are invalid, or there is no world in lockstep.
    """
    from btcore_ros2.session import RosSession, node_arguments

    try:
        session = RosSession(name, arguments=[*node_arguments(settings.ros_args), *arguments])
    except ValueError as error:
        raise RosError(str(error)) from error
    with session:
        if settings.lockstep:
            from btcore_ros2.robot.description import load_robot
            from btcore_ros2.simulation.lockstep import LockstepClock

            limit = START_TIMEOUT_S if robot is None else load_robot(robot.ros2).start_timeout
            session.clock = LockstepClock(session, limit)
        yield session


@provider
def ros_session(
    settings: RosSettings, robot: RosRobotSettings | None, bag: BagSettings | None
) -> "Iterator[btcore_ros2.session.RosSession]":
    """Provide the session for leaves, a robot and Nav2.

    Args:
        settings: The settings of the ROS node.
        robot: See `open_session`.
        bag: It is an error: a bag is read without ROS.
    """
    if bag is not None:
        raise SettingsError(
            "--bag reads sensors without ROS, but the tree has leaves that use ROS 2: replace them by "
            "--substitute"
        )
    with open_session(settings, robot) as session:
        yield session


@provider
def ros_clock(session: "btcore_ros2.session.RosSession") -> Clock:
    """Return the clock of the session, on which a run without a robot waits for messages."""
    return session.clock


@provider(provides=("btcore_robot.robot.Robot", Clock))
def ros_robot(
    session: "btcore_ros2.session.RosSession", settings: RosRobotSettings, run_settings: RunSettings
) -> "Iterator[btcore_ros2.robot.ros_robot.RosRobot]":
    """Provide a robot over its topics, and stop it at the end."""
    from btcore_ros2.robot.description import load_robot
    from btcore_ros2.robot.ros_robot import RosRobot

    description = load_robot(settings.ros2)
    description.base.check_rate(run_settings.rate)
    with RosRobot(session, description) as robot:
        yield robot


@provider(provides=("btcore_robot.robot.Robot", Clock))
def bag_robot(
    settings: BagSettings,
    robot: RosRobotSettings | None,
    ros: RosSettings,
    nav2: Nav2Settings | None,
    run_settings: RunSettings,
    report: Report,
    resources: Resources,
) -> "Iterator[btcore_ros2.robot.bag_robot.BagRobot]":
    """Provide the robot of a bag, and report the comparison of its commands.

    Args:
        settings: The bag.
        robot: The description of the robot; by default that of the Tiago.
        ros: Settings that exclude a bag, as *nav2* does.
        nav2: See *ros*.
        report: Gets the comparison.
        resources: If a session is among them, that of a command that serves on ROS 2, it is an error.

    Raises:
        SettingsError: Another option excludes a bag.
        LogError: The bag cannot be read.
        RosError: The bag does not fit the robot.
    """
    from btcore_bags.reader import BagReader
    from btcore_ros2.robot.bag_robot import BagRobot
    from btcore_ros2.robot.description import load_robot
    from btcore_ros2.session import RosSession

    if any(isinstance(resource, RosSession) for resource in resources):
        raise SettingsError("--bag does not belong here: this command serves on ROS 2")
    excluded = {"--nav2": nav2 is not None, "--lockstep": ros.lockstep, "--ros-args": ros.ros_args}
    for name, is_given in excluded.items():
        if is_given:
            raise SettingsError(f"--bag and {name} exclude each other: a bag is read without ROS")
    description = load_robot("tiago" if robot is None else robot.ros2)
    description.base.check_rate(run_settings.rate)
    with BagReader(settings.bag) as reader:
        recorded = BagRobot(reader, description)
        try:
            yield recorded
        finally:
            if recorded.warning:
                report.warn(recorded.warning)
            report.add("commands", recorded.compare_commands())


@provider(
    provides=(
        "btcore_navigation.leaves.navigate.PoseNavigator",
        "btcore_navigation.navigation_servers.NavigationServers",
    )
)
def nav2_client(
    session: "btcore_ros2.session.RosSession", settings: Nav2Settings, report: Report
) -> "btcore_ros2.nav2.client.Nav2Client":
    """Return the client of a running Nav2, after waiting for the robot's pose.

    Args:
        settings: Without them the provider is not used.
        report: Gets a warning if the pose remains unknown.
    """
    from btcore_ros2.nav2.client import Nav2Client
    from btcore_ros2.nav2.pose_listener import POSE_IS_UNKNOWN

    client = Nav2Client(session)
    if not session.wait_for(client.pose, POSE_WAIT_S):
        report.warn(f"--nav2: {POSE_IS_UNKNOWN}")
    return client


@provider
def telemetry(settings: TelemetrySettings, ros: RosSettings, tree: Tree) -> Iterator[None]:
    """Publish the tree on topics of ROS 2.

    Args:
        settings: What is published.
        ros: The arguments of the telemetry's ROS node.
    """
    from btcore_ros2.session import node_arguments
    from btcore_ros2.telemetry import RosTelemetry

    with RosTelemetry(tree, settings.ros2_publish, arguments=node_arguments(ros.ros_args)):
        yield
