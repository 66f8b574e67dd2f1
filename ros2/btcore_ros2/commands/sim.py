"""`btcore ros2 sim`: the simulated robot as a ROS 2 robot."""

from typing import Any

import click

from btcore.program_runner import (
    FiniteRange,
    RunCommand,
    print_json,
    print_result,
    require_resources,
    run_program,
)
from btcore.run_extension import ProgramSettings
from btcore_robot.robot import Phase, Robot
from btcore_ros2.errors import RosError
from btcore_ros2.session import RosSession, node_arguments

SPARE_BOXES = 5
"""The number of boxes that the service `sim/drop_box` can drop."""


@click.command("sim", cls=RunCommand, short_help="Simulate a robot on the topics of ROS 2.")
@click.option("--duration", type=FiniteRange(0, min_open=True), metavar="S", help="Stop after this time.")
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, metavar="N", help="Random seed."
)
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
def sim(ctx: click.Context, /, **settings: Any) -> int:
    """Simulate a Tiago that publishes what the real robot publishes, and takes the same commands.

    The topics are those of the real robot: scan_raw, mobile_base_controller/odom, cmd_vel and so on. Events
    and the figures of the run are services below sim/. Ctrl-C ends the simulation.
    """
    try:
        session = RosSession("simulation", arguments=node_arguments(settings.get("ros_args")))
    except (RosError, ValueError) as error:
        raise click.UsageError(str(error)) from error
    with session:
        added: ProgramSettings = {"ros_session": session, "spare_boxes": SPARE_BOXES}
        return _run(ctx, session, {**settings, **added, "fast": settings["lockstep"]})


def _run(ctx: click.Context, session: RosSession, settings: dict[str, Any]) -> int:
    if settings.get("ros2_robot") is not None:
        raise click.UsageError("--ros2 does not belong here: this command simulates its own robot")
    gathered = require_resources(ctx, {**settings, "lockstep": False}, (RosSession, Robot))
    # Imported here: the simulator is installed, since there is a robot, and so is ROS 2.
    from btcore_ros2.simulation.lockstep import LockstepServer
    from btcore_ros2.simulation.services import offer_services
    from btcore_ros2.simulation.topics import DRAIN_RATE, RobotTopics
    from btcore_sim.run_extension import SimExtension
    from btcore_sim.simulated_robot import SimulatedRobot

    robot = next((robot for robot in gathered.resources if isinstance(robot, SimulatedRobot)), None)
    extension = next(each for each in gathered.extensions if isinstance(each, SimExtension))
    if robot is None or extension.events is None:
        raise click.UsageError("this command simulates its own robot: leave out the options of another robot")
    topics = RobotTopics(session, robot)
    offer_services(session, robot, extension.events, extension.report)
    server: LockstepServer | None = None
    if settings["lockstep"]:
        server = LockstepServer(session, topics, settings["wait_limit"])
        robot.schedule.pace = server.pace
    else:
        robot.schedule.add_task(DRAIN_RATE, Phase.PHYSICS, lambda now: session.drain())
    waits = ", and waits for a client that requests steps" if server is not None else ""
    click.echo(f"the simulated {robot.description.name} is on ROS 2{waits}; Ctrl-C ends it", err=True)
    done = run_program(
        "Simulation",
        gathered,
        settings,
        server.close if server is not None else lambda: None,
        clock=robot.clock,
        keep_running=lambda: server is None or not server.is_abandoned,
    )
    if settings["as_json"]:
        print_json({"time_s": round(done.seconds, 3), **done.report})
    else:
        print_result("simulation", done, {})
    if server is not None and server.is_abandoned:
        limit = settings["wait_limit"]
        click.echo(f"error: no client requested a step for {limit:g} s (--wait-limit)", err=True)
        return 1
    return done.code
