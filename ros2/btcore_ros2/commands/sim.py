"""`btcore ros2 sim`: the simulated robot as a ROS 2 robot."""

from typing import Final

import click
import msgspec

from btcore import RunSettings
from btcore.field_options import FiniteRange, add_options
from btcore.program_runner import (
    GivenSettings,
    ProviderCommand,
    TreelessProgram,
    create_run,
    print_json,
    print_result,
)
from btcore_ros2.providers import RosRobotSettings, RosSettings, open_session
from btcore_ros2.session import RosSession

SPARE_BOXES: Final = 5
"""The number of boxes that the service `sim/drop_box` can drop."""


@click.command("sim", cls=ProviderCommand, short_help="Simulate a robot on the topics of ROS 2.")
@add_options(RunSettings, "duration", "seed")
@add_options(RosSettings)
@click.option(
    "--wait-limit",
    type=FiniteRange(0, min_open=True),
    default=600.0,
    show_default=True,
    metavar="S",
    help="With --lockstep: end if no step is requested for this time.",
)
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object as the last line of stdout.")
@click.pass_context
def sim(ctx: click.Context, /, settings: GivenSettings, wait_limit: float, as_json: bool) -> int:
    """Simulate a Tiago that publishes what the real robot publishes, and takes the same commands.

    The topics are those of the real robot: scan_raw, mobile_base_controller/odom, cmd_vel and so on. Events
    and the figures of the run are services below sim/. Ctrl-C ends the simulation.
    """
    if RosRobotSettings in settings.classes:
        raise click.UsageError("--ros2 does not belong here: this command simulates its own robot")
    ros = settings.of(RosSettings)
    settings.replace(msgspec.structs.replace(settings.of(RunSettings), fast=ros.lockstep))
    # --lockstep is for the clients: the session of the simulation itself waits for nothing.
    with open_session(RosSettings(ros.ros_args), name="simulation") as session:
        return _run(ctx, session, settings, wait_limit if ros.lockstep else None, as_json)


def _run(
    ctx: click.Context,
    session: RosSession,
    settings: GivenSettings,
    wait_limit: float | None,
    as_json: bool,
) -> int:
    """Run the simulation, in lockstep if *wait_limit* (s) is given, and return the exit code."""
    # Imported here: ROS 2 is installed, since there is a session.
    from btcore_ros2.simulation.lockstep import LockstepServer
    from btcore_ros2.simulation.services import offer_services
    from btcore_ros2.simulation.topics import RobotTopics
    from btcore_sim.providers import SpareBoxes
    from btcore_sim.simulation import Simulation

    program = TreelessProgram("Simulation")
    resources = [session, SpareBoxes(SPARE_BOXES)]
    run = create_run(ctx, program, settings, resources=resources).want(Simulation)
    server: LockstepServer | None = None
    with run:
        simulated = run.find(Simulation)
        assert simulated is not None
        robot = simulated.robot
        topics = RobotTopics(session, robot)
        offer_services(session, simulated)
        if wait_limit is not None:
            server = LockstepServer(session, topics, wait_limit)
            robot.schedule.pace = server.pace
            program.keep_running = lambda: not server.is_abandoned
        else:
            session.drain_during(robot)
        waits = ", and waits for a client that requests steps" if server is not None else ""
        click.echo(f"the simulated {robot.description.name} is on ROS 2{waits}; Ctrl-C ends it", err=True)
        run.tick_to_end()
        if server is not None:
            server.close()
    if as_json:
        print_json({"time_s": round(run.elapsed_s, 3), **run.report})
    else:
        print_result("simulation", run, {})
    if server is not None and server.is_abandoned:
        click.echo(f"error: no client requested a step for {wait_limit:g} s (--wait-limit)", err=True)
        return 1
    return run.exit_code
