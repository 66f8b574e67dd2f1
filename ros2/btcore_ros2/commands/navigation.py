"""`btcore ros2 navigation`: our navigation in the place of Nav2's servers."""

from typing import TYPE_CHECKING, Any, cast

import click

from btcore.program_runner import FiniteRange, RunCommand, print_result, require_resources, run_program
from btcore.run_extension import ProgramSettings
from btcore_robot.robot import Phase, Robot
from btcore_ros2.commands.sim import SPARE_BOXES
from btcore_ros2.errors import RosError
from btcore_ros2.session import DRAIN_RATE, RosSession, node_arguments

if TYPE_CHECKING:
    from btcore_sim.simulated_robot import SimulatedRobot


@click.command("navigation", cls=RunCommand, short_help="Navigate in the place of Nav2's servers.")
@click.option(
    "--without-navigators",
    is_flag=True,
    help="Leave out navigate_to_pose, navigate_through_poses and goal_pose: another program offers them, "
    "such as bt_navigator or btcore ros2 navigator.",
)
@click.option("--duration", type=FiniteRange(0, min_open=True), metavar="S", help="Stop after this time.")
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, metavar="N", help="Random seed."
)
@click.pass_context
def navigation(ctx: click.Context, /, **settings: Any) -> int:
    """Offer btcore's navigation as Nav2's actions, services and topics, so that other trees can use it.

    The robot is that of --ros2 on the map of --map, or the simulated robot in --world. --nav-params reads
    parameters from a file of Nav2. Ctrl-C ends the navigation, and so does a client that shuts down its
    lifecycle nodes.
    """
    try:
        session = RosSession("navigation", arguments=node_arguments(settings.get("ros_args")))
    except (RosError, ValueError) as error:
        raise click.UsageError(str(error)) from error
    with session:
        try:
            # With spare boxes the simulated robot has the events of btcore ros2 sim.
            added: ProgramSettings = {"ros_session": session, "spare_boxes": SPARE_BOXES}
            return _run(ctx, session, {**settings, **added, "fast": False})
        except RosError as error:
            raise click.UsageError(str(error)) from error


def _run(ctx: click.Context, session: RosSession, settings: dict[str, Any]) -> int:
    from btcore_navigation.stack import Navigation
    from btcore_ros2.nav2.navigation_topics import NavigationTopics
    from btcore_ros2.nav2.served_navigation import ServedNavigation

    gathered = require_resources(ctx, settings, (RosSession, Robot, Navigation))
    stack = next(resource for resource in gathered.resources if isinstance(resource, Navigation))
    robot = stack.robot
    if robot.clock is not session.clock:
        robot.schedule.add_task(DRAIN_RATE, Phase.SENSORS, lambda now: session.drain())
    navigates = not settings["without_navigators"]
    served = ServedNavigation(session, stack, navigates=navigates)
    NavigationTopics(session, stack, navigates=navigates)
    for extension in gathered.extensions:
        events = getattr(extension, "events", None)
        if events is not None:
            from btcore_ros2.simulation.services import offer_services

            offer_services(session, cast("SimulatedRobot", robot), events, extension.report)
    session.node.get_logger().info("navigation is ready: the actions, services and topics of Nav2")

    def end() -> None:
        served.close()
        robot.stop()

    done = run_program(
        "Navigation",
        gathered,
        settings,
        end,
        clock=robot.clock,
        keep_running=lambda: not served.is_shut_down,
    )
    print_result("navigation", done, {})
    return done.code
