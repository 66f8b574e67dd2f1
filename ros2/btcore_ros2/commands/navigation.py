"""`btcore ros2 navigation`: our navigation in the place of Nav2's servers."""

import click

from btcore import RunSettings
from btcore.field_options import add_options
from btcore.program_runner import (
    GivenSettings,
    ProviderCommand,
    TreelessProgram,
    create_run,
    print_result,
)
from btcore_ros2.commands.sim import SPARE_BOXES
from btcore_ros2.providers import RosRobotSettings, RosSettings, open_session
from btcore_ros2.session import RosSession


@click.command("navigation", cls=ProviderCommand, short_help="Navigate in the place of Nav2's servers.")
@click.option(
    "--without-navigators",
    is_flag=True,
    help="Leave out navigate_to_pose, navigate_through_poses and goal_pose: another program offers them, "
    "such as bt_navigator or btcore ros2 navigator.",
)
@add_options(RunSettings, "duration", "seed")
@add_options(RosSettings)
@click.pass_context
def navigation(ctx: click.Context, /, settings: GivenSettings, without_navigators: bool) -> int:
    """Offer btcore's navigation as Nav2's actions, services and topics, so that other trees can use it.

    The robot is that of --ros2 on the map of --map, or the simulated robot in --world. --nav-params reads
    parameters from a file of Nav2. Ctrl-C ends the navigation, and so does a client that shuts down its
    lifecycle nodes.
    """
    with open_session(settings.of(RosSettings), settings.find(RosRobotSettings), "navigation") as session:
        return _run(ctx, session, settings, navigates=not without_navigators)


def _run(ctx: click.Context, session: RosSession, settings: GivenSettings, *, navigates: bool) -> int:
    from btcore_navigation.stack import Navigation
    from btcore_ros2.nav2.navigation_topics import NavigationTopics
    from btcore_ros2.nav2.served_navigation import ServedNavigation
    from btcore_ros2.simulation.services import offer_services
    from btcore_sim.providers import SpareBoxes
    from btcore_sim.simulation import Simulation

    program = TreelessProgram("Navigation")
    # With spare boxes the simulated robot has the events of btcore ros2 sim.
    resources = [session, SpareBoxes(SPARE_BOXES)]
    with create_run(ctx, program, settings, resources=resources).want(Navigation) as run:
        stack = run.find(Navigation)
        assert stack is not None
        robot = stack.robot
        session.drain_during(robot)
        served = ServedNavigation(session, stack, navigates=navigates)
        NavigationTopics(session, stack, navigates=navigates)
        simulated = run.find(Simulation)
        if simulated is not None:
            offer_services(session, simulated)
        session.node.get_logger().info("navigation is ready: the actions, services and topics of Nav2")
        program.keep_running = lambda: not served.is_shut_down
        run.tick_to_end()
        served.close()
        robot.stop()
    print_result("navigation", run, {})
    return run.exit_code
